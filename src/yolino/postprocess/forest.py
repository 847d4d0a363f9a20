"""Segments to trees of successors, and trees to averaged chains, compiled (paper, appendix)."""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from yolino.compiled import compiled
from yolino.postprocess.cells import sort_points, windows
from yolino.postprocess.sorting import sort_rows

_TINY = 1e-300  # a score of zero still counts among zeros
_EQUAL = 1e-3  # cells by which gaps must differ to count more than the direction


@compiled
@no_type_check
def find_successors(endpoints, radius, lowest):
    """Gives the segment whose start is the nearest to each segment's end, -1 for none, and how near it is.

    It must be nearer than `radius`, start no lower than `lowest`, and lie ahead: it starts ahead of the
    segment's middle, and the segment ends behind its middle. Of equally near ones it is the straightest.
    """
    n = len(endpoints)
    successors, gaps, costs = np.full(n, -1, np.int64), np.full(n, np.inf), np.full(n, np.inf)
    _, order, keys, columns = sort_points(endpoints.reshape(2 * n, 2), radius)
    runs = windows(keys, columns)
    for p in range(2 * n):
        for half in range(2):
            for q in range(runs[p, half, 0], runs[p, half, 1]):
                if not (order[p] ^ order[q]) & 1:  # two starts, or two ends
                    continue
                i, j = (order[p], order[q]) if order[p] & 1 else (order[q], order[p])
                i, j = i >> 1, j >> 1
                dx, dy = endpoints[j, 0, 0] - endpoints[i, 1, 0], endpoints[j, 0, 1] - endpoints[i, 1, 1]
                gap = np.sqrt(dx * dx + dy * dy)
                if gap >= radius or gap > costs[i] or endpoints[j, 0, 1] > lowest:
                    continue
                ahead, turn = _compare(endpoints, i, j)
                cost = gap + _EQUAL * turn
                if ahead and (cost < costs[i] or (cost == costs[i] and j < successors[i])):
                    successors[i], gaps[i], costs[i] = j, gap, cost
    return successors, gaps


@compiled(inline=True)
@no_type_check
def _compare(endpoints, i, j):
    """Tells whether segment j lies ahead of segment i, and gives 1 - cosine of the angle between them."""
    forward = backward = dot = squared = other = 0.0
    for k in range(2):
        way, onward = endpoints[i, 1, k] - endpoints[i, 0, k], endpoints[j, 1, k] - endpoints[j, 0, k]
        forward += way * (endpoints[j, 0, k] - endpoints[i, 0, k] - way / 2)
        backward += onward * (endpoints[j, 0, k] + onward / 2 - endpoints[i, 1, k])
        dot, squared, other = dot + way * onward, squared + way * way, other + onward * onward
    ahead = forward > 0 and backward > 0
    return ahead, 1 - dot / np.sqrt(squared * other) if ahead else 2.0


@compiled
@no_type_check
def cut_cycles(successors, gaps):
    """Takes the widest link out of each cycle of successors, and gives how many cycles there were."""
    walks = np.full(len(successors), -1, np.int64)
    count = 0
    for first in range(len(successors)):
        i = first
        while i >= 0 and walks[i] < 0:
            walks[i] = first
            i = successors[i]
        if i < 0 or walks[i] != first:
            continue
        widest, j = i, successors[i]
        while j != i:
            if gaps[j] > gaps[widest] or (gaps[j] == gaps[widest] and j < widest):
                widest = j
            j = successors[j]
        successors[widest] = -1
        count += 1
    return count


@compiled
@no_type_check
def leaves_first(successors):
    """Gives an order in which each segment stands before its successor."""
    n = len(successors)
    waiting, order = np.zeros(n, np.int64), np.empty(n, np.int64)
    for i in range(n):
        if successors[i] >= 0:
            waiting[successors[i]] += 1
    filled = 0
    for i in range(n):
        if waiting[i] == 0:
            order[filled] = i
            filled += 1
    for p in range(n):
        i = successors[order[p]]
        if i >= 0:
            waiting[i] -= 1
            if waiting[i] == 0:
                order[filled] = i
                filled += 1
    return order


@compiled
@no_type_check
def cut_branches(endpoints, links, order, radius):
    """Gives the tree of each segment that is the first of one (-1: not), and how many branches were cut off.

    Predecessors of one segment whose branches stay within `radius` beside each other are one line seen
    several times. Of several such groups, the one with the nearest end goes on; each other one becomes a
    tree of its own.
    """
    successors, gaps = links
    n = len(successors)
    trees, behind, depths = np.full(n, -1, np.int64), np.full(n, -1, np.int64), np.ones(n, np.int64)
    first, before = _predecessors(successors)
    count = 0
    for v in order:
        branches = before[first[v] : first[v + 1]]
        if len(branches):
            groups = _group_branches(endpoints, branches, behind, depths, radius)
            nearest = 0
            for b in range(len(branches)):
                if gaps[branches[b]] < gaps[branches[nearest]]:
                    nearest = b
            trunk = groups[nearest]
            for b in range(len(branches)):
                if groups[b] != trunk:
                    trees[branches[b]] = groups[b]
                    successors[branches[b]] = -1
                    count += groups[b] == branches[b]
            behind[v], depths[v] = trunk, depths[trunk] + 1
        if successors[v] < 0:
            trees[v] = v
    return trees, count


