"""The nearest sample of a similar direction: a compiled search over square bins.

A growing window of bins around the query is searched until no nearer sample can come. Queries that follow one
another along a line have neighboring answers, so each answer bounds the window of the next query. The time is
linear in the number of samples as long as lines are lines. Memory is linear in the number of samples whatever
the image size.
"""

from __future__ import annotations

from typing import no_type_check

import numpy as np
from jaxtyping import Float, Int

from yolino.compiled import compiled
from yolino.metrics.samples import Samples

# Squared distances (px^2) and places (px) that differ by less are equal: rounding must not decide between
# samples.
_SAME_SQUARED = 1e-7
_SAME = 1e-6
# Cosines: an angle of exactly the radius is within it.
_COSINE_SLACK = 1e-9
# Sides of a bin in pixels: few samples of a line lie in a bin, few empty bins lie within a radius.
_BIN = 8.0
_SMALLEST_BIN = 0.01


def nearest_samples(
    queries: Samples, samples: Samples, radius: float, angle_radius: float, *, directed: bool
) -> tuple[Int[np.ndarray, " q"], Float[np.ndarray, " q"]]:
    """Gives the index of the sample closest to each query and its distance; -1 and infinity if there is none.

    Only samples within both radii (inclusive) are candidates. The closest in position is taken. Of several
    equally close, the furthest along the query's direction is taken, then the furthest to its right, then the
    lowest label, so that the order of the samples is irrelevant.

    Args:
        queries: Where to search from.
        samples: Among which to search.
        radius: Largest distance in pixels.
        angle_radius: Largest angle between the directions in radians.
        directed: Whether opposite directions differ.
    """
    nearest, distances = _nearest(
        (queries.points, queries.directions),
        (samples.points, samples.directions, samples.labels),
        radius,
        np.cos(angle_radius) - _COSINE_SLACK,
        directed,
    )
    return np.asarray(nearest), np.asarray(distances)


def pair_samples(
    nearest: Int[np.ndarray, " q"],
    distances: Float[np.ndarray, " q"],
    labels: Int[np.ndarray, " q"],
    count: int,
) -> Int[np.ndarray, " k"]:
    """Gives the nearest query of each sample that is the nearest of some query, in the samples' order.

    Args:
        nearest: Index of the nearest sample of each query, -1 without one.
        distances: Its distance.
        labels: Label of each query: of several equally near queries the lowest label is taken.
        count: Number of samples.
    """
    return np.asarray(_pair(nearest, distances, labels, count))


# The kernels take plain arrays; no_type_check keeps runtime type checkers from wrapping what numba compiles.
# A row of the table is (x, y, direction x, direction y, label) of a sample, in the order of the bins. A query
# is (x, y, direction x, direction y, least cosine, directed). Arrays are indexed by two numbers at once where
# time matters: numba counts references of every row that is taken out.


@compiled
@no_type_check
def _to_bins(points, side):
    """Gives the bins (origin, bins per pixel, rows, columns), where each begins, and the points in them."""
    x0, y0 = points[0]
    x1, y1 = points[0]
    for i in range(len(points)):
        x0, x1 = min(x0, points[i, 0]), max(x1, points[i, 0])
        y0, y1 = min(y0, points[i, 1]), max(y1, points[i, 1])
    most = 4 * len(points) + 1024
    side = max(side, np.sqrt((x1 - x0) * (y1 - y0) / most), (x1 - x0) / most, (y1 - y0) / most)
    per = 1 / side
    rows, cols = int((y1 - y0) * per) + 1, int((x1 - x0) * per) + 1
    homes = np.empty(len(points), np.int64)
    first = np.zeros(rows * cols + 1, np.int64)
    for i in range(len(points)):
        homes[i] = int((points[i, 1] - y0) * per) * cols + int((points[i, 0] - x0) * per)
        first[homes[i] + 1] += 1
    for b in range(rows * cols):
        first[b + 1] += first[b]
    members = np.empty(len(points), np.int64)
    free = first[:-1].copy()
    for i in range(len(points)):
        members[free[homes[i]]] = i
        free[homes[i]] += 1
    return (x0, y0, per, rows, cols), first, members


