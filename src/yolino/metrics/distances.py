"""How far two curves are apart: Chamfer and discrete Frechet distance of evenly spaced points.

Both compare points with points, as the sources do (VectorMapNet and MapTR: 100 points on either side). The
distance of two lines that cover each other is therefore not 0 but less than the spacing of the points.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Bool, Float

from yolino.compiled import compiled
from yolino.geometry import clip_polylines, cumulative_length
from yolino.metrics.metric import Lines
from yolino.metrics.samples import check_lines, points_inside
from yolino.types import Polylines

SAMPLES = 100  # VectorMapNet, MapTR
# Pixels: what is left of a line after cutting it at the image's border is no line below this length.
SHORTEST = 1.0
_ROUNDING = 1 + 1e-9  # a pair exactly at the limit is not beyond it


class VisibleLines(NamedTuple):
    """Lines as evenly spaced points, in an order that does not depend on the order they were given in.

    Attributes:
        lines: The points of each line as its vertices, in pixels; the highest score first.
        optional: Which lines lie in ignored regions with more than half of their points.
    """

    lines: Polylines
    optional: Bool[np.ndarray, " n"]


def visible_lines(
    lines: Lines,
    size: tuple[int, int],
    ignore: Sequence[Float[np.ndarray, "_ 2"]] = (),
    *,
    samples: int = SAMPLES,
) -> VisibleLines:
    """Gives the lines as points inside the image and outside the ignored polygons.

    Lines are cut at the image's border; one that leaves the image and returns becomes several. Of each part
    the points outside the polygons are left. Parts shorter than a pixel and parts without points are dropped.

    Args:
        lines: Segments or polylines in pixels.
        size: `(height, width)` of the image.
        ignore: Polygons (even-odd rule) in pixels; points inside one are removed.
        samples: Number of points on each part before those inside polygons are removed.

    Raises:
        ValueError: A coordinate or a score is not finite, a polygon has less than three corners, `size` is
            not positive, or `samples` is less than 2.
    """
    check_lines(lines, size, ignore, 1.0)
    if not np.isfinite(lines.scores).all():
        raise ValueError("A line has a score that is NaN or infinite: give it a number.")
    if not isinstance(lines, Polylines):
        offsets = 2 * np.arange(len(lines) + 1)
        lines = Polylines(lines.endpoints.reshape(-1, 2), offsets, lines.scores, lines.labels)
    lines = clip_polylines(lines, size)
    sampled = sample_polylines(lines[lines.lengths >= SHORTEST], samples)
    outside = np.ones(len(sampled.vertices), np.bool_)
    for polygon in ignore:
        outside &= ~points_inside(sampled.vertices, np.asarray(polygon, dtype=np.float64))
    left = outside.reshape(-1, samples).sum(axis=1)
    offsets = np.concatenate([[0], np.cumsum(left)])
    lines = Polylines(sampled.vertices[outside], offsets, sampled.scores, sampled.labels)
    points = [vertices.tobytes() for vertices in lines]
    order = np.array(sorted(np.flatnonzero(left), key=lambda i: (-lines.scores[i], points[i])), np.int64)
    return VisibleLines(lines[order], (2 * left < samples)[order])


def sample_polylines(polylines: Polylines, samples: int = SAMPLES) -> Polylines:
    """Gives the same polylines with `samples` vertices each, evenly spaced, both ends included.

    A polyline without length becomes as many points at its place.

    Args:
        polylines: Polylines with at least one vertex each.
        samples: Number of points on each.

    Raises:
        ValueError: `samples` is less than 2, or a polyline has no vertex.
    """
    if samples < 2:
        raise ValueError(f"samples must be at least 2 (both ends of a line), got {samples}.")
    points = np.empty((len(polylines), samples, 2))
    for row, vertices in zip(points, polylines, strict=True):
        if len(vertices) == 0:
            raise ValueError("A polyline has no vertices: leave it out.")
        along = cumulative_length(vertices)
        at = np.linspace(0.0, along[-1], samples)
        row[:, 0], row[:, 1] = np.interp(at, along, vertices[:, 0]), np.interp(at, along, vertices[:, 1])
    offsets = np.arange(len(polylines) + 1) * samples
    return Polylines(points.reshape(-1, 2), offsets, polylines.scores, polylines.labels)


def chamfer(a: Float[np.ndarray, "v 2"], b: Float[np.ndarray, "w 2"], *, samples: int = SAMPLES) -> float:
    """Gives the Chamfer distance of two polylines (VectorMapNet, MapTR).

    The mean distance from the points on `a` to their nearest point on `b`, and the same from `b` to `a`; the
    mean of the two. It has no direction: reversing a line leaves it alone.

    Args:
        a: Vertices of one polyline.
        b: Vertices of the other, in the same unit.
        samples: Number of evenly spaced points on each, both ends included.

    Raises:
        ValueError: `samples` is less than 2, or a polyline has no vertex.
    """
    pair = [sample_polylines(Polylines.from_list([vertices]), samples) for vertices in (a, b)]
    return float(chamfer_distances(*pair)[0, 0])


def frechet(
    a: Float[np.ndarray, "v 2"],
    b: Float[np.ndarray, "w 2"],
    *,
    directed: bool = True,
    samples: int = SAMPLES,
) -> float:
    """Gives the discrete Frechet distance of two polylines (Eiter and Mannila 1994; OpenLane-V2).

    Two walkers go along the points of `a` and of `b`, never back, one or both a point further at each step:
    the longest distance between them, on the walk on which it is shortest.

    Args:
        a: Vertices of one polyline.
        b: Vertices of the other, in the same unit.
        directed: Whether both are walked from start to end; else the less of this and of `b` reversed.
        samples: Number of evenly spaced points on each, both ends included.

    Raises:
        ValueError: `samples` is less than 2, or a polyline has no vertex.
    """
    first, second = (sample_polylines(Polylines.from_list([vertices]), samples) for vertices in (a, b))
    return float(frechet_distances(first, second, directed=directed)[0, 0])


def chamfer_distances(a: Polylines, b: Polylines, *, limit: float = math.inf) -> Float[np.ndarray, "n m"]:
    """Gives the Chamfer distance of each of `a` to each of `b`, over their vertices as they are.

    Args:
        a: Lines as evenly spaced points (`sample_polylines`), each at least one.
        b: Lines as evenly spaced points, in the same unit.
        limit: Pairs that are certainly farther apart than this are infinitely far.
    """
    return np.asarray(_chamfer((a.vertices, a.offsets), (b.vertices, b.offsets), _near(a, b, limit)))


def frechet_distances(
    a: Polylines, b: Polylines, *, directed: bool = True, limit: float = math.inf
) -> Float[np.ndarray, "n m"]:
    """Gives the discrete Frechet distance of each of `a` to each of `b`, over their vertices as they are.

    Args:
        a: Lines as evenly spaced points (`sample_polylines`), each at least one.
        b: Lines as evenly spaced points, in the same unit.
        directed: Whether direction matters; else the less of this and of the other line reversed.
        limit: Pairs that are certainly farther apart than this are infinitely far.
    """
    near = _near(a, b, limit)
    walker, other = (a.vertices, a.offsets), (b.vertices, b.offsets)
    forward = np.asarray(_frechet(walker, other, near, limit))
    if directed:
        return forward
    # Reversing all points at once also reverses the order of the lines.
    other = (b.vertices[::-1].copy(), b.offsets[-1] - b.offsets[::-1])
    backward = np.asarray(_frechet(walker, other, near[:, ::-1].copy(), limit))
    return np.asarray(np.minimum(forward, backward[:, ::-1]))


def _near(a: Polylines, b: Polylines, limit: float) -> Bool[np.ndarray, "n m"]:
    """Tells which pairs have boxes at most `limit` apart: both distances are at least that of the boxes."""
    if not math.isfinite(limit) or len(a) == 0 or len(b) == 0:
        return np.ones((len(a), len(b)), np.bool_)
    low_a, high_a = (each.reduceat(a.vertices, a.offsets[:-1]) for each in (np.minimum, np.maximum))
    low_b, high_b = (each.reduceat(b.vertices, b.offsets[:-1]) for each in (np.minimum, np.maximum))
    gap = np.maximum(np.maximum(low_a[:, None] - high_b, low_b - high_a[:, None]), 0.0)
    return np.asarray(np.hypot(gap[..., 0], gap[..., 1]) <= limit * _ROUNDING)


# The kernels take plain arrays; no_type_check keeps runtime type checkers from wrapping what numba compiles.


@compiled
@no_type_check
def _chamfer(lines, others, near):
    a, a_offsets = lines
    b, b_offsets = others
    distances = np.full(near.shape, np.inf)
    for row in range(near.shape[0]):
        for column in range(near.shape[1]):
            if not near[row, column]:
                continue
            first, last = a_offsets[row], a_offsets[row + 1]
            start, stop = b_offsets[column], b_offsets[column + 1]
            from_b = np.full(stop - start, np.inf)
            there = 0.0
            for i in range(first, last):
                from_a = np.inf
                for j in range(start, stop):
                    dx, dy = a[i, 0] - b[j, 0], a[i, 1] - b[j, 1]
                    squared = dx * dx + dy * dy
                    from_a = min(from_a, squared)
                    from_b[j - start] = min(from_b[j - start], squared)
                there += np.sqrt(from_a)
            back = 0.0
            for squared in from_b:
                back += np.sqrt(squared)
            distances[row, column] = (there / (last - first) + back / (stop - start)) / 2
    return distances


@compiled
@no_type_check
def _frechet(lines, others, near, limit):
    a, a_offsets = lines
    b, b_offsets = others
    distances = np.full(near.shape, np.inf)
    for row in range(near.shape[0]):
        for column in range(near.shape[1]):
            if near[row, column]:
                reach = _walk(
                    a[a_offsets[row] : a_offsets[row + 1]],
                    b[b_offsets[column] : b_offsets[column + 1]],
                    limit * limit * _ROUNDING,
                )
                distances[row, column] = np.sqrt(reach)
    return distances


@compiled
@no_type_check
def _walk(a, b, limit):
    """Gives the squared discrete Frechet distance, infinite where every walk exceeds the squared limit."""
    reach = np.empty(len(b))  # of the walks that end at the current point of a and at each point of b
    for i in range(len(a)):
        before = np.inf  # of the walks to the previous points of both
        least = np.inf
        for j in range(len(b)):
            dx, dy = a[i, 0] - b[j, 0], a[i, 1] - b[j, 1]
            if i == 0:
                shortest = reach[j - 1] if j > 0 else 0.0
            elif j == 0:
                shortest = reach[0]
            else:
                shortest = min(before, reach[j], reach[j - 1])
            before = reach[j] if i > 0 else np.inf
            reach[j] = max(shortest, dx * dx + dy * dy)
            least = min(least, reach[j])
        if least > limit:
            return np.inf
    return reach[-1]


__all__ = [
    "SAMPLES",
    "SHORTEST",
    "VisibleLines",
    "chamfer",
    "chamfer_distances",
    "frechet",
    "frechet_distances",
    "sample_polylines",
    "visible_lines",
]
