"""Polylines, segments and points on an image."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8
from numpy.typing import NDArray

from yolino.geometry import clip_segments, cumulative_length
from yolino.image import as_rgb
from yolino.types import Polylines, Segments
from yolino.viz.colors import OUTLINE, Color, direction_colors, item_colors

Thickness = int | Literal["auto"]
Canvas = UInt8[np.ndarray, "h w 3"]
_SHIFT = 4  # bits below the pixel in OpenCV's coordinates


def draw_polylines(
    image: NDArray[np.generic],
    polylines: Polylines,
    *,
    color_by: str = "identity",
    directed: bool = True,
    arrows: bool = True,
    thickness: Thickness = "auto",
) -> Canvas:
    """Gives the image with the polylines drawn on it, the best score on top.

    Args:
        image: RGB or gray pixels.
        polylines: In pixels of the image; parts outside are cut off.
        color_by: "identity" gives each polyline its own color, "label" each class; "direction" shows where
            each piece heads as a hue, "score" goes from violet (0) to yellow (1).
        directed: False draws no arrows and gives opposite directions the same hue.
        arrows: Whether arrow heads along the polylines show their direction.
        thickness: Pixels, or "auto": 3 in an image of 1280x720.

    Raises:
        ValueError: If the image is none, a vertex is not finite, or `color_by` or `thickness` is not allowed.
    """
    canvas = as_rgb(image).copy()
    width = auto_thickness(canvas, thickness)
    _check_finite(polylines.vertices)
    colors = _piece_colors(polylines, color_by, directed)
    pieces, kept = _near(canvas, polylines.endpoints, width)
    owners = polylines.owners
    order = np.argsort(polylines.scores, kind="stable")
    for index in order:
        own = owners[kept] == index
        _stroke(canvas, list(pieces[own]), OUTLINE, _outlined(width))
        _stroke_colored(canvas, pieces[own], colors[kept][own], width)
    lines = list(polylines)
    for index in order if arrows and directed else ():
        _draw_heads(canvas, lines[index], colors[owners == index], width)
    return canvas


def draw_segments(
    image: NDArray[np.generic],
    segments: Segments,
    *,
    color_by: str = "direction",
    directed: bool = True,
    arrows: bool = False,
    thickness: Thickness = "auto",
) -> Canvas:
    """Gives the image with the segments drawn on it, by default with their direction as a hue.

    The arguments are those of `draw_polylines`; lines are a bit thinner. Thousands of segments are fine.
    """
    canvas = as_rgb(image).copy()
    width = max(1, auto_thickness(canvas, thickness) - (thickness == "auto"))
    _check_finite(segments.endpoints)
    colors = _piece_colors(segments, color_by, directed)
    pieces, kept = _near(canvas, segments.endpoints, width)
    order = np.argsort(segments.scores[kept], kind="stable")
    pieces, colors = pieces[order], colors[kept][order]
    _stroke(canvas, list(pieces), OUTLINE, _outlined(width))
    _stroke_colored(canvas, pieces, colors, width)
    for piece, color in zip(pieces, colors, strict=True) if arrows and directed else ():
        _draw_head(canvas, piece, color, width)
    return canvas


def draw_points(
    image: NDArray[np.generic],
    points: Float[np.ndarray, "n 2"],
    color: Color,
    *,
    radius: Thickness = "auto",
) -> Canvas:
    """Gives the image with a dot at each point (pixels); the default radius is the thickness of polylines."""
    canvas = as_rgb(image).copy()
    size = auto_thickness(canvas, radius)
    _check_finite(points)
    seen = ((points >= -2 * size) & (points <= np.array(canvas.shape[1::-1]) + 2 * size)).all(axis=1)
    for extra, fill in ((max(1, size // 2), OUTLINE), (0, color)):
        for x, y in _fixed(points[seen]).tolist():
            cv2.circle(canvas, (x, y), (size + extra) << _SHIFT, fill, cv2.FILLED, cv2.LINE_AA, _SHIFT)
    return canvas


def auto_thickness(image: Canvas, thickness: Thickness) -> int:
    """Gives the thickness in pixels: as given, or one that suits the size of the image.

    Raises:
        ValueError: If it is neither "auto" nor 1 to 1000.
    """
    if thickness == "auto":
        return max(1, round(float(np.sqrt(image.shape[0] * image.shape[1])) / 300))
    if 1 <= thickness <= 1000:
        return thickness
    raise ValueError(f"thickness is {thickness!r}, but must be 'auto' or 1 to 1000 pixels.")


def _piece_colors(lines: Polylines | Segments, color_by: str, directed: bool) -> UInt8[np.ndarray, "n 3"]:
    """Gives the color of each piece between two vertices."""
    if color_by == "direction":
        return direction_colors(lines.endpoints[:, 1] - lines.endpoints[:, 0], directed=directed)
    colors = item_colors(color_by, lines.labels, lines.scores)
    return colors[lines.owners] if isinstance(lines, Polylines) else colors


def _near(
    canvas: Canvas, pieces: Float[np.ndarray, "n 2 2"], width: int
) -> tuple[Float[np.ndarray, "m 2 2"], Int[np.ndarray, " m"]]:
    """Gives the parts of pieces that can be seen, and the index of the piece that each is a part of."""
    margin = _outlined(width)
    size = (canvas.shape[0] + 2 * margin, canvas.shape[1] + 2 * margin)
    parts, kept = clip_segments(pieces + margin, size)
    return parts - margin, kept


def _outlined(width: int) -> int:
    return width + 2 * ceil(width / 3)


def _check_finite(points: NDArray[np.float64]) -> None:
    if not np.isfinite(points).all():
        raise ValueError("Points with NaN or infinite coordinates cannot be drawn; remove them first.")


def _fixed(points: NDArray[np.float64]) -> NDArray[np.int32]:
    """Gives points as OpenCV draws them: centers of pixels are integers, with fractional bits."""
    return np.asarray(((points - 0.5) * (1 << _SHIFT)).round().astype(np.int32))


def _rgb(color: Sequence[int] | UInt8[np.ndarray, "rgb=3"]) -> Color:
    red, green, blue = map(int, color)
    return red, green, blue


def _stroke(
    canvas: Canvas,
    lines: Sequence[NDArray[np.float64]],
    color: Sequence[int],
    width: int,
    closed: bool = False,
) -> None:
    fixed = [_fixed(line) for line in lines if len(line) > 1]
    if fixed:
        cv2.polylines(canvas, fixed, closed, _rgb(color), width, cv2.LINE_AA, _SHIFT)


def _stroke_colored(
    canvas: Canvas, pieces: Float[np.ndarray, "n 2 2"], colors: UInt8[np.ndarray, "n 3"], width: int
) -> None:
    """Strokes pieces in their colors, runs of one color together; later pieces lie on top."""
    changes = np.flatnonzero((colors[1:] != colors[:-1]).any(axis=1)) + 1
    for start, stop in zip([0, *changes], [*changes, len(pieces)], strict=True):
        if start < stop:
            _stroke(canvas, list(pieces[start:stop]), _rgb(colors[start]), width)


def _head_length(width: int) -> float:
    return 6.0 * width + 4


def _draw_heads(
    canvas: Canvas, line: Float[np.ndarray, "v 2"], colors: UInt8[np.ndarray, "m 3"], width: int
) -> None:
    """Draws arrow heads evenly along a polyline, at least one, in the color of the piece under each."""
    at = cumulative_length(line)
    if len(line) < 2 or at[-1] < 3:
        return
    head = min(_head_length(width), at[-1] / 2)
    count = min(max(1, round(at[-1] / (12 * head))), 1000)
    tips = (np.arange(count) + 0.5) / count * (at[-1] - head) + head
    ends = [np.stack([np.interp(s, at, line[:, k]) for k in (0, 1)], axis=1) for s in (tips - head, tips)]
    under = np.clip(np.searchsorted(at, tips) - 1, 0, len(colors) - 1)
    seen = ((ends[1] >= 0) & (ends[1] <= canvas.shape[1::-1])).all(axis=1)
    for axis, color in zip(np.stack(ends, axis=1)[seen], colors[under[seen]], strict=True):
        _draw_head(canvas, axis, color, width)


def _draw_head(
    canvas: Canvas, axis: Float[np.ndarray, "2 2"], color: UInt8[np.ndarray, "rgb=3"], width: int
) -> None:
    """Draws one arrow head that ends at the end of `axis`, no longer than the thickness allows."""
    tip, way = axis[1], axis[1] - axis[0]
    length = float(np.hypot(way[0], way[1]))
    if length < 2:
        return
    back = way / length * min(_head_length(width), length)
    side = 0.45 * np.array([-back[1], back[0]])
    corners = np.stack([tip, tip - back + side, tip - 0.7 * back, tip - back - side])
    _stroke(canvas, [corners], OUTLINE, 1 + 2 * ceil(width / 3), closed=True)
    cv2.fillPoly(canvas, [_fixed(corners)], _rgb(color), cv2.LINE_AA, _SHIFT)