@compiled
@no_type_check
def _to_table(samples, members):
    """Gives the samples in the order of the bins."""
    points, directions, labels = samples
    table = np.empty((len(members), 5))
    for row in range(len(members)):
        i = members[row]
        table[row, 0], table[row, 1] = points[i, 0], points[i, 1]
        table[row, 2], table[row, 3] = directions[i, 0], directions[i, 1]
        table[row, 4] = labels[i]
    return table


@compiled
@no_type_check
def _span(low, high, count):
    """Gives the bins, first and end, that hold what lies between two places given in bins."""
    return int(min(max(low, 0.0), count)), int(min(max(high + 1, 0.0), count))


@compiled
@no_type_check
def _along(i, query, table):
    """Tells whether sample i points along the query."""
    dot = table[i, 2] * query[2] + table[i, 3] * query[3]
    return (dot if query[5] else abs(dot)) >= query[4]


@compiled
@no_type_check
def _precedes(i, best, query, table):
    """Tells whether sample i goes before the equally close sample best."""
    ux, uy = query[2], query[3]
    dx, dy = table[i, 0] - table[best, 0], table[i, 1] - table[best, 1]
    ahead, right = dx * ux + dy * uy, dy * ux - dx * uy
    if abs(ahead) > _SAME:
        return ahead > 0
    if abs(right) > _SAME:
        return right > 0
    if table[i, 4] != table[best, 4]:
        return table[i, 4] < table[best, 4]
    return i < best


@compiled
@no_type_check
def _scan(first, end, query, table, nearest):
    """Gives the best sample and its squared distance after looking at some more samples."""
    best, squared = nearest
    for i in range(first, end):
        dx, dy = table[i, 0] - query[0], table[i, 1] - query[1]
        here = dx * dx + dy * dy
        if here > squared + _SAME_SQUARED or not _along(i, query, table):
            continue
        if best < 0 or here < squared - _SAME_SQUARED or _precedes(i, best, query, table):
            best = i
        squared = min(squared, here)
    return best, squared


@compiled
@no_type_check
def _search(query, table, bins, first, squared):
    """Gives the closest sample, at most the squared distance away, or -1; and its squared distance."""
    x0, y0, per, rows, cols = bins
    x, y = (query[0] - x0) * per, (query[1] - y0) * per
    nearest = -1, squared
    bound = np.sqrt(squared + _SAME_SQUARED)
    reach = min(1 / per, bound)
    while True:
        half = (reach + _SAME) * per
        left, right = _span(x - half, x + half, cols)
        top, bottom = _span(y - half, y + half, rows)
        for row in range(top, bottom):
            begin = row * cols
            nearest = _scan(first[begin + left], first[begin + right], query, table, nearest)
        bound = np.sqrt(nearest[1] + _SAME_SQUARED)
        if reach >= bound:
            return nearest
        # A bin is mostly a quarter of the radius: the second window is the last.
        reach = min(5 * reach, bound)


@compiled
@no_type_check
def _nearest(queries, samples, radius, cosine, directed):
    points, directions = queries
    nearest, distances = np.full(len(points), -1), np.full(len(points), np.inf)
    if len(samples[0]) == 0:
        return nearest, distances
    bins, first, members = _to_bins(samples[0], min(max(radius / 4, _SMALLEST_BIN), _BIN))
    table = _to_table(samples, members)
    best = -1
    for q in range(len(points)):
        x, y, ux, uy = points[q, 0], points[q, 1], directions[q, 0], directions[q, 1]
        if not directed and (ux < 0 or (ux == 0 and uy < 0)):
            ux, uy = -ux, -uy
        query = (x, y, ux, uy, cosine, directed)
        squared = radius * radius
        # Nothing farther than the answer to the last query can be the answer to this one.
        if best >= 0 and _along(best, query, table):
            dx, dy = table[best, 0] - x, table[best, 1] - y
            squared = min(squared, dx * dx + dy * dy)
        best, squared = _search(query, table, bins, first, squared)
        if best >= 0:
            nearest[q], distances[q] = members[best], np.sqrt(squared)
    return nearest, distances


@compiled
@no_type_check
def _pair(nearest, distances, labels, count):
    partner = np.full(count, -1)
    for q in range(len(nearest)):
        i = nearest[q]
        if i < 0:
            continue
        p = partner[i]
        if p < 0 or distances[q] < distances[p] or (distances[q] == distances[p] and labels[q] < labels[p]):
            partner[i] = q
    return partner[partner >= 0]
