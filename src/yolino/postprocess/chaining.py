"""Chains of segments: links, duplicates dropped, gaps joined, compiled. What the linkers without trees share.

Chains are the segments in order, whether each is walked backwards, where each chain begins (and the last
ends), and whether it is a ring (see `links.trace_chains`).
"""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from yolino.compiled import compiled
from yolino.postprocess.duplicates import find_originals
from yolino.postprocess.links import match_nodes, segment_nodes, trace_chains

_LOOK_BACK = 3.0  # cells at a chain's end that tell its direction


@compiled
@no_type_check
def chain_segments(endpoints, scores, votes, rules, weights=None):
    """Gives the chains of segments in cell units, and the segments in the order and direction of the chains.

    Args:
        endpoints: Sorted segments (see `sort_segments`).
        scores: Their scores.
        votes: How much each is for each label.
        rules: Whether directions count, and the rules of `match_nodes` for links, of `find_originals`, and of
            `match_nodes` for gaps; the latter two are left out where their radius is 0.
        weights: How much classes and scores count in the links (see `match_nodes`); None: not at all.

    Returns:
        Offsets of the chains, whether each is a ring, and end points, scores and votes.
    """
    directed, link_rule, duplicate_rule, join_rule = rules
    owners = np.arange(2 * len(endpoints)) >> 1
    partners, costs = match_nodes(
        segment_nodes(endpoints), directed, link_rule, (owners, scores, votes), weights
    )
    items, flips, offsets, rings = trace_chains(partners, costs, directed)
    if duplicate_rule[0] > 0:
        kept = find_originals((items, offsets), endpoints, scores, directed, duplicate_rule)
        items, flips, offsets, rings = _choose(kept, items, flips, offsets, rings)
    if join_rule[0] > 0:
        nodes, owners = _chain_nodes(endpoints, items, flips, offsets, rings)
        partners, costs = match_nodes(nodes, directed, join_rule, (owners, scores, votes), weights)
        links = trace_chains(partners, costs, directed)
        items, flips, offsets, rings = _concatenate(links, items, flips, offsets, rings)
    if not directed:
        _turn_to_majority(endpoints, items, flips, offsets)
    lines, means, chances = (
        np.empty((len(items), 2, 2)),
        np.empty(len(items)),
        np.empty((len(items), votes.shape[1])),
    )
    for p in range(len(items)):
        i, start = items[p], int(flips[p])
        for k in range(2):
            lines[p, 0, k], lines[p, 1, k] = endpoints[i, start, k], endpoints[i, 1 - start, k]
        means[p] = scores[i]
        for k in range(votes.shape[1]):
            chances[p, k] = votes[i, k]
    return offsets, rings, lines, means, chances


@compiled
@no_type_check
def _choose(kept, items, flips, offsets, rings):
    """Gives the kept chains."""
    count = filled = 0
    offsets = offsets.copy()
    begin = 0
    for c in range(len(kept)):
        stop = offsets[c + 1]
        if kept[c]:
            for p in range(begin, stop):
                items[filled], flips[filled] = items[p], flips[p]
                filled += 1
            rings[count] = rings[c]
            count += 1
            offsets[count] = filled
        begin = stop
    return items[:filled], flips[:filled], offsets[: count + 1], rings[:count]


@compiled
@no_type_check
def _chain_nodes(endpoints, items, flips, offsets, rings):
    """Gives the nodes of chains (see `links`), with the direction of their last cells, and their segments."""
    nodes = np.zeros((2 * (len(offsets) - 1), 5))
    owners = np.empty(len(nodes), np.int64)
    for c in range(len(offsets) - 1):
        for end in range(2):
            outer = offsets[c + 1] - 1 if end else offsets[c]
            x = y = walked = 0.0
            for k in range(offsets[c + 1] - offsets[c]):
                p = outer - k if end else outer + k
                dx, dy = _way(endpoints, items[p])
                if walked < _LOOK_BACK:
                    way = 1.0 if flips[p] != (end == 1) else -1.0
                    x, y = x + way * dx, y + way * dy
                walked += np.sqrt(dx * dx + dy * dy)
            norm = np.sqrt(x * x + y * y)
            scale = 1 / norm if norm > 0 and not rings[c] else 0.0  # without a direction nothing is linked
            i, tip, node = items[outer], end ^ int(flips[outer]), 2 * c + end
            owners[node] = i
            nodes[node, 0], nodes[node, 1] = endpoints[i, tip, 0], endpoints[i, tip, 1]
            nodes[node, 2], nodes[node, 3], nodes[node, 4] = x * scale, y * scale, walked / 2
    return nodes, owners


@compiled(inline=True)
@no_type_check
def _way(endpoints, i):
    return endpoints[i, 1, 0] - endpoints[i, 0, 0], endpoints[i, 1, 1] - endpoints[i, 0, 1]


@compiled
@no_type_check
def _concatenate(links, items, flips, offsets, rings):
    """Gives the chains of chains."""
    chains, backwards, groups, closed = links
    new_items, new_flips = np.empty_like(items), np.empty_like(flips)
    new_offsets, new_rings = np.zeros(len(groups), np.int64), closed.copy()
    filled = 0
    for g in range(len(groups) - 1):
        for q in range(groups[g], groups[g + 1]):
            c = chains[q]
            new_rings[g] |= rings[c]
            for k in range(offsets[c + 1] - offsets[c]):
                p = offsets[c + 1] - 1 - k if backwards[q] else offsets[c] + k
                new_items[filled], new_flips[filled] = items[p], flips[p] != backwards[q]
                filled += 1
        new_offsets[g + 1] = filled
    return new_items, new_flips, new_offsets, new_rings


@compiled
@no_type_check
def _turn_to_majority(endpoints, items, flips, offsets):
    """Reverses the chains that run against most of their segments' length."""
    for c in range(len(offsets) - 1):
        first, stop = offsets[c], offsets[c + 1]
        balance = 0.0
        for p in range(first, stop):
            dx, dy = _way(endpoints, items[p])
            balance += (-1.0 if flips[p] else 1.0) * np.sqrt(dx * dx + dy * dy)
        if balance < 0:
            for k in range((stop - first + 1) // 2):
                p, q = first + k, stop - 1 - k
                items[p], items[q] = items[q], items[p]
                flips[p], flips[q] = not flips[q], not flips[p]
