"""Lines as points with a direction, one per pixel of length: what the point metric compares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int
from numba import njit

from yolino.geometry import clip_segments
from yolino.metrics.metric import Lines
from yolino.types import Polylines


@dataclass(frozen=True, eq=False)
class Samples:
    """Points on lines, the `(x, y, angle)` of the paper with the angle as a unit vector.

    Attributes:
        points: Position, `(x, y)` in pixels.
        directions: Unit vector along the line there.
        labels: Class index of the line.
        owners: Index of the line.
    """

    points: Float[np.ndarray, "s 2"]
    directions: Float[np.ndarray, "s 2"]
    labels: Int[np.ndarray, " s"]
    owners: Int[np.ndarray, " s"]

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, index: Bool[np.ndarray, " s"] | Int[np.ndarray, " m"] | slice) -> Samples:
        return Samples(self.points[index], self.directions[index], self.labels[index], self.owners[index])

    @property
    def angles(self) -> Float[np.ndarray, " s"]:
        """Direction as an angle in radians, in (-pi, pi], from the x-axis towards the y-axis."""
        return np.asarray(np.arctan2(self.directions[:, 1], self.directions[:, 0]))


def sample_lines(
    lines: Lines,
    size: tuple[int, int],
    *,
    ignore: Sequence[Float[np.ndarray, "v 2"]] = (),
    spacing: float = 1.0,
) -> Samples:
    """Gives evenly spaced points along each line, inside the image and outside the ignored polygons.

    A line is a polyline, or a single segment. With the length L of its part inside the image it has
    `max(1, round(L / spacing))` points in the middle of as many equal stretches, so that points stand for
    length alike whatever the slope, the number of vertices or the cuts. (Rounding up instead makes short
    segments denser than the polyline they cover, which costs 4 % of precision at cells of 16 px.) A line
    without length has no points.

    Args:
        lines: Segments or polylines in pixels.
        size: `(height, width)` of the image. Parts of lines outside it are cut off.
        ignore: Polygons (even-odd rule) in pixels; points inside one are removed.
        spacing: Distance between neighbours in pixels.

    Raises:
        ValueError: A coordinate is not finite, a polygon has less than three corners, `size` or `spacing` is
            not positive.
    """
    _check(lines, size, ignore, spacing)
    pieces, kept = clip_segments(lines.endpoints, size)
    owners = lines.owners[kept] if isinstance(lines, Polylines) else kept
    points, directions, source = _sample(pieces, owners, spacing)
    samples = Samples(points, directions, lines.labels[source], source)
    for polygon in ignore:
        samples = samples[~_inside(samples.points, np.asarray(polygon, dtype=np.float64))]
    return samples


def _check(
    lines: Lines, size: tuple[int, int], ignore: Sequence[Float[np.ndarray, "v 2"]], spacing: float
) -> None:
    if not spacing > 0:
        raise ValueError(f"spacing must be positive (pixels), got {spacing}.")
    if min(size) <= 0:
        raise ValueError(f"size must be a positive (height, width), got {size}.")
    places = lines.vertices if isinstance(lines, Polylines) else lines.endpoints
    if not np.isfinite(places).all():
        raise ValueError("A line has a coordinate that is NaN or infinite: remove or repair that line first.")
    for polygon in ignore:
        if len(polygon) < 3 or not np.isfinite(polygon).all():
            raise ValueError(f"An ignored polygon needs at least 3 finite corners (x, y), got {polygon!r}.")


# The kernels take plain arrays; no_type_check keeps runtime type checkers from wrapping what numba compiles.


@njit(cache=True)
@no_type_check
def _count(length, spacing):
    return max(1, int(length / spacing + 0.5)) if length > 0 else 0


@njit(cache=True)
@no_type_check
def _line_ends(owners, lengths):
    """Gives where each line ends in the pieces, and the length of each line."""
    ends = np.empty(len(owners), np.int64)
    totals = np.zeros(len(owners))
    lines = 0
    for i in range(len(owners)):
        if i > 0 and owners[i] != owners[i - 1]:
            lines += 1
        ends[lines] = i + 1
        totals[lines] += lengths[i]
    return ends[: lines + (len(owners) > 0)], totals


@njit(cache=True)
@no_type_check
def _sample(pieces, owners, spacing):
    """Gives points, unit directions and owners; the pieces of one line stand together."""
    delta = pieces[:, 1] - pieces[:, 0]
    lengths = np.hypot(delta[:, 0], delta[:, 1])
    ends, totals = _line_ends(owners, lengths)
    size = 0
    for line in range(len(ends)):
        size += _count(totals[line], spacing)
    points, directions, source = np.empty((size, 2)), np.empty((size, 2)), np.empty(size, np.int64)
    row = piece = 0
    for line in range(len(ends)):
        count = _count(totals[line], spacing)
        walked, k = 0.0, 0
        while piece < ends[line]:
            length = lengths[piece]
            while k < count and (k + 0.5) * totals[line] / count < walked + length:
                along = ((k + 0.5) * totals[line] / count - walked) / length
                for axis in range(2):
                    points[row, axis] = pieces[piece, 0, axis] + along * delta[piece, axis]
                    directions[row, axis] = delta[piece, axis] / length
                source[row] = owners[piece]
                row += 1
                k += 1
            walked += length
            piece += 1
    return points[:row], directions[:row], source[:row]


@njit(cache=True)
@no_type_check
def _inside(points, polygon):
    inside = np.zeros(len(points), np.bool_)
    for i in range(len(points)):
        x, y = points[i]
        ax, ay = polygon[-1]
        for bx, by in polygon:
            if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
                inside[i] = not inside[i]
            ax, ay = bx, by
    return inside
