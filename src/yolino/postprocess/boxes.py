"""Boxes for the points of crowded cells, compiled: groups so small that all members of one are neighbors."""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from yolino.compiled import compiled

CROWD = 32  # points in one cell from which on boxes pay
_MIX = np.uint64(0x9E3779B97F4A7C15)  # 2^64 over the golden ratio: spreads neighboring numbers


@compiled
@no_type_check
def is_crowded(keys):
    """Tells whether more than `CROWD` points are in one cell, given their sorted keys."""
    crowded = False
    for p in range(len(keys) - CROWD):
        crowded |= keys[p] == keys[p + CROWD]
    return crowded


@compiled
@no_type_check
def split_cells(rows, keys, order, epsilon):
    """Sorts the rows of crowded cells by box, and gives where each box starts (and the last stops)."""
    n = len(order)
    starts = np.empty(n + 1, np.int64)
    count = p = 0
    while p < n:
        stop = p + 1
        while stop < n and keys[stop] == keys[p]:
            stop += 1
        if stop - p > CROWD:
            sizes = _split_cell(rows[p:stop], order[p:stop], epsilon)
        else:
            sizes = np.ones(stop - p, np.int64)
        for size in sizes:
            starts[count] = p
            p += size
            count += 1
    starts[count] = n
    return starts[: count + 1]


@compiled
@no_type_check
def _split_cell(rows, order, epsilon):
    """Sorts the rows of one cell (and their order) by box, and gives the sizes of the boxes."""
    n, d = rows.shape
    boxes, count = _number_boxes(rows, (np.floor(np.sqrt(d)) + 1) / epsilon)  # the diagonal is below epsilon
    sizes, places = np.zeros(count, np.int64), np.zeros(count + 1, np.int64)
    for p in range(n):
        sizes[boxes[p]] += 1
    for b in range(count):
        places[b + 1] = places[b] + sizes[b]
    old_rows, old_order = rows.copy(), order.copy()
    for p in range(n):
        at = places[boxes[p]]
        places[boxes[p]] += 1
        order[at] = old_order[p]
        for k in range(d):
            rows[at, k] = old_rows[p, k]
    return sizes


@compiled
@no_type_check
def _number_boxes(rows, scale):
    """Gives the box of each row, boxes being 1 / scale wide, and how many there are."""
    n, d = rows.shape
    table, steps, boxes = np.full(2 * n, -1, np.int64), np.empty((n, d), np.int64), np.empty(n, np.int64)
    count = 0
    for p in range(n):
        mix = np.uint64(0)
        for k in range(d):
            steps[count, k] = np.int64(np.floor((rows[p, k] - rows[0, k]) * scale))
            mix = (mix ^ np.uint64(steps[count, k])) * _MIX
        at = np.int64(mix >> np.uint64(20)) % len(table)
        while table[at] >= 0:
            same = True
            for k in range(d):
                same &= steps[table[at], k] == steps[count, k]
            if same:
                break
            at = (at + 1) % len(table)
        if table[at] < 0:
            table[at] = count
            count += 1
        boxes[p] = table[at]
    return boxes, count


@compiled
@no_type_check
def bounds(rows, starts):
    """Gives the low and the high corner of the points of each box."""
    lows = np.empty((len(starts) - 1, rows.shape[1]))
    highs = np.empty_like(lows)
    for b in range(len(lows)):
        for k in range(rows.shape[1]):
            lows[b, k] = highs[b, k] = rows[starts[b], k]
            for p in range(starts[b] + 1, starts[b + 1]):
                lows[b, k], highs[b, k] = min(lows[b, k], rows[p, k]), max(highs[b, k], rows[p, k])
    return lows, highs


@compiled(inline=True)
@no_type_check
def near(rows, p, q, limit):
    """Tells whether the squared distance of rows p and q is within the limit."""
    total = 0.0
    for k in range(rows.shape[1]):
        side = rows[p, k] - rows[q, k]
        total += side * side
    return total <= limit  # no way out earlier: a mispredicted branch costs more than the sum


@compiled(inline=True)
@no_type_check
def gaps(lows, highs, a, b):
    """Gives the squared smallest and largest distance that points of boxes a and b can have."""
    smallest = largest = 0.0
    for k in range(lows.shape[1]):
        low, high = lows[a, k] - highs[b, k], highs[a, k] - lows[b, k]
        gap, reach = max(low, -high, 0.0), max(-low, high)
        smallest += gap * gap
        largest += reach * reach
    return smallest, largest
