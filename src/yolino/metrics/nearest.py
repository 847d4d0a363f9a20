"""The nearest sample of a similar direction: a compiled search over square bins.

Bins are searched ring by ring around the query until no nearer sample can come, so the time is linear in the
number of samples as long as lines are lines. Memory is linear in the number of samples whatever the image
size.
"""

from __future__ import annotations

from typing import no_type_check

import numpy as np
from jaxtyping import Float, Int
from numba import njit

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
# A query is (x, y, direction x, direction y, least cosine, directed).


@njit(cache=True)
@no_type_check
def _to_bins(points, side):
    """Gives the bins (origin, side, rows, columns, where each begins) and the points in the bins' order."""
    x0, y0 = points[0]
    x1, y1 = points[0]
    for x, y in points:
        x0, y0, x1, y1 = min(x0, x), min(y0, y), max(x1, x), max(y1, y)
    most = 4 * len(points) + 1024
    side = max(side, np.sqrt((x1 - x0) * (y1 - y0) / most), (x1 - x0) / most, (y1 - y0) / most)
    rows, cols = int((y1 - y0) / side) + 1, int((x1 - x0) / side) + 1
    homes = np.empty(len(points), np.int64)
    first = np.zeros(rows * cols + 1, np.int64)
    for i in range(len(points)):
        homes[i] = int((points[i, 1] - y0) / side) * cols + int((points[i, 0] - x0) / side)
        first[homes[i] + 1] += 1
    for b in range(rows * cols):
        first[b + 1] += first[b]
    members = np.empty(len(points), np.int64)
    free = first[:-1].copy()
    for i in range(len(points)):
        members[free[homes[i]]] = i
        free[homes[i]] += 1
    return (x0, y0, side, rows, cols, first), members


@njit(cache=True)
@no_type_check
def _precedes(i, best, query, samples):
    """Tells whether sample i goes before the equally close sample best."""
    points, _, labels = samples
    ux, uy = query[2], query[3]
    dx, dy = points[i, 0] - points[best, 0], points[i, 1] - points[best, 1]
    ahead, right = dx * ux + dy * uy, dy * ux - dx * uy
    if abs(ahead) > _SAME:
        return ahead > 0
    if abs(right) > _SAME:
        return right > 0
    if labels[i] != labels[best]:
        return labels[i] < labels[best]
    return i < best


@njit(cache=True)
@no_type_check
def _scan(first, end, query, samples, nearest):
    """Gives the best sample and its squared distance after looking at some more samples."""
    x, y, ux, uy, cosine, directed = query
    points, directions, _ = samples
    best, squared = nearest
    for i in range(first, end):
        dx, dy = points[i, 0] - x, points[i, 1] - y
        here = dx * dx + dy * dy
        if here > squared + _SAME_SQUARED:
            continue
        dot = directions[i, 0] * ux + directions[i, 1] * uy
        if (dot if directed else abs(dot)) < cosine:
            continue
        if best < 0 or here < squared - _SAME_SQUARED or _precedes(i, best, query, samples):
            best = i
        squared = min(squared, here)
    return best, squared


@njit(cache=True)
@no_type_check
def _search(query, samples, bins, radius):
    """Gives the closest sample and its squared distance, searching rings of bins from the inside out."""
    x0, y0, side, rows, cols, first = bins
    x, y = query[0] - x0, query[1] - y0
    col, row = int(np.floor(x / side)), int(np.floor(y / side))
    x, y = x - col * side, y - row * side
    inset = min(x, side - x, y, side - y)
    nearest = -1, radius * radius
    ring = max(0, -col, col - cols + 1, -row, row - rows + 1)
    last = max(col, cols - 1 - col, row, rows - 1 - row)
    while ring <= last and (ring == 0 or ((ring - 1) * side + inset) ** 2 <= nearest[1] + _SAME_SQUARED):
        left, right = max(col - ring, 0), min(col + ring, cols - 1)
        for r in range(max(row - ring, 0), min(row + ring, rows - 1) + 1):
            base = r * cols
            if abs(r - row) == ring:
                nearest = _scan(first[base + left], first[base + right + 1], query, samples, nearest)
                continue
            for c in (col - ring, col + ring):
                if 0 <= c < cols:
                    nearest = _scan(first[base + c], first[base + c + 1], query, samples, nearest)
        ring += 1
    return nearest


@njit(cache=True)
@no_type_check
def _nearest(queries, samples, radius, cosine, directed):
    points, directions = queries
    nearest, distances = np.full(len(points), -1), np.full(len(points), np.inf)
    if len(samples[0]) == 0:
        return nearest, distances
    bins, order = _to_bins(samples[0], min(max(radius / 4, _SMALLEST_BIN), _BIN))
    samples = (samples[0][order], samples[1][order], samples[2][order])
    for q in range(len(points)):
        ux, uy = directions[q]
        if not directed and (ux < 0 or (ux == 0 and uy < 0)):
            ux, uy = -ux, -uy
        query = (points[q, 0], points[q, 1], ux, uy, cosine, directed)
        best, squared = _search(query, samples, bins, radius)
        if best >= 0:
            nearest[q], distances[q] = order[best], np.sqrt(squared)
    return nearest, distances


@njit(cache=True)
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
