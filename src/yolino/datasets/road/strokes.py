"""Paints stripes along the road with exact coverage: smooth at every distance, faint where they get thin."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from yolino.datasets.road.drawing import Canvas, Color, fill
from yolino.datasets.road.layout import Stripe
from yolino.datasets.road.view import View
from yolino.datasets.texture import Reals, noise
from yolino.types import Floats

Run = Callable[[Floats], Floats]
"""A line along the road: meters to the right for meters ahead."""

CLOSE = 22.0
"""Distance in meters up to which a dot is drawn as a dome."""


def paint_stripe(canvas: Canvas, view: View, stripe: Stripe, run: Run, seed: int = 0) -> None:
    """Paints `stripe` along `run`.

    Each pixel gets the share of it that the stripe covers: across, the width is averaged over the pixel and
    over the slant within a row; along, the painted length over the stretch that a row shows.

    Args:
        canvas: Changed in place.
        view: Camera and road.
        stripe: What to paint.
        run: Where the marked line runs.
        seed: Shifts the pattern of the wear.
    """
    first, z = view.ground_rows
    if len(z) < 2:
        return
    column = view.column(run(z) + stripe.shift, z)
    middle, ahead = (column[1:] + column[:-1]) / 2, (z[1:] + z[:-1]) / 2
    half = view.focal * stripe.width / ahead / 2
    blur = np.maximum(1.0, np.abs(np.diff(column)))
    share = stripe.pattern.share(z) * stripe.opacity
    left = np.floor(middle - half - blur / 2).clip(0, canvas.shape[1])
    right = np.ceil(middle + half + blur / 2).clip(0, canvas.shape[1])
    count = np.where(share > 0.004, right - left, 0).astype(np.int64)
    rows = np.repeat(np.arange(len(middle)), count)
    columns = left[rows].astype(np.int64) + np.arange(len(rows)) - np.repeat(np.cumsum(count) - count, count)
    at = columns + 0.5 - middle[rows]
    low = np.maximum(at - blur[rows] / 2, -half[rows])
    high = np.minimum(at + blur[rows] / 2, half[rows])
    alpha = np.maximum(high - low, 0) / blur[rows] * share[rows]
    if stripe.wear > 0:
        alpha *= _worn(stripe.wear, at * ahead[rows] / view.focal, ahead[rows], seed)
    _mix(canvas, rows + first, columns, alpha, stripe.color)


def _worn(wear: float, x: Floats, z: Floats, seed: int) -> Reals:
    """Gives the share of the paint that is left at `x` meters from its middle and `z` meters ahead."""
    fine = noise(0.6)[(z * 31).astype(np.int64) % 512, ((x * 90).astype(np.int64) + seed) % 512]
    coarse = noise(1.2)[(z * 7).astype(np.int64) % 512, seed % 512]
    return np.asarray(np.clip(1.3 - wear * (1.0 + 0.8 * fine + 0.5 * coarse), 0.0, 1.0))


def _mix(
    canvas: Canvas, rows: NDArray[np.int64], columns: NDArray[np.int64], alpha: Reals, color: Color
) -> None:
    below = canvas[rows, columns].astype(np.float32)
    weight = alpha[:, None].astype(np.float32)
    canvas[rows, columns] = (
        below * (1 - weight) + np.array(color, np.float32).clip(0, 255) * weight + 0.5
    ).astype(np.uint8)


def paint_dots(canvas: Canvas, view: View, stripe: Stripe, run: Run, sun: float) -> None:
    """Paints raised round dots: domes with a bright top and a dark rim where they are close, a stripe beyond.

    Args:
        canvas: Changed in place.
        view: Camera and road.
        stripe: Its pattern says where the dots lie, its width is their diameter.
        run: Where the marked line runs.
        sun: Direction of the shadow across the road, about -1 to 1.
    """
    paint_stripe(canvas, view, stripe, run)
    pattern, radius = stripe.pattern, stripe.width / 2
    turns = np.arange(-1, CLOSE // pattern.period + 1) * pattern.period + pattern.phase
    z = np.sort((turns[:, None] + np.array([(a + b) / 2 for a, b in pattern.pieces])).ravel())[::-1]
    z = z[(z > 1.5) & (z < CLOSE)]
    angle = np.linspace(0, 2 * np.pi, 15)[:-1]
    for at in z:
        x = run(np.array([at]))[0] + stripe.shift
        column, row = view.column(x, np.array([at]))[0], view.row(np.array([at]))[0]
        across = view.focal * radius / at
        if across < 0.8 or not -20 < column < canvas.shape[1] + 20:
            continue
        along = max(0.5, across * (view.height / at + 0.12))
        ring = np.stack([np.cos(angle) * across, np.sin(angle) * along], axis=1)
        fill(canvas, ring * 1.05 + (column + 0.35 * across * sun, row + 0.25 * along), (38, 36, 34))
        bright = np.clip(np.array(stripe.color) * (0.55 + 0.5 * stripe.opacity), 0, 255)
        fill(canvas, ring * 0.95 + (column, row - 0.12 * along), tuple(bright * 0.72))
        fill(canvas, ring * 0.6 + (column - 0.2 * across * sun, row - 0.3 * along), tuple(bright))


__all__ = ["paint_dots", "paint_stripe"]
