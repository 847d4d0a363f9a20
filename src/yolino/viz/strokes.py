"""Strokes with an outline, and arrow heads: what all drawing of lines is made of. These change the canvas."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8
from numpy.typing import NDArray

from yolino.geometry import clip_polylines, clip_segments
from yolino.types import Polylines
from yolino.viz.colors import OUTLINE, Color

Thickness = int | Literal["auto"]
Canvas = UInt8[np.ndarray, "h w 3"]
_SHIFT = 4  # bits below the pixel in OpenCV's coordinates
_SHORTEST = 3  # pixels; on shorter lines a direction cannot be seen
_HEADS = 1000  # on one polyline


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


def outlined(width: int) -> int:
    """Gives the thickness in pixels of a stroke with its outline."""
    return width + 2 * ceil(width / 3)


def check_finite(points: NDArray[np.float64]) -> None:
    """Raises ValueError if a coordinate is NaN or infinite."""
    if not np.isfinite(points).all():
        raise ValueError("Points with NaN or infinite coordinates cannot be drawn; remove them first.")


def fixed(points: NDArray[np.float64]) -> NDArray[np.int32]:
    """Gives points as OpenCV draws them: centers of pixels are integers, with fractional bits."""
    return np.asarray(((points - 0.5) * (1 << _SHIFT)).round().astype(np.int32))


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
        cv2.polylines(canvas, lines, closed, color, width, cv2.LINE_AA, _SHIFT)


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
    cv2.circle(canvas, center, radius << _SHIFT, color, cv2.FILLED, cv2.LINE_AA, _SHIFT)


def as_color(color: Sequence[int] | UInt8[np.ndarray, "rgb=3"]) -> Color:
    """Gives a color in the numbers that OpenCV takes."""
    red, green, blue = map(int, color)
    return red, green, blue


def arrow_axes(polylines: Polylines, width: int) -> tuple[Float[np.ndarray, "k 2 2"], Int[np.ndarray, " k"]]:
    """Gives where arrow heads belong: evenly along each polyline, at least one.

    A short polyline gets one head, of at most half its length; one so short that the head would hide in its
    stroke gets none.

    Args:
        polylines: In pixels.
        width: Of the stroke in pixels.

    Returns:
        Foot and tip of each head, and the row of `polylines.endpoints` that it lies on.
    """
    pieces, owners = polylines.endpoints, polylines.owners
    delta = pieces[:, 1] - pieces[:, 0]
    run = np.hypot(delta[:, 0], delta[:, 1])
    at = np.concatenate([[0.0], np.cumsum(run)])  # all polylines one after the other
    first = np.searchsorted(owners, np.arange(len(polylines) + 1))
    total = at[first[1:]] - at[first[:-1]]
    head = np.minimum(_head_length(width), total / 2)
    long = head >= max(outlined(width), _SHORTEST)
    counts = np.where(long, np.clip(np.rint(total / np.maximum(12 * head, 1e-9)), 1, _HEADS), 0).astype(
        np.int64
    )
    owner = np.repeat(np.arange(len(polylines)), counts)
    within = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    feet = at[first[owner]] + (within + 0.5) / counts[owner] * (total - head)[owner]
    places = [_along(pieces, at, run, where) for where in (feet, feet + head[owner])]
    return np.stack([places[0][0], places[1][0]], axis=1), places[1][1]


def _along(
    pieces: Float[np.ndarray, "m 2 2"],
    at: Float[np.ndarray, " m_plus_1"],
    run: Float[np.ndarray, " m"],
    where: Float[np.ndarray, " k"],
) -> tuple[Float[np.ndarray, "k 2"], Int[np.ndarray, " k"]]:
    """Gives the points at arc lengths along all pieces, and the piece of each."""
    row = np.clip(np.searchsorted(at, where) - 1, 0, max(len(pieces) - 1, 0))
    share = (where - at[row]) / np.maximum(run[row], 1e-300)
    return pieces[row, 0] + np.clip(share, 0, 1)[:, None] * (pieces[row, 1] - pieces[row, 0]), row


def draw_heads(
    canvas: Canvas, axes: Float[np.ndarray, "k 2 2"], colors: UInt8[np.ndarray, "k 3"], width: int
) -> None:
    """Draws arrow heads from foot to tip, later ones on top.

    None is longer than suits the thickness, and none is drawn that would hide in its stroke.
    """
    way = axes[:, 1] - axes[:, 0]
    length = np.hypot(way[:, 0], way[:, 1])
    tips = axes[:, 1]
    seen = (length >= _least_head(width)) & ((tips >= 0) & (tips <= canvas.shape[1::-1])).all(axis=1)
    tips, way, length, colors = tips[seen], way[seen], length[seen], colors[seen]
    back = way * (np.minimum(_head_length(width), length) / length)[:, None]
    side = 0.45 * np.stack([-back[:, 1], back[:, 0]], axis=1)
    corners = fixed(np.stack([tips, tips - back + side, tips - 0.7 * back, tips - back - side], axis=1))
    edge = 1 + 2 * ceil(width / 3)
    for quad, color in zip(corners, colors.tolist(), strict=True):
        cv2.polylines(canvas, [quad], True, OUTLINE, edge, cv2.LINE_AA, _SHIFT)
        cv2.fillPoly(canvas, [quad], color, cv2.LINE_AA, _SHIFT)


def _least_head(width: int) -> float:
    """Gives the length in pixels below which a head is hardly wider than its stroke with the outline."""
    return float(max(outlined(width), _SHORTEST))


def _head_length(width: int) -> float:
    return 6.0 * width + 4


__all__ = [
    "Canvas",
    "Thickness",
    "arrow_axes",
    "as_color",
    "auto_thickness",
    "check_finite",
    "dot",
    "draw_heads",
    "fixed",
    "image_edge",
    "outlined",
    "stroke",
    "stroke_pieces",
    "visible_polylines",
    "visible_segments",
]
