"""Synthetic pictures of highways from a dashboard camera, with lane boundaries as TuSimple labels them."""

from __future__ import annotations

import numpy as np

from yolino.datasets.road.layout import Layout, sample_layout
from yolino.datasets.road.optics import expose, roll_matrix, turn
from yolino.datasets.road.scenery import paint_background, paint_bridge, paint_signs, paint_sky
from yolino.datasets.road.seams import paint_seams
from yolino.datasets.road.seams import paint_signs as paint_arrows
from yolino.datasets.road.sides import paint_sides
from yolino.datasets.road.strokes import paint_dots, paint_stripe
from yolino.datasets.road.surface import paint_ground, sample_ground
from yolino.datasets.road.traffic import paint_shadows, paint_traffic
from yolino.datasets.road.view import View, sample_view
from yolino.datasets.tusimple import CLASSES
from yolino.geometry import clip_polylines, transform_points
from yolino.types import Floats, Polylines, Sample

VERTEX_ROWS = 10
"""Rows between the vertices of a label in a picture 1280 pixels wide, as in TuSimple."""

SHORTEST = 30
"""Length in pixels, in a picture 1280 pixels wide, below which what is seen of a boundary is not labelled."""


def road_scene(
    rng: np.random.Generator, size: tuple[int, int] = (720, 1280), *, name: str = "road"
) -> Sample:
    """Gives a random highway picture with its lane boundaries.

    The camera is that of a 720 x 1280 picture, scaled to the width of `size` and cropped (or extended) at
    the top: the network's 320 x 640 frame of a TuSimple picture is `size=(320, 640)`.

    The labels are the boundaries of the own lane and the next one at each side (five in all during a lane
    change), from the bottom to near the horizon, also where the marking is worn, missing or hidden. Their
    classes are `CLASSES`.

    Args:
        rng: Source of all randomness.
        size: Height and width in pixels.
        name: Name of the sample.

    Raises:
        ValueError: If the size is not positive.
    """
    h, w = size
    if h < 1 or w < 1:
        raise ValueError(
            f"A scene of size {size} was asked for, but height and width must be at least 1 pixel."
        )
    angle = rng.normal(0, 0.009) if rng.random() < 0.6 else 0.0
    margin = int(np.ceil(w / 2 * abs(np.sin(angle)))) + 2
    view, layout = sample_view(rng, size, margin), sample_layout(rng)
    canvas = _paint(view, layout, rng)
    matrix = roll_matrix(size, margin, angle)
    image = expose(turn(canvas, matrix, size), rng)
    return Sample(name, image, _label(view, layout, matrix, size, rng))


def _paint(view: View, layout: Layout, rng: np.random.Generator) -> np.ndarray:
    canvas = np.empty((*view.size, 3), np.uint8)
    ground, sun = sample_ground(rng), rng.uniform(-1, 1)
    paint_sky(canvas, view, rng)
    paint_background(canvas, view, rng)
    paint_ground(canvas, view, layout, ground, rng)
    paint_seams(canvas, view, layout, ground, rng)
    paint_arrows(canvas, view, layout, rng)
    for i, boundary in enumerate(layout.boundaries):
        for stripe in boundary.stripes:
            if stripe.raised:
                paint_dots(canvas, view, stripe, boundary.run, sun)
            else:
                paint_stripe(canvas, view, stripe, boundary.run, seed=37 * i)
    paint_shadows(canvas, view, layout, rng)
    paint_sides(canvas, view, layout, ground, rng)
    paint_signs(canvas, view, layout, rng)
    if rng.random() < 0.25:
        paint_bridge(canvas, view, layout, rng)
    paint_traffic(canvas, view, layout, ground, rng)
    return canvas


def _label(
    view: View, layout: Layout, matrix: Floats, size: tuple[int, int], rng: np.random.Generator
) -> Polylines:
    """Gives the labelled boundaries in the frame of the turned picture."""
    nearest = (
        layout.own + int(view.lateral > layout.lane_width / 2) - int(view.lateral < -layout.lane_width / 2)
    )
    first, last = nearest - 1, nearest + 2
    phase = view.lateral / layout.lane_width
    if abs(phase) > 0.35:
        first, last = (first, last + 1) if phase > 0 else (first - 1, last)
    top = max(view.top, view.vanishing[1] + view.scale * rng.uniform(8, 32))
    rows = np.append(np.arange(view.size[0], top, -VERTEX_ROWS * view.scale), top)
    if len(rows) < 3:
        return Polylines(np.zeros((0, 2)))
    z = view.distance(rows)
    chosen = [b for i, b in enumerate(layout.boundaries) if first <= i <= last]
    lines = [transform_points(np.stack([view.column(b.run(z), z), rows], axis=1), matrix) for b in chosen]
    clipped = clip_polylines(Polylines.from_list(lines, labels=[b.label for b in chosen]), size)
    return clipped[clipped.lengths > SHORTEST * view.scale]


__all__ = ["CLASSES", "road_scene"]
