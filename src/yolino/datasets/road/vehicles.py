"""Pictures of vehicles, drawn once per process: the rear and the side of cars, pickups, vans and trucks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from yolino.datasets.road.drawing import Number
from yolino.types import Floats

Sprite = NDArray[np.uint8]
"""Red, green, blue (times alpha) and alpha."""

SIDE = 160
"""Pixels of a sprite's longer side."""

PAINTS = (
    (16, 16, 18),
    (24, 26, 30),
    (40, 42, 46),
    (205, 206, 204),
    (165, 168, 170),
    (96, 100, 104),
    (70, 16, 16),
    (24, 34, 66),
    (92, 84, 70),
)
"""Colors of vehicles, the first ones the most frequent ones."""


@dataclass(frozen=True)
class Body:
    """The shape of a kind of vehicle, in meters, and shares of the height.

    Attributes:
        width: Width.
        height: Height.
        length: Length.
        waist: Where the windows begin, as a share of the height.
        roof: Width of the roof as a share of the width.
        front: Share of the length that lies before the cabin at the front, and behind it at the rear.
        glass: Whether the rear has a window.
    """

    width: float
    height: float
    length: float
    waist: float
    roof: float
    front: tuple[float, float]
    glass: bool = True


BODIES = {
    "sedan": Body(1.82, 1.45, 4.6, 0.64, 0.68, (0.28, 0.16)),
    "hatchback": Body(1.80, 1.55, 4.2, 0.6, 0.76, (0.26, 0.02)),
    "suv": Body(1.95, 1.82, 4.8, 0.58, 0.82, (0.25, 0.01)),
    "pickup": Body(1.98, 1.85, 5.6, 0.6, 0.74, (0.26, 0.36)),
    "van": Body(2.0, 2.3, 5.4, 0.55, 0.88, (0.14, 0.0)),
    "truck": Body(2.5, 3.6, 9.5, 0.3, 0.99, (0.02, 0.0), glass=False),
}


def _points(shape: list[tuple[Number, Number]], size: tuple[int, int]) -> NDArray[np.int32]:
    """Gives fractions of the sprite (x to the right, y up) as fixed-point pixels."""
    xy = np.array(shape) * (size[1], -size[0]) + (0, size[0])
    return np.round((xy - 0.5) * 16).astype(np.int32)


class _Pad:
    """A sprite that is being drawn: color and alpha."""

    def __init__(self, size: tuple[int, int]) -> None:
        self.size = size
        self.color = np.zeros((*size, 3), np.uint8)
        self.alpha = np.zeros(size, np.uint8)

    def fill(
        self, shape: list[tuple[Number, Number]], color: Floats | tuple[Number, ...], *, solid: bool = True
    ) -> None:
        """Fills a polygon given in fractions; a solid one also covers what lies behind the sprite."""
        points = [_points(shape, self.size)]
        cv2.fillPoly(self.color, points, tuple(float(np.clip(c, 0, 255)) for c in color), cv2.LINE_AA, 4)
        if solid:
            cv2.fillPoly(self.alpha, points, 255, cv2.LINE_AA, 4)

    def wheel(self, x: float, y: float, radius: tuple[float, float]) -> None:
        """Draws a wheel with a rim."""
        angle = np.linspace(0, 2 * np.pi, 24)
        for share, gray in ((1.0, 14), (0.62, 95), (0.5, 45), (0.15, 120)):
            ring = [(x + share * radius[0] * np.cos(a), y + share * radius[1] * np.sin(a)) for a in angle]
            self.fill(ring, (gray, gray, gray))

    def sprite(self) -> Sprite:
        """Gives the picture, its color times alpha."""
        light = np.linspace(1.12, 0.75, self.size[0])[:, None, None]
        color = cv2.GaussianBlur(self.color, (0, 0), 0.8) * light * (self.alpha[..., None] / 255)
        out = np.concatenate([np.clip(color, 0, 255).astype(np.uint8), self.alpha[..., None]], axis=2)
        out.flags.writeable = False
        return out