@compiled
@no_type_check
def _predecessors(successors):
    """Gives where the predecessors of each segment begin in a list (and the last end), and the list."""
    n = len(successors)
    first, places, before = np.zeros(n + 1, np.int64), np.zeros(n, np.int64), np.empty(n, np.int64)
    for i in range(n):
        if successors[i] >= 0:
            first[successors[i] + 1] += 1
    for i in range(n):
        first[i + 1] += first[i]
        places[i] = first[i]
    for i in range(n):
        if successors[i] >= 0:
            before[places[successors[i]]] = i
            places[successors[i]] += 1
    return first, before


@compiled
@no_type_check
def _group_branches(endpoints, branches, behind, depths, radius):
    """Gives the deepest branch that each branch runs beside: itself, or one of which that is not true."""
    groups, shallowness = branches.copy(), np.empty((len(branches), 1))
    for b in range(len(branches)):
        shallowness[b, 0] = -depths[branches[b]]
    by_depth = sort_rows(shallowness)
    for p in range(len(branches)):
        b = by_depth[p]
        for q in range(p):
            other = branches[by_depth[q]]
            if groups[by_depth[q]] == other and _same_line(endpoints, branches[b], other, behind, radius):
                groups[b] = other
                break
    return groups


@compiled
@no_type_check
def _same_line(endpoints, i, j, behind, radius):
    """Tells whether the line that ends in segment i stays within `radius` of the one that ends in j."""
    while i >= 0:
        x, y = (endpoints[i, 0, 0] + endpoints[i, 1, 0]) / 2, (endpoints[i, 0, 1] + endpoints[i, 1, 1]) / 2
        while behind[j] >= 0 and _distance(endpoints, behind[j], x, y) <= _distance(endpoints, j, x, y):
            j = behind[j]
        if _distance(endpoints, j, x, y) > radius:
            # Behind the other's last segment nothing is left to compare with.
            ux, uy = endpoints[j, 1, 0] - endpoints[j, 0, 0], endpoints[j, 1, 1] - endpoints[j, 0, 1]
            past = (x - endpoints[j, 0, 0]) * ux + (y - endpoints[j, 0, 1]) * uy < 0
            beside = abs((y - endpoints[j, 0, 1]) * ux - (x - endpoints[j, 0, 0]) * uy)
            return behind[j] < 0 and past and beside <= radius * np.sqrt(ux * ux + uy * uy)
        i = behind[i]
    return True


@compiled
@no_type_check
def _distance(endpoints, j, x, y):
    """Gives the distance of a point from segment j."""
    ux, uy = endpoints[j, 1, 0] - endpoints[j, 0, 0], endpoints[j, 1, 1] - endpoints[j, 0, 1]
    gx, gy = x - endpoints[j, 0, 0], y - endpoints[j, 0, 1]
    norm = ux * ux + uy * uy
    share = min(max((gx * ux + gy * uy) / norm, 0.0), 1.0) if norm > 0 else 0.0
    gx, gy = gx - share * ux, gy - share * uy
    return np.sqrt(gx * gx + gy * gy)


@compiled
@no_type_check
def average_levels(segments, successors, trees, order):
    """Gives the mean segment of each level of each tree, the deepest level first, and the trees' offsets.

    Level by level from the root, breadth first: end points, scores and votes are averaged with the scores
    as weights.
    """
    endpoints, scores, votes = segments
    n = len(order)
    levels, sizes = np.zeros(n, np.int64), np.zeros(n, np.int64)
    for p in range(n - 1, -1, -1):
        i = order[p]
        if successors[i] >= 0:
            trees[i], levels[i] = trees[successors[i]], levels[successors[i]] + 1
        sizes[trees[i]] = max(sizes[trees[i]], levels[i] + 1)
    offsets, stops, count = np.zeros(n + 1, np.int64), np.empty(n, np.int64), 0
    for i in range(n):
        if sizes[i]:
            offsets[count + 1] = stops[i] = offsets[count] + sizes[i]
            count += 1
    total = offsets[count]
    lines, means, chances = np.zeros((total, 2, 2)), np.zeros(total), np.zeros((total, votes.shape[1]))
    weights, places = np.zeros(total), np.empty(n, np.int64)
    for i in range(n):
        places[i] = stops[trees[i]] - 1 - levels[i]
        weights[places[i]] += max(scores[i], _TINY)
    for i in range(n):
        at = places[i]
        share = max(scores[i], _TINY) / weights[at]
        means[at] += share * scores[i]
        for k in range(4):
            lines[at, k >> 1, k & 1] += share * endpoints[i, k >> 1, k & 1]
        for k in range(votes.shape[1]):
            chances[at, k] += share * votes[i, k]
    return lines, means, chances, offsets[: count + 1]
