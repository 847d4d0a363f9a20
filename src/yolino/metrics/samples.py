"""Lines as points with a direction, one per pixel of length: what the point metric compares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int

from yolino.compiled import compiled
from yolino.metrics.metric import Lines
from yolino.types import Polylines

# Shorter runs along an axis are none: division by them would overflow.
_LEVEL = 1e-290


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
    ignore: Sequence[Float[np.ndarray, "_ 2"]] = (),
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
    check_lines(lines, size, ignore, spacing)
    vertices, offsets = _vertices(lines)
    pieces, lengths = _clip(vertices, offsets, float(size[1]), float(size[0]))
    samples = Samples(*_sample(pieces, lengths, offsets, np.array(lines.labels), spacing))
    for polygon in ignore:
        samples = samples[~points_inside(samples.points, np.asarray(polygon, dtype=np.float64))]
    return samples


def require_classes(lines: Lines, name: str, classes: Sequence[str]) -> None:
    """Raises ValueError if a label is negative, or if there are classes and it is no index of them.

    Args:
        lines: Lines with labels.
        name: What the message calls them.
        classes: Names of the classes; empty: any number of them.
    """
    low, high = int(lines.labels.min(initial=0)), int(lines.labels.max(initial=0))
    if low < 0 or (classes and high >= len(classes)):
        allowed = f"0 to {len(classes) - 1} ({', '.join(classes)})" if classes else "0 or more"
        raise ValueError(
            f"The {name} has the label {low if low < 0 else high}, but labels must be {allowed}."
        )


def _vertices(lines: Lines) -> tuple[Float[np.ndarray, "v 2"], Int[np.ndarray, " n_plus_1"]]:
    """Gives the vertices of all lines, and where each line begins in them and the last ends.

    Both are copies: views and read-only arrays would have the kernels compiled again.
    """
    if isinstance(lines, Polylines):
        return np.array(lines.vertices, order="C"), np.array(lines.offsets)
    return np.array(lines.endpoints, order="C").reshape(-1, 2), np.arange(len(lines) + 1) * 2


def check_lines(
    lines: Lines, size: tuple[int, int], ignore: Sequence[Float[np.ndarray, "_ 2"]], spacing: float
) -> None:
    """Raises a ValueError for lines, sizes, polygons or a spacing that no metric can use."""
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


@compiled
@no_type_check
def _count(length, spacing):
    return max(1, int(length / spacing + 0.5)) if length > 0 else 0


@compiled
@no_type_check
def _clip_axis(start, delta, limit):
    """Gives where (0 to 1) the way from start by delta enters [0, limit], and where it leaves it."""
    if abs(delta) < _LEVEL:
        return (0.0, 1.0) if 0 <= start <= limit else (1.0, 0.0)
    low, high = -start / delta, (limit - start) / delta
    return max(min(low, high), 0.0), min(max(low, high), 1.0)


@compiled
@no_type_check
def _clip(vertices, offsets, width, height):
    """Gives start and extent of the part inside of the piece that begins at each vertex, and its length.

    The cut of `yolino.geometry.clip_segments`. Where no piece begins or nothing is inside the length is 0.
    """
    pieces, lengths = np.zeros((len(vertices), 4)), np.zeros(len(vertices))
    for line in range(len(offsets) - 1):
        for i in range(offsets[line], offsets[line + 1] - 1):
            x, y = vertices[i, 0], vertices[i, 1]
            end_x, end_y = vertices[i + 1, 0], vertices[i + 1, 1]
            dx, dy = end_x - x, end_y - y
            enter_x, leave_x = _clip_axis(x, dx, width)
            enter_y, leave_y = _clip_axis(y, dy, height)
            enter, leave = max(enter_x, enter_y), min(leave_x, leave_y)
            if enter >= leave:
                continue
            if leave < 1:
                end_x, end_y = x + leave * dx, y + leave * dy
                end_x, end_y = min(max(end_x, 0.0), width), min(max(end_y, 0.0), height)
            if enter > 0:
                x, y = min(max(x + enter * dx, 0.0), width), min(max(y + enter * dy, 0.0), height)
            pieces[i, 0], pieces[i, 1], pieces[i, 2], pieces[i, 3] = x, y, end_x - x, end_y - y
            lengths[i] = np.hypot(end_x - x, end_y - y)
    return pieces, lengths


@compiled
@no_type_check
def _sample(pieces, lengths, offsets, labels, spacing):
    """Gives points, unit directions, labels and owners."""
    totals, size = np.zeros(len(labels)), 0
    for line in range(len(labels)):
        for i in range(offsets[line], offsets[line + 1]):
            totals[line] += lengths[i]
        size += _count(totals[line], spacing)
    points, directions = np.empty((size, 2)), np.empty((size, 2))
    classes, owners = np.empty(size, np.int64), np.empty(size, np.int64)
    row = 0
    for line in range(len(labels)):
        count, walked, k = _count(totals[line], spacing), 0.0, 0
        for i in range(offsets[line], offsets[line + 1]):
            x, y, dx, dy = pieces[i]
            length = lengths[i]
            while k < count and (k + 0.5) * totals[line] / count < walked + length:
                along = ((k + 0.5) * totals[line] / count - walked) / length
                points[row, 0], points[row, 1] = x + along * dx, y + along * dy
                directions[row, 0], directions[row, 1] = dx / length, dy / length
                classes[row], owners[row] = labels[line], line
                row += 1
                k += 1
            walked += length
    return points[:row], directions[:row], classes[:row], owners[:row]


@compiled
@no_type_check
def points_inside(points, polygon):
    """Gives which of the points `(n, 2)` lie inside the polygon `(v, 2)`, by the even-odd rule."""
    inside = np.zeros(len(points), np.bool_)
    for i in range(len(points)):
        x, y = points[i]
        ax, ay = polygon[-1]
        for bx, by in polygon:
            if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
                inside[i] = not inside[i]
            ax, ay = bx, by
    return inside