@lru_cache(maxsize=512)
def rear(kind: str, paint: int, variant: int, *, small: bool = False) -> Sprite:
    """Gives the rear of a vehicle, one of `BODIES` in one of `PAINTS`, also as a small picture."""
    if small:
        large = rear(kind, paint, variant)
        size = (large.shape[1] // 3, large.shape[0] // 3)
        return np.asarray(cv2.resize(large, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    body, rng = BODIES[kind], np.random.default_rng([variant, len(kind)])
    color = np.array(PAINTS[paint], float)
    pad = _Pad(
        (int(SIDE * min(1.0, body.height / body.width)), int(SIDE * min(1.0, body.width / body.height)))
    )
    foot, waist = 0.3 / body.height, body.waist
    for x in (0.06, 0.8):
        pad.fill([(x, 0), (x + 0.14, 0), (x + 0.14, foot * 1.3), (x, foot * 1.3)], (10, 10, 11))
    inset = (1 - body.roof) / 2
    pad.fill([(0.16, foot * 0.5), (0.84, foot * 0.5), (0.84, foot), (0.16, foot)], (8, 8, 9))
    outline = [(0.02, foot), (0.98, foot), (1, waist * 0.75), (0.97, waist)]
    cabin = [
        (0.97, waist),
        (1 - inset, 0.95),
        (0.9 - inset, 1),
        (inset + 0.1, 1),
        (inset, 0.95),
        (0.03, waist),
    ]
    pad.fill([*outline, *cabin, (0, waist * 0.75)], color)
    if body.glass:
        _window(pad, inset, waist, rng)
    _lights(pad, waist, foot, color, rng)
    if kind == "truck":
        pad.fill([(0.05, foot * 1.3), (0.95, foot * 1.3), (0.95, 0.97), (0.05, 0.97)], color * 1.12 + 5)
        pad.fill([(0.495, foot * 1.3), (0.505, foot * 1.3), (0.505, 0.97), (0.495, 0.97)], color * 0.6)
    return pad.sprite()


def _window(pad: _Pad, inset: float, waist: float, rng: np.random.Generator) -> None:
    glass = np.array((20, 24, 28)) * rng.uniform(0.4, 2.2)
    low, high = waist + 0.01, 0.93
    pane = [(0.09, low), (0.91, low), (0.95 - inset, high), (0.05 + inset, high)]
    pad.fill(pane, glass)
    glint = [(0.12, low), (0.88, low), (0.88, low + 0.4 * (high - low)), (0.12, low + 0.2 * (high - low))]
    pad.fill(glint, glass * 1.3 + 8)


def _lights(pad: _Pad, waist: float, foot: float, color: Floats, rng: np.random.Generator) -> None:
    """Draws lamps, bumper, number plate and the shaded lower part."""
    on = rng.random() < 0.15
    red = (235, 60, 40) if on else (rng.uniform(60, 130), 14, 12)
    high, low = waist * 0.97, waist * rng.uniform(0.55, 0.8)
    wide = rng.uniform(0.09, 0.22)
    for x in (0.02, 0.98 - wide):
        pad.fill([(x, low), (x + wide, low), (x + wide, high), (x, high)], red, solid=False)
    pad.fill([(0.03, foot), (0.97, foot), (0.98, foot * 1.6), (0.02, foot * 1.6)], color * 0.5, solid=False)
    pad.fill(
        [(0.02, foot * 1.6), (0.98, foot * 1.6), (0.98, foot * 1.9), (0.02, foot * 1.9)],
        color * 1.25 + 8,
        solid=False,
    )
    y = rng.uniform(0.38, 0.6) * waist + 0.1
    pad.fill(
        [(0.38, y), (0.62, y), (0.62, y + 0.08), (0.38, y + 0.08)],
        np.full(3, rng.uniform(90, 200)),
        solid=False,
    )


@lru_cache(maxsize=256)
def flank(kind: str, paint: int) -> Sprite:
    """Gives the side of a vehicle that drives to the right, its front at the right edge."""
    body, color = BODIES[kind], np.array(PAINTS[paint], float) * 0.9
    pad = _Pad((max(int(2 * SIDE * body.height / body.length), 8), 2 * SIDE))
    foot, waist = 0.25 / body.height, body.waist
    bonnet, boot = body.front
    cabin = [
        (1 - bonnet, waist * 1.02),
        (0.82 - bonnet, 0.98),
        (boot + 0.1, 1.0),
        (boot + 0.01, waist * 1.05),
    ]
    hull = [(0.0, foot), (1.0, foot), (1.0, waist * 0.75), (1 - bonnet, waist * 1.02)]
    pad.fill([*hull, *cabin, (0, waist)], color)
    pad.fill([(0, foot), (1, foot), (1, foot * 1.8), (0, foot * 1.8)], color * 0.55)
    if body.glass:
        low = waist * 1.06
        pane = [(0.96 - bonnet, low), (0.82 - bonnet, 0.93), (boot + 0.12, 0.93), (boot + 0.06, low)]
        pad.fill(pane, (22, 26, 30))
        for x in (0.35, 0.52):
            pad.fill([(x, foot), (x + 0.006, foot), (x + 0.006, 0.95), (x, 0.95)], color * 0.6, solid=False)
    else:
        pad.fill([(0, foot * 2.5), (0.74, foot * 2.5), (0.74, 0.99), (0, 0.99)], color * 1.1 + 4)
    radius = (0.34 / body.length * (1.4 if kind == "truck" else 1), 0.34 / body.height)
    for x in (0.19, 0.81):
        pad.wheel(x, radius[1], radius)
    return pad.sprite()


__all__ = ["BODIES", "PAINTS", "Body", "flank", "rear"]
