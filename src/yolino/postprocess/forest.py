"""Segments to trees of successors, and trees to averaged chains, compiled (paper, appendix)."""

from __future__ import annotations

from typing import no_type_check

import numpy as np
from numba import njit

from yolino.postprocess.cells import sort_points, windows


@njit(cache=True, error_model="numpy")
@no_type_check
def find_successors(endpoints, radius, lowest):
    """Gives the segment whose start is the nearest to each segment's end, -1 for none, and how near it is.

    It must be nearer than `radius`, start above `lowest`, and lie ahead: its middle ahead of the segment's
    middle in the directions of both. Of equally near ones the first is taken.
    """
    n = len(endpoints)
    successors, gaps = np.full(n, -1, np.int64), np.full(n, radius)
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
                if gap > gaps[i] or gap >= radius or (gap == gaps[i] and j > successors[i]):
                    continue
                if endpoints[j, 0, 1] <= lowest and _ahead(endpoints, i, j):
                    successors[i], gaps[i] = j, gap
    return successors, gaps


@njit(cache=True, error_model="numpy", inline="always")
@no_type_check
def _ahead(endpoints, i, j):
    forward = backward = 0.0
    for k in range(2):
        step = (endpoints[j, 0, k] + endpoints[j, 1, k] - endpoints[i, 0, k] - endpoints[i, 1, k]) / 2
        forward += step * (endpoints[i, 1, k] - endpoints[i, 0, k])
        backward += step * (endpoints[j, 1, k] - endpoints[j, 0, k])
    return forward > 0 and backward > 0


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
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
    first = np.zeros(n + 1, np.int64)
    for i in range(n):
        if successors[i] >= 0:
            first[successors[i] + 1] += 1
    first = np.cumsum(first)
    places, before = first[:-1].copy(), np.empty(first[-1], np.int64)
    for i in range(n):
        if successors[i] >= 0:
            before[places[successors[i]]] = i
            places[successors[i]] += 1
    count = 0
    for v in order:
        branches = before[first[v] : first[v + 1]]
        if len(branches):
            groups = _group_branches(endpoints, branches, behind, depths, radius)
            trunk = groups[np.argmin(gaps[branches])]
            for b in range(len(branches)):
                if groups[b] != trunk:
                    trees[branches[b]] = groups[b]
                    successors[branches[b]] = -1
                    count += groups[b] == branches[b]
            behind[v], depths[v] = trunk, depths[trunk] + 1
        if successors[v] < 0:
            trees[v] = v
    return trees, count


@njit(cache=True, error_model="numpy")
@no_type_check
def _group_branches(endpoints, branches, behind, depths, radius):
    """Gives the deepest branch that each branch runs beside: itself, or one of which that is not true."""
    groups = branches.copy()
    by_depth = np.argsort(-depths[branches], kind="mergesort")
    for p in range(len(branches)):
        b = by_depth[p]
        for q in range(p):
            other = branches[by_depth[q]]
            if groups[by_depth[q]] == other and _same_line(endpoints, branches[b], other, behind, radius):
                groups[b] = other
                break
    return groups


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
@no_type_check
def _distance(endpoints, j, x, y):
    """Gives the distance of a point from segment j."""
    ux, uy = endpoints[j, 1, 0] - endpoints[j, 0, 0], endpoints[j, 1, 1] - endpoints[j, 0, 1]
    gx, gy = x - endpoints[j, 0, 0], y - endpoints[j, 0, 1]
    norm = ux * ux + uy * uy
    share = min(max((gx * ux + gy * uy) / norm, 0.0), 1.0) if norm > 0 else 0.0
    return np.sqrt((gx - share * ux) ** 2 + (gy - share * uy) ** 2)


@njit(cache=True, error_model="numpy")
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
    roots = np.flatnonzero(sizes)
    offsets = np.zeros(len(roots) + 1, np.int64)
    offsets[1:] = np.cumsum(sizes[roots])
    stops = np.empty(n, np.int64)
    stops[roots] = offsets[1:]
    total = offsets[-1]
    lines, confidences, chances = np.zeros((total, 2, 2)), np.zeros(total), np.zeros((total, votes.shape[1]))
    weights, weighed = np.zeros(total), np.zeros(total)
    for i in range(n):
        weighed[stops[trees[i]] - 1 - levels[i]] += scores[i]
    for i in range(n):
        at = stops[trees[i]] - 1 - levels[i]
        weight = scores[i] if weighed[at] > 0 else 1.0
        weights[at] += weight
        lines[at] += weight * endpoints[i]
        confidences[at] += weight * scores[i]
        chances[at] += weight * votes[i]
    for at in range(total):
        lines[at] /= weights[at]
        confidences[at] /= weights[at]
        chances[at] /= weights[at]
    return lines, confidences, chances, offsets
