"""Generic drawn scenes: curves, dashes, arrows, branches, loops and two-way lines, and their polylines."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float

from yolino.datasets.texture import crop
from yolino.types import Floats, Polylines, Sample

CLASSES = ("line", "dash", "arrow", "two-way")
"""Looks: a line is bright at its left side and dark at its right one, so is a dash in other colors; an arrow
carries chevrons that point ahead; a two-way line looks alike from both ends and is two opposite polylines."""

_LINE, _DASH, _ARROW, _TWO_WAY = range(4)
_LEFT = ((250, 246, 225), (120, 220, 250), (225, 40, 190), (245, 245, 245))
_RIGHT = ((40, 10, 8), (8, 20, 110), (225, 40, 190), (245, 245, 245))
_MIDDLE = ((200, 120, 30), (60, 120, 200), (225, 40, 190), (20, 130, 40))


class Shape(NamedTuple):
    """One polyline to draw: its vertices in pixels, its class index, its width in pixels."""

    vertices: Float[np.ndarray, "v 2"]
    label: int
    width: float


def shapes_scene(
    rng: np.random.Generator,
    size: tuple[int, int] = (320, 640),
    *,
    kinds: Sequence[str] | None = None,
    name: str = "shapes",
) -> Sample:
    """Gives a random drawing and its polylines.

    Args:
        rng: Source of all randomness.
        size: Height and width in pixels.
        kinds: What to draw, keys of `KINDS` in drawing order; by default two to six random ones.
        name: Name of the sample.

    Raises:
        ValueError: If the size is not positive or a kind is unknown.
    """
    if min(size) < 1:
        raise ValueError(
            f"A scene of size {size} was asked for, but height and width must be at least 1 pixel."
        )
    if kinds is None:
        count = int(rng.integers(1, 3 if min(size) < 64 else 7))
        kinds = [str(kind) for kind in rng.choice(list(KINDS), count)]
    unknown = [kind for kind in kinds if kind not in KINDS]
    if unknown:
        raise ValueError(
            f"kinds has {unknown[0]!r}, but only {', '.join(KINDS)} are known; choose among them."
        )
    image = _background(rng, size)
    shapes = [shape for kind in kinds for shape in KINDS[kind](rng, size)]
    for shape in shapes:
        _draw(image, shape)
    image = np.clip(image + rng.uniform(0, 6) * crop(0.0, size, rng)[..., None], 0, 255).astype(np.uint8)
    labels = np.array([shape.label for shape in shapes], np.int64)
    return Sample(name, image, Polylines.from_list([shape.vertices for shape in shapes], labels=labels))


def _width(rng: np.random.Generator, size: tuple[int, int]) -> float:
    return float(np.clip(min(size) * rng.uniform(0.012, 0.025), 1.5, 12))


def _inside(points: Float[np.ndarray, "v 2"], size: tuple[int, int]) -> Float[np.ndarray, "w 2"]:
    """Gives the polyline up to where it first leaves the image; the first vertex must be inside."""
    limit = np.array([size[1], size[0]], dtype=np.float64)
    out = np.flatnonzero(((points < 0) | (points > limit)).any(axis=1))
    if len(out) == 0:
        return points
    a, b = points[out[0] - 1], points[out[0]]
    step = np.where(b == a, 1e-12, b - a)
    cut = a + (b - a) * np.maximum(-a / step, (limit - a) / step).min()
    return np.asarray(np.concatenate([points[: out[0]], np.clip(cut, 0, limit)[None]]))


def _curve(
    rng: np.random.Generator, size: tuple[int, int], start: Floats | None = None, heading: float | None = None
) -> Float[np.ndarray, "v 2"]:
    """Gives a smooth curve from `start`, at first towards `heading` (radians), cut at the image border."""
    reach = float(np.hypot(*size))
    if start is None:
        start = rng.uniform(0.1, 0.9, 2) * (size[1], size[0])
    if heading is None:
        inward = np.array([size[1], size[0]]) / 2 - start
        heading = float(np.arctan2(inward[1], inward[0]) + rng.uniform(-1.6, 1.6))
    count = 64
    step = reach * rng.uniform(0.25, 0.9) / count
    bends = np.interp(np.linspace(0, 3, count), np.arange(4), rng.normal(0, 2.0, 4)) / count
    angle = heading + np.cumsum(bends)
    path = np.cumsum(np.stack([np.cos(angle), np.sin(angle)], axis=1) * step, axis=0)
    points = _inside(np.concatenate([start[None], start + path]), size)
    keep = max(1, int(4 / step))
    return np.asarray(points[np.unique(np.r_[0 : len(points) : keep, len(points) - 1])])


def _line(rng: np.random.Generator, size: tuple[int, int]) -> list[Shape]:
    return [Shape(_curve(rng, size), _LINE, _width(rng, size))]


def _arrow(rng: np.random.Generator, size: tuple[int, int]) -> list[Shape]:
    return [Shape(_curve(rng, size), _ARROW, _width(rng, size))]


def _two_way(rng: np.random.Generator, size: tuple[int, int]) -> list[Shape]:
    points, width = _curve(rng, size), _width(rng, size)
    return [Shape(points, _TWO_WAY, width), Shape(points[::-1].copy(), _TWO_WAY, width)]


def _dashes(rng: np.random.Generator, size: tuple[int, int]) -> list[Shape]:
    """Gives a dashed curve, each dash a polyline of its own."""
    points, width = _curve(rng, size), _width(rng, size)
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    on = max(rng.uniform(0.04, 0.1) * min(size), 4.0)
    period = on * rng.uniform(1.8, 2.6)
    dashes = []
    for start in np.arange(0.0, length[-1] - on / 2, period):
        at = np.linspace(start, min(start + on, length[-1]), 4)
        dash = np.stack([np.interp(at, length, points[:, k]) for k in (0, 1)], axis=1)
        dashes.append(Shape(dash, _DASH, width))
    return dashes


def _branch(rng: np.random.Generator, size: tuple[int, int]) -> list[Shape]:
    """Gives a line that splits into two or three, or several that join: all share one vertex exactly."""
    root = rng.uniform(0.25, 0.75, 2) * (size[1], size[0])
    heading = rng.uniform(-np.pi, np.pi)
    width = _width(rng, size)
    label = int(rng.choice([_LINE, _ARROW]))
    trunk = _curve(rng, size, root, heading + np.pi)
    arms = [_curve(rng, size, root, heading + turn) for turn in (-0.45, 0.45, 0.0)[: rng.integers(2, 4)]]
    if rng.random() < 0.5:
        lines = [trunk[::-1].copy(), *arms]
    else:
        lines = [trunk, *(arm[::-1].copy() for arm in arms)]
    return [Shape(line, label, width) for line in lines]


def _loop(rng: np.random.Generator, size: tuple[int, int]) -> list[Shape]:
    """Gives a closed line: its last vertex is its first."""
    middle = rng.uniform(0.3, 0.7, 2) * (size[1], size[0])
    radius = rng.uniform(0.12, 0.28) * min(size) * rng.uniform(0.7, 1, 2)
    angle = np.linspace(0, 2 * np.pi, 49)[:-1] + rng.uniform(0, 6)
    wave = 1 + 0.12 * np.cos(rng.integers(2, 4) * angle + rng.uniform(0, 6))
    points = middle + radius * (wave[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    points = points if rng.random() < 0.5 else points[::-1]
    closed = np.concatenate([points, points[:1]])
    return [Shape(closed, int(rng.choice([_LINE, _ARROW])), _width(rng, size))]


def _crossing(rng: np.random.Generator, size: tuple[int, int]) -> list[Shape]:
    """Gives two lines that cross near the middle of the image."""
    middle = rng.uniform(0.35, 0.65, 2) * (size[1], size[0])
    heading = rng.uniform(-np.pi, np.pi)
    shapes = []
    for turn in (0.0, rng.uniform(0.6, np.pi - 0.6)):
        back, ahead = (_curve(rng, size, middle, heading + turn + side) for side in (np.pi, 0.0))
        line = np.concatenate([back[:0:-1], ahead])
        shapes.append(Shape(line, int(rng.choice([_LINE, _ARROW])), _width(rng, size)))
    return shapes


KINDS: dict[str, Callable[[np.random.Generator, tuple[int, int]], list[Shape]]] = {
    "line": _line,
    "dashes": _dashes,
    "arrow": _arrow,
    "two-way": _two_way,
    "branch": _branch,
    "loop": _loop,
    "crossing": _crossing,
}
"""What a scene can hold: each function gives the polylines of one thing."""


def _background(rng: np.random.Generator, size: tuple[int, int]) -> Float[np.ndarray, "h w 3"]:
    """Gives a colored, unevenly lit and textured background with a few spots."""
    h, w = size
    color = rng.uniform(50, 190) + rng.normal(0, 22, 3)
    slope = rng.normal(0, 25, 2)
    light = np.linspace(-1, 1, h)[:, None] * slope[0] + np.linspace(-1, 1, w) * slope[1]
    light = light + rng.uniform(0, 14) * crop(float(rng.choice([0.0, 0.8, 1.6])), size, rng)
    image = np.clip(color + light[..., None], 0, 255).astype(np.uint8)
    for _ in range(rng.poisson(2.5)):
        middle = rng.uniform(0, 1, 2) * (w, h)
        axes = rng.uniform(0.02, 0.2, 2) * min(size) + 1
        spot = np.clip(color + rng.normal(0, 35, 3), 0, 255)
        box = (tuple(middle), tuple(2 * axes), float(rng.uniform(0, 180)))
        cv2.ellipse(image, box, tuple(spot), -1, cv2.LINE_AA)
    return np.asarray(image, dtype=np.float32)


def _stroke(image: np.ndarray, points: Floats, color: tuple[int, ...], width: float) -> None:
    fixed = np.round((points - 0.5) * 16).astype(np.int32)
    cv2.polylines(image, [fixed], False, color, max(1, round(width)), cv2.LINE_AA, 4)


def _normals(points: Float[np.ndarray, "v 2"]) -> Float[np.ndarray, "v 2"]:
    """Gives the unit normals to the left (seen in the direction of the line) at the vertices."""
    tangent = np.gradient(points, axis=0)
    tangent /= np.maximum(np.hypot(tangent[:, 0], tangent[:, 1]), 1e-9)[:, None]
    return np.asarray(np.stack([tangent[:, 1], -tangent[:, 0]], axis=1))


def _draw(image: np.ndarray, shape: Shape) -> None:
    points, label, width = shape
    canvas = np.clip(image, 0, 255).astype(np.uint8)
    side = _normals(points) * (width * 0.4)
    thin = width / 2.5
    _stroke(canvas, points, _MIDDLE[label], width if label != _ARROW else thin)
    if label != _ARROW:
        _stroke(canvas, points + side, _LEFT[label], thin)
        _stroke(canvas, points - side, _RIGHT[label], thin)
    else:
        _chevrons(canvas, points, width)
    image[:] = canvas


def _chevrons(canvas: np.ndarray, points: Floats, width: float) -> None:
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    ahead = _normals(points) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    for at in np.arange(width, length[-1], 3.5 * width):
        tip, along = (np.array([np.interp(at, length, v[:, k]) for k in (0, 1)]) for v in (points, ahead))
        across = np.array([along[1], -along[0]])
        barbs = tip - along * width, across * width
        _stroke(canvas, np.stack([barbs[0] + barbs[1], tip, barbs[0] - barbs[1]]), _MIDDLE[_ARROW], width / 3)


__all__ = ["CLASSES", "KINDS", "Shape", "shapes_scene"]
