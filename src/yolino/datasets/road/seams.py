"""Lines on the road that bound no lane: joints, tar, tire marks, cracks, arrows and hatchings."""

from __future__ import annotations

import cv2
import numpy as np

from yolino.datasets.road.drawing import Canvas, box, fill, stroke
from yolino.datasets.road.layout import WHITE, Layout, Pattern, Stripe
from yolino.datasets.road.strokes import paint_stripe
from yolino.datasets.road.surface import Ground
from yolino.datasets.road.view import View
from yolino.types import Floats


def paint_seams(canvas: Canvas, view: View, layout: Layout, ground: Ground, rng: np.random.Generator) -> None:
    """Paints what lane markings are mistaken for, below the markings."""
    chance = 0.85 if ground.concrete else 0.35
    shift = rng.normal(0, 0.12)
    for boundary in layout.boundaries:
        if rng.random() < chance:
            # Some run half a meter beside the paint, or leave it: where paint is dashed, they look the part.
            spread = 0.35 if rng.random() < 0.3 else 0.06
            _seam(canvas, view, boundary.offset + shift + rng.normal(0, spread), rng)
    for edge in layout.edges:
        if rng.random() < 0.4:
            _seam(canvas, view, edge + rng.normal(0, 0.1), rng)
    for _ in range(rng.poisson(0.5)):
        _seam(canvas, view, rng.uniform(*layout.edges), rng)
    for _ in range(rng.poisson(0.5)):
        _tire(canvas, view, rng.uniform(*layout.edges), rng)
    for _ in range(rng.poisson(1.2)):
        _crack(canvas, view, layout, rng)


def _seam(canvas: Canvas, view: View, x: float, rng: np.random.Generator) -> None:
    """Paints a joint or a tar line along the road, straight or wandering a little."""
    gray = rng.uniform(8, 60)
    pattern = (
        Pattern(40.0, ((0.0, rng.uniform(20, 39)),), rng.uniform(0, 40)) if rng.random() < 0.3 else Pattern()
    )
    stripe = Stripe(
        rng.uniform(0.015, 0.08), (gray, gray, gray), 0.0, pattern, rng.uniform(0.2, 0.9), rng.uniform(0, 0.7)
    )
    drift = rng.normal(0, 0.007 if rng.random() < 0.25 else 0.0015)
    sway, phase = rng.exponential(0.012), rng.uniform(0, 6)
    paint_stripe(
        canvas, view, stripe, lambda z: x + drift * z + sway * np.sin(z / 2.5 + phase), int(rng.integers(512))
    )


def _tire(canvas: Canvas, view: View, x: float, rng: np.random.Generator) -> None:
    """Paints two dark tire marks that begin and end and drift to a side."""
    start, length = rng.uniform(2, 40), rng.uniform(5, 30)
    pattern = Pattern(1000.0, ((start, start + length),))
    stripe = Stripe(
        rng.uniform(0.12, 0.25), (25, 25, 26), 0.0, pattern, rng.uniform(0.1, 0.45), rng.uniform(0.2, 0.9)
    )
    bend = rng.normal(0, 0.002)
    for side in (-0.75, 0.75):
        paint_stripe(canvas, view, stripe, lambda z, s=side: x + s + bend * (z - start) ** 2)  # type: ignore[misc]


def _crack(canvas: Canvas, view: View, layout: Layout, rng: np.random.Generator) -> None:
    """Paints a crack or a sealed one, along or across the road, as thin as it gets with the distance."""
    count = 40
    start = np.array([rng.uniform(*layout.edges), rng.uniform(4, 30)])
    course = np.array([rng.normal(0, 0.05), rng.uniform(0.05, 0.4)])
    if rng.random() < 0.3:
        course = np.array([rng.uniform(-0.12, 0.12), rng.normal(0, 0.01)])
    x, z = (start + np.cumsum(course + rng.normal(0, 0.05, (count, 2)), axis=0)).T
    z = np.maximum(z, 1.5)
    points = view.project(np.stack([x, np.zeros(count), z], axis=1))
    part = box(points, canvas, margin=4)
    target = canvas[part]
    if target.size == 0:
        return
    over = target.copy()
    points -= (part[1].start, part[0].start)
    width, gray = rng.uniform(0.006, 0.04), rng.uniform(8, 40)
    for piece in range(0, count - 1, 8):
        pixels = view.focal * width / z[piece]
        if pixels > 0.25:
            stroke(over, points[piece : piece + 9], (gray, gray, gray), pixels)
    cv2.addWeighted(target, 0.5, over, 0.5, 0, dst=target)


def paint_signs(canvas: Canvas, view: View, layout: Layout, rng: np.random.Generator) -> None:
    """Paints an arrow on a lane or the hatching beside an exit."""
    if rng.random() < 0.08:
        lane = int(rng.integers(len(layout.boundaries) - 1))
        middle = (layout.boundaries[lane].offset + layout.boundaries[lane + 1].offset) / 2
        _arrow(canvas, view, middle, rng.uniform(6, 45))
    outer = layout.boundaries[-1]
    if outer.taper[1] > 0 or (rng.random() < 0.06 and layout.shoulders[1] > 2.5):
        _hatching(canvas, view, outer.run, layout.shoulders[1], rng)


ARROW = np.array([(-0.1, 0), (0.1, 0), (0.1, 1.9), (0.42, 1.6), (0.0, 3.2), (-0.42, 1.6), (-0.1, 1.9)])


def _arrow(canvas: Canvas, view: View, x: float, z: float) -> None:
    points = np.stack([ARROW[:, 0] + x, np.zeros(len(ARROW)), ARROW[:, 1] + z], axis=1)
    fill(canvas, view.project(points), WHITE)


def _hatching(canvas: Canvas, view: View, run: object, width: float, rng: np.random.Generator) -> None:
    """Paints slanted bars on the shoulder."""
    bar = rng.uniform(0.3, 0.6)
    for z in np.arange(rng.uniform(4, 12), 60, rng.uniform(4, 9)):
        near = run(np.array([z]))[0] + 0.3  # type: ignore[operator]
        far = near + min(width, 3.0)
        corners: Floats = np.array([(near, 0, z), (far, 0, z + 2), (far, 0, z + 2 + bar), (near, 0, z + bar)])
        fill(canvas, view.project(corners), tuple(np.array(WHITE) * rng.uniform(0.75, 1)))


__all__ = ["paint_seams", "paint_signs"]
