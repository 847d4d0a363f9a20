"""Who continues whom: mutual-best links between the ends of segments or chains, compiled.

Item i has two nodes, its start `2 i` and its end `2 i + 1`; `node ^ 1` is the other end of the same item. A
node is a row `x, y, u_x, u_y, reach`: where the end lies, the unit direction that leads out of the item
there, and how far behind the end the item's middle lies. All lengths are in cell units.
"""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from yolino.compiled import compiled
from yolino.postprocess.cells import sort_points, windows


@compiled
@no_type_check
def segment_nodes(endpoints):
    """Gives the two nodes of each segment, in the unit of its end points."""
    nodes = np.empty((2 * len(endpoints), 5))
    for i in range(len(endpoints)):
        dx, dy = endpoints[i, 1, 0] - endpoints[i, 0, 0], endpoints[i, 1, 1] - endpoints[i, 0, 1]
        length = np.sqrt(dx * dx + dy * dy)
        scale = 1 / length if length > 0 else 0.0
        for end in range(2):
            way = scale if end else -scale
            nodes[2 * i + end, 0], nodes[2 * i + end, 1] = endpoints[i, end, 0], endpoints[i, end, 1]
            nodes[2 * i + end, 2], nodes[2 * i + end, 3] = way * dx, way * dy
            nodes[2 * i + end, 4] = length / 2
    return nodes


@compiled
@no_type_check
def match_nodes(nodes, directed, rule, sources=None, weights=None):
    """Gives the partner of each node, -1 for none, and the cost of that link.

    Of all links that the rule allows the cheapest is made first, then the cheapest between the nodes still
    free, and so on: every link is the best of both its nodes among what is left. Directed links lead from
    an end to a start.

    Args:
        nodes: Ends of items, see above.
        directed: Whether directions count.
        rule: See `_link_cost`.
        sources: The segment of each node, and scores and votes of the segments; for the weights.
        weights: What it costs if classes have nothing in common, and if the weaker score is nothing beside
            the stronger; None where neither counts.
    """
    partners, costs = np.full(len(nodes), -1, np.int64), np.full(len(nodes), np.inf)
    if len(nodes) == 0:
        return partners, costs
    places = np.empty((len(nodes), 2))
    for a in range(len(nodes)):
        places[a, 0], places[a, 1] = nodes[a, 0], nodes[a, 1]
    _, order, keys, columns = sort_points(places, rule[0])
    best, least = np.empty(len(nodes), np.int64), np.empty(len(nodes))
    left = -1
    while len(order) != left:
        left = len(order)
        _find_best(nodes, directed, rule, (order, windows(keys, columns)), (best, least), sources, weights)
        filled = 0
        for p in range(left):
            a = order[p]
            if best[a] >= 0 and best[best[a]] == a:
                partners[a], costs[a] = best[a], least[a]
            elif best[a] >= 0:
                order[filled], keys[filled] = a, keys[p]
                filled += 1
        order, keys = order[:filled], keys[:filled]
    return partners, costs


@compiled
@no_type_check
def _find_best(nodes, directed, rule, cells, found, sources, weights):  # noqa: PLR0917 (None is compiled in)
    """Writes the best partner (-1: none) of each node that is left to `best`, and its cost to `least`."""
    order, runs = cells
    best, least = found
    for a in order:
        best[a], least[a] = -1, np.inf
    for p in range(len(order)):
        a = order[p]
        for half in range(2):
            for q in range(runs[p, half, 0], runs[p, half, 1]):
                b = order[q]
                if directed and not (a ^ b) & 1:
                    continue
                cost = _link_cost(nodes, a, b, rule)
                if cost < np.inf:
                    if weights is not None:
                        cost += _unlikeness(sources, a, b, weights)
                    _prefer(best, least, a, b, cost)
                    _prefer(best, least, b, a, cost)


