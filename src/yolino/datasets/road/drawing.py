"""Drawing primitives: anti-aliased polygons, blending, multiplying with light."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from yolino.types import Floats

Canvas = NDArray[np.uint8]
Number = float | int
"""The runtime type checks of the tests do not take an int for a float."""

Color = tuple[Number, Number, Number]


def fixed_point(points: Floats, canvas: Canvas) -> NDArray[np.int32]:
    """Gives pixel points as OpenCV wants them with `shift=4`, kept within a few canvas sizes."""
    limit = 6.0 * max(canvas.shape[:2])
    return np.round((np.clip(points, -limit, limit) - 0.5) * 16).astype(np.int32)


def fill(canvas: Canvas, points: Floats, color: Number | tuple[Number, ...]) -> None:
    """Fills the polygon `points` (pixels) with anti-aliased edges."""
    cv2.fillPoly(canvas, [fixed_point(points, canvas)], color, cv2.LINE_AA, 4)


def stroke(canvas: Canvas, points: Floats, color: Number | tuple[Number, ...], width: Number) -> None:
    """Draws the polyline `points` (pixels), at least one pixel wide."""
    cv2.polylines(canvas, [fixed_point(points, canvas)], False, color, max(1, round(width)), cv2.LINE_AA, 4)


def box(points: Floats, canvas: Canvas, margin: int = 2) -> tuple[slice, slice]:
    """Gives rows and columns of the canvas around the points; empty slices where they lie outside."""
    h, w = canvas.shape[:2]
    (left, top), (right, bottom) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    x0, x1 = (int(min(max(v, 0), w)) for v in (left - margin, right + margin + 1))
    y0, y1 = (int(min(max(v, 0), h)) for v in (top - margin, bottom + margin + 1))
    return slice(y0, y1), slice(x0, x1)


def shade(canvas: Canvas, points: Floats, light: float, blur: float = 0.0) -> None:
    """Multiplies the canvas inside the polygon with `light` (0 to 1), with edges `blur` pixels soft."""
    part = box(points, canvas, margin=int(3 * blur) + 2)
    target = canvas[part]
    if target.size == 0:
        return
    mask = np.full(target.shape[:2], 255, np.uint8)
    fill(mask, points - (part[1].start, part[0].start), 255 * light)
    if blur > 0:
        cv2.GaussianBlur(mask, (0, 0), blur, dst=mask)
    cv2.multiply(target, cv2.cvtColor(mask, cv2.COLOR_GRAY2RGB), dst=target, scale=1 / 255)


def paste(canvas: Canvas, sprite: NDArray[np.uint8], corner: tuple[int, int], gain: float = 1.0) -> None:
    """Lays a sprite (red, green, blue times alpha; alpha) over the canvas.

    Args:
        canvas: Changed in place.
        sprite: `(h, w, 4)`.
        corner: Column and row of its top-left pixel.
        gain: Factor of its brightness.
    """
    h, w = sprite.shape[:2]
    x, y = corner
    x0, y0, x1, y1 = max(x, 0), max(y, 0), min(x + w, canvas.shape[1]), min(y + h, canvas.shape[0])
    if x0 >= x1 or y0 >= y1:
        return
    piece = sprite[y0 - y : y1 - y, x0 - x : x1 - x]
    blend(canvas[y0:y1, x0:x1], piece[..., :3], piece[..., 3], gain)


def blend(target: Canvas, color: NDArray[np.uint8], alpha: NDArray[np.uint8], gain: float = 1.0) -> None:
    """Puts `color` (already times alpha) over the target, which is changed in place."""
    rest = cv2.multiply(target, cv2.cvtColor(255 - alpha, cv2.COLOR_GRAY2RGB), scale=1 / 255)
    cv2.addWeighted(np.ascontiguousarray(color), gain, rest, 1.0, 0.0, dst=target)


__all__ = ["Canvas", "Color", "Number", "blend", "box", "fill", "fixed_point", "paste", "shade", "stroke"]
