"""Strokes with an outline: what all drawing of lines is made of. These change the canvas."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8
from numpy.typing import NDArray

from yolino.geometry import clip_polylines, clip_segments
from yolino.image import as_rgb
from yolino.types import Polylines
from yolino.viz.colors import Color

Thickness = int | Literal["auto"]
Canvas = UInt8[np.ndarray, "h w 3"]
_TINY = 480  # pixels of the longer edge up to which a tiny image is enlarged
SHIFT = 4  # bits below the pixel in OpenCV's coordinates


def image_edge(image: Canvas) -> float:
    """Gives the edge in pixels of the square that is as large as the image: what sizes of drawings follow."""
    return float(np.sqrt(image.shape[0] * image.shape[1]))


def auto_thickness(image: Canvas, thickness: Thickness) -> int:
    """Gives the thickness in pixels: as given, or one that suits the size of the image.

    Raises:
        ValueError: If it is neither "auto" nor 1 to 1000.
    """
    if thickness == "auto":
        return max(1, round(image_edge(image) / 300))
    if 1 <= thickness <= 1000:
        return thickness
    raise ValueError(f"thickness is {thickness!r}, but must be 'auto' or 1 to 1000 pixels.")


def enlarge(image: NDArray[np.generic], zoom: int) -> Canvas:
    """Gives a copy of an RGB or gray image in RGB, each pixel as `zoom` x `zoom` pixels."""
    return np.repeat(np.repeat(as_rgb(image), zoom, axis=0), zoom, axis=1)


def tiny_zoom(size: tuple[int, int]) -> int:
    """Gives by how much an image (height, width) is to be enlarged so that lines in it can be told apart.

    Returns:
        A factor that gives a longer edge of 241 to 480 px; 1 for larger images.
    """
    return max(1, _TINY // max(size))


def outlined(width: int) -> int:
    """Gives the thickness in pixels of a stroke with its outline."""
    return width + 2 * ceil(width / 3)


def check_finite(points: NDArray[np.float64]) -> None:
    """Raises ValueError if a coordinate is NaN or infinite."""
    if not np.isfinite(points).all():
        raise ValueError("Points with NaN or infinite coordinates cannot be drawn; remove them first.")


def fixed(points: NDArray[np.float64]) -> NDArray[np.int32]:
    """Gives points as OpenCV draws them: centers of pixels are integers, with fractional bits."""
    return np.asarray(((points - 0.5) * (1 << SHIFT)).round().astype(np.int32))


def visible_segments(
    canvas: Canvas, pieces: Float[np.ndarray, "n 2 2"], margin: int
) -> tuple[Float[np.ndarray, "m 2 2"], Int[np.ndarray, " m"]]:
    """Gives the parts of segments on the canvas or in the margin, and the segment that each is a part of."""
    size = (canvas.shape[0] + 2 * margin, canvas.shape[1] + 2 * margin)
    parts, kept = clip_segments(pieces + margin, size)
    return parts - margin, kept


def visible_polylines(canvas: Canvas, polylines: Polylines, margin: int) -> Polylines:
    """Gives the parts of polylines on the canvas or in the margin, each labelled with their index."""
    size = (canvas.shape[0] + 2 * margin, canvas.shape[1] + 2 * margin)
    numbers = np.arange(len(polylines))
    numbered = Polylines(polylines.vertices + margin, polylines.offsets, polylines.scores, numbers)
    parts = clip_polylines(numbered, size)
    return parts.with_vertices(parts.vertices - margin)


def stroke(
    canvas: Canvas, lines: Sequence[NDArray[np.int32]], color: Color, width: int, *, closed: bool = False
) -> None:
    """Strokes lines, each an array of fixed points, in one color."""
    if lines:
        cv2.polylines(canvas, lines, closed, color, width, cv2.LINE_AA, SHIFT)


def stroke_pieces(
    canvas: Canvas, pieces: Float[np.ndarray, "n 2 2"], colors: UInt8[np.ndarray, "n 3"], width: int
) -> None:
    """Strokes pieces in their colors, runs of one color together; later pieces lie on top."""
    changes = np.flatnonzero((colors[1:] != colors[:-1]).any(axis=1)) + 1
    points = fixed(pieces)
    for start, stop in zip([0, *changes], [*changes, len(pieces)], strict=True):
        if start < stop:
            stroke(canvas, list(points[start:stop]), as_color(colors[start]), width)


def dot(canvas: Canvas, place: NDArray[np.int32], radius: int, color: Color) -> None:
    """Fills a circle around one fixed point."""
    center = int(place[0]), int(place[1])
    cv2.circle(canvas, center, radius << SHIFT, color, cv2.FILLED, cv2.LINE_AA, SHIFT)


def as_color(color: Sequence[int] | UInt8[np.ndarray, "rgb=3"]) -> Color:
    """Gives a color in the numbers that OpenCV takes."""
    red, green, blue = map(int, color)
    return red, green, blue


__all__ = [
    "SHIFT",
    "Canvas",
    "Thickness",
    "as_color",
    "auto_thickness",
    "check_finite",
    "dot",
    "enlarge",
    "fixed",
    "image_edge",
    "outlined",
    "stroke",
    "stroke_pieces",
    "tiny_zoom",
    "visible_polylines",
    "visible_segments",
]
