"""Moving a polyline sideways towards where it is expected, without a change of its ends along itself."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from yolino.geometry import cumulative_length
from yolino.inference.tracking_distance import SAMPLES

_EDGE = 1e-9


class Offsets(NamedTuple):
    """The ways from a polyline to the one that is expected.

    Attributes:
        vertices: The way of each vertex, in pixels; where the expected line does not reach, that of the
            nearest part where it does.
        mean: Their mean over the length that both lines share; 0 where they share none.
    """

    vertices: Float[np.ndarray, "v 2"]
    mean: Float[np.ndarray, "xy=2"]


def offsets_to(vertices: Float[np.ndarray, "v 2"], expected: Float[np.ndarray, "w 2"]) -> Offsets:
    """Gives the ways from a polyline to the nearest points of another one that runs the same way.

    Parts of the other line that run the opposite way count only where no part runs along. Points beyond the
    ends of the other line, and where only another part of it is near, take the way of the nearest point that
    has one.

    Args:
        vertices: The polyline, of at least one vertex.
        expected: The other one, of at least one vertex.
    """
    at = cumulative_length(vertices)
    s = np.union1d(np.linspace(0.0, at[-1], SAMPLES), at)
    points = np.stack([np.interp(s, at, vertices[:, k]) for k in (0, 1)], axis=1)
    ways, inside = _project(points, expected)
    # Where a line grew, the nearest part of the expected one may be another turn of a spiral. From there, the
    # nearest point of this line is not where the way came from: the way back is much shorter.
    back, _ = _project(points + ways, vertices)
    inside &= np.hypot(back[:, 0], back[:, 1]) >= np.hypot(ways[:, 0], ways[:, 1]) / 2
    if not inside.any():
        return Offsets(np.zeros_like(vertices), np.zeros(2))
    s, ways = s[inside], ways[inside]
    along = [np.interp(at, s, ways[:, k]) for k in (0, 1)]
    if s[-1] == s[0]:
        return Offsets(np.stack(along, axis=1), ways.mean(axis=0))
    mean = np.trapezoid(ways, s, axis=0) / (s[-1] - s[0])
    return Offsets(np.stack(along, axis=1), np.asarray(mean))


def _project(
    points: Float[np.ndarray, "p 2"], line: Float[np.ndarray, "w 2"]
) -> tuple[Float[np.ndarray, "p 2"], Bool[np.ndarray, " p"]]:
    """Gives the way of each point to the nearest one of the line, and whether that is not beyond its ends."""
    if len(points) < 2 or len(line) < 2:
        return line[:1] - points, np.zeros(len(points), np.bool_)
    (x, y), (dx, dy) = (points[:, None] - line[:-1]).transpose(2, 0, 1), np.diff(line, axis=0).T
    t = (x * dx + y * dy) / np.maximum(dx * dx + dy * dy, np.finfo(np.float64).tiny)
    held = np.clip(t, 0.0, 1.0)
    x, y = held * dx - x, held * dy - y
    headings = np.gradient(points, axis=0) @ np.stack([dx, dy])
    against = (headings <= 0) & (headings > 0).any(axis=1, keepdims=True)
    nearest = np.where(against, np.inf, x * x + y * y).argmin(axis=1)
    rows = np.arange(len(points))
    best = t[rows, nearest]
    before = (nearest == 0) & (best < -_EDGE)
    beyond = (nearest == len(dx) - 1) & (best > 1 + _EDGE)
    return np.stack([x[rows, nearest], y[rows, nearest]], axis=1), ~(before | beyond)


__all__ = ["Offsets", "offsets_to"]
