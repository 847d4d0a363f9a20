"""Vehicles on the road, and the shadows that they, trees and poles throw."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from yolino.datasets.road.drawing import Canvas, blend, box, paste, shade
from yolino.datasets.road.layout import Layout
from yolino.datasets.road.surface import Ground
from yolino.datasets.road.vehicles import BODIES, PAINTS, Body, flank, rear
from yolino.datasets.road.view import View
from yolino.datasets.texture import noise, sample
from yolino.types import Floats

KINDS = ("sedan", "hatchback", "suv", "pickup", "van", "truck")
SHARES = (0.36, 0.12, 0.28, 0.13, 0.06, 0.05)


def paint_shadows(canvas: Canvas, view: View, layout: Layout, rng: np.random.Generator) -> None:
    """Darkens the ground under the shadows of poles, gantries and trees."""
    light = rng.uniform(0.3, 0.65)
    for _ in range(rng.poisson(0.5)):
        z, depth, slant = (
            rng.uniform(4, 60),
            rng.choice([0.2, 0.4, 1.2]) * rng.uniform(0.6, 1.5),
            rng.normal(0, 0.5),
        )
        x = np.linspace(-30, 30, 16)
        far = np.maximum(z + slant * x, 1.5)
        outline = np.concatenate([np.stack([x, 0 * x, far], 1), np.stack([x, 0 * x, far + depth], 1)[::-1]])
        shade(canvas, view.project(outline), light, blur=0.6)
    if rng.random() < 0.22:
        _tree_shadows(canvas, view, layout, light, rng)


def _tree_shadows(canvas: Canvas, view: View, layout: Layout, light: float, rng: np.random.Generator) -> None:
    """Darkens patches of the road beside one of its edges, frayed as foliage is."""
    first, edges = view.ground_rows
    if len(edges) < 2:
        return
    part = canvas[first:]
    h, w = part.shape[:2]
    step = max(1, round(4 * view.scale))
    z = ((edges[1:] + edges[:-1]) / 2)[::step, None]
    columns = np.arange(0, w, step) + step / 2
    x = (columns - view.vanishing[0]) * (z / view.focal) - view.center(z)
    side = int(rng.integers(2))
    depth = (x - layout.edges[0]) if side == 0 else (layout.edges[1] - x)
    shift = rng.uniform(0, 512, 2)
    leaf = sample(noise(1.3), x * 11 + shift[0], z * 6 + shift[1])
    cover = np.clip((leaf * 1.4 + (rng.uniform(0, 6) - depth) * 0.7) * 2, 0, 1)
    gain = ((1 - (1 - light) * cover) * 255).astype(np.uint8)
    gain = cv2.resize(gain, (w, h), interpolation=cv2.INTER_LINEAR)
    cv2.multiply(part, cv2.cvtColor(gain, cv2.COLOR_GRAY2RGB), dst=part, scale=1 / 255)


def paint_traffic(
    canvas: Canvas, view: View, layout: Layout, ground: Ground, rng: np.random.Generator
) -> None:
    """Paints vehicles in the lanes and on the opposite roadway, far ones first."""
    middles = [
        (a.offset + b.offset) / 2 for a, b in zip(layout.boundaries[:-1], layout.boundaries[1:], strict=True)
    ]
    density = rng.uniform(0.1, 1.0)
    cars: list[tuple[float, float, str]] = []
    for lane, middle in enumerate(middles):
        z = rng.uniform(14, 60) if lane == layout.own else rng.uniform(2.5, 40)
        while z < min(view.farthest, 260) and len(cars) < 20:
            kind = str(rng.choice(KINDS, p=SHARES))
            if rng.random() < density:
                cars.append((z, middle + rng.normal(0, 0.2), kind))
            z += BODIES[kind].length + 4 + rng.exponential(25)
    gap, width = ground.median
    if width > 0:
        for z in rng.uniform(15, 200, rng.poisson(6 * density)):
            cars.append(
                (z, layout.edges[0] - gap - rng.uniform(1.5, width - 1.5), str(rng.choice(KINDS, p=SHARES)))
            )
    sun, gain = rng.uniform(-1.5, 1.5), rng.uniform(0.45, 1.15)
    for z, x, kind in sorted(cars, reverse=True):
        _paint(canvas, _place(view, (x, z), BODIES[kind], sun, rng), kind, gain=gain, rng=rng)


class _Outline(NamedTuple):
    """Where a vehicle is in the picture: corners in pixels."""

    rear: Floats
    foot: Floats
    flank: Floats
    blur: float


def _place(view: View, at: tuple[float, float], body: Body, sun: float, rng: np.random.Generator) -> _Outline:
    """Gives the outline of a vehicle whose rear is at `at`, meters to the right and ahead."""
    x, z = at
    half, tall = body.width / 2 * rng.uniform(0.95, 1.05), body.height * rng.uniform(0.95, 1.05)
    left, right, far, near = x - half, x + half, z + body.length, max(z - 0.3, 1.5)
    edge = left if float(view.center(np.array([z]))[0]) + x > 0 else right
    rear_face = [(left, 0, z), (right, tall, z)]
    ground = [(left, 0, near), (right, 0, near), (right + max(sun, 0), 0, far), (left + min(sun, 0), 0, far)]
    side = [(edge, tall, z), (edge, tall, far), (edge, 0, far), (edge, 0, z)]
    points = view.project(np.array(rear_face + ground + side, dtype=np.float64))
    return _Outline(points[:2], points[2:6], points[6:], max(0.5, 0.05 * view.focal / z))


def _paint(canvas: Canvas, place: _Outline, kind: str, *, gain: float, rng: np.random.Generator) -> None:
    """Paints one vehicle: its shadow, its side and its rear."""
    paint = int(min(rng.integers(len(PAINTS)), rng.integers(len(PAINTS) + 3)))
    light, other, variant = rng.uniform(0.15, 0.4), rng.uniform(0.8, 1.1), int(rng.integers(4))
    (left, bottom), (right, top) = place.rear.tolist()
    h, w = canvas.shape[:2]
    wide, tall = right - left, bottom - top
    if wide < 1.5 or tall < 1.5 or right < -w or left > 2 * w or wide > 3 * w or top > h:
        return
    if wide > 5:
        shade(canvas, place.foot, light, blur=place.blur if wide > 12 else 0.0)
        _paint_flank(canvas, place.flank, flank(kind, paint), gain * other)
    size = (max(1, round(wide)), max(1, round(tall)))
    picture = cv2.resize(rear(kind, paint, variant, small=wide < 40), size, interpolation=cv2.INTER_AREA)
    paste(canvas, picture, (round(left), round(top)), gain)


def _paint_flank(canvas: Canvas, corners: Floats, picture: np.ndarray, gain: float) -> None:
    """Paints the side of a vehicle that is seen past its rear."""
    part = box(corners, canvas)
    target = canvas[part]
    if target.size == 0 or np.ptp(corners[:, 0]) < 2:
        return
    h, w = picture.shape[:2]
    source = np.array([(0, 0), (w, 0), (w, h), (0, h)], np.float32)
    goal = (corners - (part[1].start, part[0].start)).astype(np.float32)
    matrix = cv2.getPerspectiveTransform(source, goal)
    size = (target.shape[1], target.shape[0])
    piece = cv2.warpPerspective(picture, matrix, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    blend(target, piece[..., :3], piece[..., 3], gain)


__all__ = ["paint_shadows", "paint_traffic"]
