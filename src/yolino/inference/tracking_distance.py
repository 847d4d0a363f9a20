"""How far polylines are from each other as wholes, for finding one again in the next frame."""

from __future__ import annotations

from typing import no_type_check

import numpy as np
from jaxtyping import Float

from yolino.compiled import compiled
from yolino.geometry import cumulative_length
from yolino.types import Polylines

SAMPLES = 32
_TINY = 1e-300


def sample_evenly(vertices: Float[np.ndarray, "v 2"], count: int = SAMPLES) -> Float[np.ndarray, "count 2"]:
    """Gives `count` points evenly along a polyline of at least one vertex, both ends included."""
    at = cumulative_length(vertices)
    s = np.linspace(0.0, at[-1], count)
    return np.stack([np.interp(s, at, vertices[:, k]) for k in (0, 1)], axis=1)


def compare_polylines(
    first: Polylines, second: Polylines, reach: float
) -> tuple[Float[np.ndarray, "n m"], Float[np.ndarray, "n m"]]:
    """Gives the symmetric mean distance of each pair of polylines, and how far their directions agree.

    The mean distance of a line to another is that of points evenly along it to their nearest points of the
    other; the symmetric one is the mean of both ways. So a line that became longer at its end is still near
    what it was. The agreement is the mean cosine between a line's direction and that of its nearest point on
    the other: 1 for the same line, -1 for its reverse.

    Args:
        first: n polylines, each of at least one vertex.
        second: m polylines, each of at least one vertex.
        reach: Largest distance of interest; that of pairs farther apart may be given as infinite, and their
            agreement as 0.
    """
    shape = (len(first), len(second))
    distances, agreements = np.full(shape, np.inf), np.zeros(shape)
    if 0 not in shape:
        a, b = (np.stack([sample_evenly(line) for line in lines]) for lines in (first, second))
        sides = [(points, points.min(axis=1), points.max(axis=1)) for points in (a, b)]
        _compare(sides[0], sides[1], float(reach), distances, agreements)
    return distances, agreements


@compiled
@no_type_check
def _compare(first, second, reach, distances, agreements):
    """Fills in the pairs whose bounding boxes, and one of whose ways, are not too far apart."""
    (a, low_a, high_a), (b, low_b, high_b) = first, second
    for i in range(len(a)):
        for j in range(len(b)):
            gap_x = max(low_a[i, 0] - high_b[j, 0], low_b[j, 0] - high_a[i, 0])
            gap_y = max(low_a[i, 1] - high_b[j, 1], low_b[j, 1] - high_a[i, 1])
            if max(gap_x, gap_y) > reach:
                continue
            way, along = _one_way(a[i], b[j])
            if way > 2 * reach:
                continue
            back, against = _one_way(b[j], a[i])
            distances[i, j] = (way + back) / 2
            agreements[i, j] = (along + against) / 2


@compiled
@no_type_check
def _one_way(points, line):
    """Gives the mean distance of points to a line, and the mean cosine of directions there."""
    count, total, cosines = len(points), 0.0, 0.0
    for i in range(count):
        nearest, piece = np.inf, 0
        for k in range(len(line) - 1):
            dx, dy = line[k + 1, 0] - line[k, 0], line[k + 1, 1] - line[k, 1]
            x, y = points[i, 0] - line[k, 0], points[i, 1] - line[k, 1]
            t = (x * dx + y * dy) / max(dx * dx + dy * dy, _TINY)
            t = min(max(t, 0.0), 1.0)
            squared = (x - t * dx) ** 2 + (y - t * dy) ** 2
            if squared < nearest:
                nearest, piece = squared, k
        total += np.sqrt(nearest)
        own = points[min(i + 1, count - 1)] - points[max(i - 1, 0)]
        other = line[piece + 1] - line[piece]
        lengths = np.hypot(own[0], own[1]) * np.hypot(other[0], other[1])
        cosines += (own[0] * other[0] + own[1] * other[1]) / max(lengths, _TINY)
    return total / count, cosines / count


__all__ = ["SAMPLES", "compare_polylines", "sample_evenly"]
