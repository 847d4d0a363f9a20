"""Polylines, segments and points on an image."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil

import numpy as np
from jaxtyping import Float, Int, UInt8
from numpy.typing import NDArray

from yolino.image import as_rgb
from yolino.types import Polylines, Segments
from yolino.viz.colors import OUTLINE, Color, direction_colors, item_colors
from yolino.viz.density import fitting_widths
from yolino.viz.heads import draw_heads, placed_axes
from yolino.viz.strokes import (
    Canvas,
    Thickness,
    as_color,
    auto_thickness,
    check_finite,
    dot,
    fixed,
    outlined,
    stroke,
    stroke_pieces,
    visible_polylines,
    visible_segments,
)

_JUNCTION: Color = (255, 255, 255)
_HEAD_SHARE = 0.4  # of a segment that its arrow head may cover
_EXACT = 6  # decimals of a pixel to which vertices are the same


def draw_polylines(
    image: NDArray[np.generic],
    polylines: Polylines,
    *,
    color_by: str = "identity",
    directed: bool = True,
    arrows: bool = True,
    junctions: bool = False,
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
        junctions: Whether white dots mark where polylines fork, merge or cross (`find_junctions`).
        thickness: Pixels, or "auto": 3 in an image of 1280x720, and less where many lines would cover
            it or lie close to each other.

    Raises:
        ValueError: If the image is none, a vertex is not finite, or `color_by` or `thickness` is not allowed.
    """
    canvas = as_rgb(image).copy()
    check_finite(polylines.vertices)
    colors = None
    if color_by != "direction":
        colors = item_colors(color_by, polylines.labels, polylines.scores)
    seen = visible_polylines(canvas, polylines, _margin(canvas, thickness))
    widths = fitting_widths(canvas, seen, thickness)
    _draw_lines(canvas, seen, colors, widths, directed)
    if arrows and directed:
        rows, first = np.unique(seen.labels, return_index=True)
        _draw_arrows(canvas, polylines[rows], None if colors is None else colors[rows], widths[first])
    if junctions:
        radius = max(2, ceil(1.3 * int(widths.max(initial=1))))
        _draw_dots(canvas, find_junctions(polylines), _JUNCTION, radius)
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
    check_finite(segments.endpoints)
    if color_by == "direction":
        delta = segments.endpoints[:, 1] - segments.endpoints[:, 0]
        colors = direction_colors(delta, directed=directed)
    else:
        colors = item_colors(color_by, segments.labels, segments.scores)
    width = auto_thickness(canvas, thickness)
    if thickness == "auto":
        width = max(1, round(0.8 * width))
    draw_colored(canvas, segments, colors, width, arrows=arrows and directed)
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
    check_finite(points)
    _draw_dots(canvas, points, color, auto_thickness(canvas, radius))
    return canvas


def find_junctions(polylines: Polylines) -> Float[np.ndarray, "n 2"]:
    """Gives the vertices, in pixels, that several polylines share and from which three ways or more lead.

    So forks, merges and crossings with a common vertex; not where one polyline goes on as another, nor along
    two polylines that lie upon each other.
    """
    owners = np.repeat(np.arange(len(polylines)), np.diff(polylines.offsets))
    rounded = polylines.vertices.round(_EXACT) + 0.0
    places, group = np.unique(rounded[:, 0] + 1j * rounded[:, 1], return_inverse=True)
    group = group.reshape(-1)
    several = _count_different(group, owners, len(places)) > 1
    first = np.flatnonzero(owners[1:] == owners[:-1])
    pairs = np.concatenate([group[[first, first + 1]], group[[first + 1, first]]], axis=1)
    pairs = pairs[:, pairs[0] != pairs[1]]
    junctions = places[several & (_count_different(pairs[0], pairs[1], len(places)) > 2)]
    return np.stack([junctions.real, junctions.imag], axis=1)


def _count_different(
    group: Int[np.ndarray, " n"], values: Int[np.ndarray, " n"], groups: int
) -> Int[np.ndarray, " g"]:
    """Gives how many different values each group has."""
    base = int(values.max(initial=0)) + 1
    return np.bincount(np.unique(group * base + values) // base, minlength=groups)


def draw_colored(
    canvas: Canvas, segments: Segments, colors: UInt8[np.ndarray, "n 3"], width: int, *, arrows: bool
) -> None:
    """Strokes segments on the canvas in their colors, the best score on top."""
    pieces, kept = visible_segments(canvas, segments.endpoints, outlined(width))
    order = np.argsort(segments.scores[kept], kind="stable")
    pieces, colors = pieces[order], colors[kept][order]
    stroke(canvas, list(fixed(pieces)), OUTLINE, outlined(width))
    stroke_pieces(canvas, pieces, colors, width)
    if arrows:
        heads = pieces.copy()
        heads[:, 0] += (1 - _HEAD_SHARE) * (pieces[:, 1] - pieces[:, 0])
        draw_heads(canvas, heads, colors, np.full(len(heads), width))


def _margin(canvas: Canvas, thickness: Thickness) -> int:
    return outlined(auto_thickness(canvas, thickness))


def _draw_lines(
    canvas: Canvas,
    lines: Polylines,
    colors: UInt8[np.ndarray, "n 3"] | None,
    widths: Int[np.ndarray, " m"],
    directed: bool,
) -> None:
    """Strokes lines, each labelled with the row of its color; without colors, by direction."""
    points, offsets = fixed(lines.vertices), lines.offsets
    pieces, firsts = lines.endpoints, lines.offsets - np.arange(len(lines) + 1)
    hues = direction_colors(pieces[:, 1] - pieces[:, 0], directed=directed) if colors is None else None
    for index in np.argsort(lines.scores, kind="stable"):
        line, width = [points[offsets[index] : offsets[index + 1]]], int(widths[index])
        stroke(canvas, line, OUTLINE, outlined(width))
        if hues is not None:
            own = slice(firsts[index], firsts[index + 1])
            stroke_pieces(canvas, pieces[own], hues[own], width)
        elif colors is not None:
            stroke(canvas, line, as_color(colors[lines.labels[index]]), width)


def _draw_arrows(
    canvas: Canvas,
    polylines: Polylines,
    colors: UInt8[np.ndarray, "n 3"] | None,
    widths: Int[np.ndarray, " n"],
) -> None:
    axes, rows = placed_axes(canvas, polylines, widths)
    owners = polylines.owners[rows]
    if colors is None:
        pieces = polylines.endpoints[rows]
        hues = direction_colors(pieces[:, 1] - pieces[:, 0])
    else:
        hues = colors[owners]
    order = np.argsort(polylines.scores[owners], kind="stable")
    draw_heads(canvas, axes[order], hues[order], widths[owners][order])


def _draw_dots(canvas: Canvas, points: Float[np.ndarray, "n 2"], color: Color, size: int) -> None:
    draw_dots(canvas, [(points, color)], size)


def draw_dots(canvas: Canvas, groups: Sequence[tuple[Float[np.ndarray, "_ 2"], Color]], size: int) -> None:
    """Draws dots of so many pixels radius on the canvas, later groups on top of earlier ones.

    All outlines lie below all colors, so that dots close to each other do not hide each other's color.
    """
    limits = np.array(canvas.shape[1::-1]) + 2 * size
    places: list[tuple[list[Int[np.ndarray, " xy"]], Color]] = [
        (list(fixed(points[((points >= -2 * size) & (points <= limits)).all(axis=1)])), color)
        for points, color in groups
    ]
    for extra in (max(1, ceil(size / 3)), 0):
        for shown, color in places:
            for place in shown:
                dot(canvas, place, size + extra, OUTLINE if extra else color)