@compiled(inline=True)
@no_type_check
def _prefer(best, least, a, b, cost):
    """Notes b as the best partner of a if it is; of equal costs the nodes decide, the same way for both."""
    old = best[a]
    if cost < least[a] or (cost == least[a] and (min(a, b), max(a, b)) < (min(a, old), max(a, old))):
        best[a], least[a] = b, cost


@compiled(inline=True)
@no_type_check
def _link_cost(nodes, a, b, rule):
    """Gives how badly node b continues node a, infinity if not at all.

    The rule is: how far apart the ends may be; the least cosine of the turn; how far the ends may run past
    each other; how far either may lie beside the other's line, and that per cell of the gap; the weights of
    that distance and of the turn (1 - cosine) beside the gap along the line; and the largest gap by the
    larger reach.
    """
    radius, straight, overlap, beside, slope, lateral_weight, turn_weight, stretch = rule
    gx, gy = nodes[b, 0] - nodes[a, 0], nodes[b, 1] - nodes[a, 1]
    gap = gx * gx + gy * gy
    if gap > radius * radius or a ^ b == 1:
        return np.inf
    ax, ay, bx, by = nodes[a, 2], nodes[a, 3], nodes[b, 2], nodes[b, 3]
    cosine = -(ax * bx + ay * by)
    if cosine < straight:
        return np.inf
    gap = np.sqrt(gap)
    if gap > stretch * max(nodes[a, 4], nodes[b, 4]):
        return np.inf
    tx, ty = ax - bx, ay - by
    norm = np.sqrt(tx * tx + ty * ty)
    along = (gx * tx + gy * ty) / norm
    ahead = along + (nodes[a, 4] * (ax * tx + ay * ty) - nodes[b, 4] * (bx * tx + by * ty)) / norm
    if along < -overlap or ahead <= 0:
        return np.inf
    lateral = max(abs(gx * ay - gy * ax), abs(gx * by - gy * bx))
    if lateral > beside + slope * gap:
        return np.inf
    return abs(along) + lateral_weight * lateral + turn_weight * (1 - cosine)


@compiled(inline=True)
@no_type_check
def _unlikeness(sources, a, b, weights):
    """Gives what it costs that the segments of two nodes differ in class and score."""
    owners, scores, votes = sources
    i, j = owners[a], owners[b]
    common = 0.0
    for k in range(votes.shape[1]):
        common += min(votes[i, k], votes[j, k])
    weaker, stronger = min(scores[i], scores[j]), max(scores[i], scores[j])
    loss = 1 - weaker / stronger if stronger > 0 else 0.0
    return weights[0] * max(1 - common, 0.0) + weights[1] * loss


@compiled
@no_type_check
def trace_chains(partners, costs, directed):
    """Gives the chains that links make of items.

    That is: the items in order, whether each is walked backwards, where each chain begins (and the last
    ends), and whether it is a ring. A ring is opened at its most expensive link.
    """
    n = len(partners) // 2
    items, flips = np.empty(n, np.int64), np.zeros(n, np.bool_)
    offsets, closed = np.zeros(n + 1, np.int64), np.zeros(n, np.bool_)
    done = np.zeros(n, np.bool_)
    filled = count = 0
    for ring in range(2):
        for first in range(0, 2 * n, 2 if directed or ring else 1):
            if done[first >> 1] or (ring == 0 and partners[first] >= 0):
                continue
            node = _weakest(partners, costs, first) if ring else first
            while node >= 0 and not done[node >> 1]:
                items[filled], flips[filled] = node >> 1, node & 1 == 1
                done[node >> 1] = True
                filled += 1
                node = partners[node ^ 1]
            count += 1
            offsets[count], closed[count - 1] = filled, ring == 1
    return items, flips, offsets[: count + 1], closed[:count]


@compiled
@no_type_check
def _weakest(partners, costs, first):
    """Gives the node that the most expensive link of a ring leads to."""
    weakest, node = first, partners[first ^ 1]
    while node != first:
        if costs[node] > costs[weakest]:
            weakest = node
        node = partners[node ^ 1]
    return weakest
