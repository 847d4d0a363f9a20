"""A pinhole camera over a curved road: where its points appear, and which of them each image row shows."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float

from yolino.types import Floats

NEAR = 1.0
"""Distance in meters of the nearest road point that is tabulated."""


@dataclass(frozen=True, eq=False)
class View:
    """A camera over a road, both without roll, which the scene adds at the end by turning the picture.

    Road coordinates are meters: x to the right from the axis of the own lane, z ahead, y up from the surface.

    Attributes:
        size: Height and width of the canvas in pixels.
        scale: Pixels of the canvas per pixel of a camera that is 1280 pixels wide.
        focal: Focal length in pixels.
        vanishing: Where the straight and level road ahead would vanish, `(x, y)` in pixels.
        height: Height of the camera over the road in meters.
        lateral: How far the camera is right of the axis of its lane, in meters.
        curvature: Curvature of the road in 1/m, positive to the right.
        twist: Change of the curvature per meter of road (the clothoid's parameter).
        bend: Vertical curvature in 1/m: positive in a sag, negative on a crest.
        reach: Distance in meters at which the road ends for the eye.
    """

    size: tuple[int, int]
    scale: float
    focal: float
    vanishing: tuple[float, float]
    height: float
    lateral: float = 0.0
    curvature: float = 0.0
    twist: float = 0.0
    bend: float = 0.0
    reach: float = 300.0
    _table: tuple[Floats, Floats] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        z = 1 / np.linspace(1 / self.reach, 1 / NEAR, 1200)[::-1]
        row = self.vanishing[1] + self.focal * (self.height - self.elevation(z)) / z
        hidden = np.flatnonzero(np.diff(row) >= 0)
        stop = int(hidden[0]) + 1 if len(hidden) else len(z)
        object.__setattr__(self, "_table", (row[:stop][::-1], 1 / z[:stop][::-1]))

    @property
    def top(self) -> float:
        """The image row, in pixels, at which the road ends for the eye."""
        return float(self._table[0][0])

    @property
    def farthest(self) -> float:
        """Distance of the farthest road point in sight, in meters."""
        return float(1 / self._table[1][0])

    def elevation(self, z: Floats) -> Floats:
        """Gives the height of the road surface at distance `z` over the plane below the camera, in meters."""
        return self.bend * z**2 / 2

    def center(self, z: Floats) -> Floats:
        """Gives where the road axis runs at distance `z`, in meters to the right of the camera."""
        return self.curvature * z**2 / 2 + self.twist * z**3 / 6 - self.lateral

    def distance(self, row: Floats) -> Floats:
        """Gives the distance in meters of the road that an image row (pixels) shows; the ends are clamped."""
        return np.asarray(1 / np.interp(row, *self._table))

    def column(self, x: Floats | float, z: Floats) -> Floats:
        """Gives the image column in pixels of the road point `(x, z)`."""
        return np.asarray(self.vanishing[0] + self.focal * (self.center(z) + x) / z)

    def row(self, z: Floats, y: Floats | float = 0.0) -> Floats:
        """Gives the image row in pixels of a point `y` meters over the road at distance `z`."""
        return np.asarray(self.vanishing[1] + self.focal * (self.height - self.elevation(z) - y) / z)

    def project(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
        """Gives the image points of road points `(x, y, z)`; points behind `NEAR` are moved to it."""
        z = np.maximum(points[:, 2], NEAR)
        return np.stack([self.column(points[:, 0], z), self.row(z, points[:, 1])], axis=1)

    @cached_property
    def ground_rows(self) -> tuple[int, Floats]:
        """The first canvas row that shows road, and the distances in meters at the borders of all rows."""
        first = int(np.clip(np.ceil(self.top), 0, self.size[0]))
        return first, self.distance(np.arange(first, self.size[0] + 1, dtype=np.float64))


def sample_view(rng: np.random.Generator, size: tuple[int, int], margin: int) -> View:
    """Gives a random view of an image of `size` (height, width) with a margin in pixels at all sides.

    The camera is that of a picture of 720 x 1280, scaled to the width: another aspect ratio loses or gains
    rows at the top.
    """
    h, w = size
    scale = w / 1280
    x = margin + scale * rng.normal(648, 38)
    y = margin + h - scale * (720 - rng.normal(240, 14))
    curvature, twist = _sample_curve(rng)
    bend = rng.normal(0, 6e-5) if rng.random() < 0.6 else 0.0
    lateral = rng.normal(0, 0.3) if rng.random() < 0.85 else rng.uniform(-1.8, 1.8)
    return View(
        size=(h + 2 * margin, w + 2 * margin),
        scale=scale,
        focal=scale * rng.uniform(1000, 1800),
        vanishing=(x, y),
        height=rng.uniform(1.35, 1.95),
        lateral=lateral,
        curvature=curvature,
        twist=twist,
        bend=bend,
        reach=rng.uniform(180, 420),
    )


def _sample_curve(rng: np.random.Generator) -> tuple[float, float]:
    """Gives curvature and its change: nearly straight half of the time, else down to a radius of 300 m."""
    if rng.random() < 0.45:
        return rng.normal(0, 1e-4), 0.0
    curvature = rng.choice([-1, 1]) * rng.uniform(2e-4, 3.3e-3)
    twist = rng.normal(0, 1e-5) if rng.random() < 0.6 else 0.0
    return float(curvature), float(twist)
