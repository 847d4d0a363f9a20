"""The cells of a network, and the segments of its predictors in them."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from numpy.typing import NDArray

from yolino.geometry import transform_points
from yolino.grid import Grid
from yolino.types import Segments
from yolino.viz.colors import direction_colors, palette
from yolino.viz.lines import draw_colored
from yolino.viz.strokes import Canvas, Thickness, auto_thickness, check_finite, enlarge

_GRID, _OCCUPIED = 45, 40  # levels by which grid lines and cells with segments differ from the image
_BRIGHTEST = 190  # level from which on a dark image is not made brighter
_READABLE = 64  # pixels of a cell in which its segments can be told apart
_LARGEST = 4096  # pixels of an enlarged picture


def draw_cells(
    image: NDArray[np.generic],
    segments: Segments,
    grid: Grid,
    *,
    predictors: Int[np.ndarray, " n"] | None = None,
    matrix: Float[np.ndarray, "3 3"] | None = None,
    directed: bool = True,
    zoom: int = 1,
    thickness: Thickness = "auto",
) -> Canvas:
    """Gives the image with the cells of a grid, and segments in the color of the predictor that gave each.

    Grid lines, and the cells that hold the middle of a segment, are darker than a bright image and brighter
    than a dark one.

    Args:
        image: RGB or gray pixels.
        segments: In pixels of the image.
        grid: The cells, in the network's frame.
        predictors: Index of each segment's predictor within its cell; None colors by direction instead.
        matrix: From pixels of the network's frame to those of the image, without rotation; None: they are
            the same.
        directed: False draws no arrows and gives opposite directions the same hue.
        zoom: Pixels of the picture per pixel of the image, which is enlarged first (`readable_zoom`).
        thickness: Pixels, or "auto": what suits the size of the cells.

    Raises:
        ValueError: If the image is none, a coordinate is not finite, `zoom` is not positive, or the number of
            predictors is not that of the segments.
    """
    if zoom < 1 or (predictors is not None and len(predictors) != len(segments)):
        raise ValueError(
            f"zoom must be at least 1 and there must be one predictor per segment, got zoom {zoom} and "
            f"{'no' if predictors is None else len(predictors)} predictors of {len(segments)} segments."
        )
    check_finite(segments.endpoints)
    canvas = enlarge(image, zoom)
    zoomed = np.diag([zoom, zoom, 1.0])
    to_canvas = zoomed if matrix is None else zoomed @ matrix
    drawn = segments.with_endpoints(segments.endpoints * zoom)
    _shade(canvas, drawn, grid, to_canvas)
    if predictors is None:
        delta = drawn.endpoints[:, 1] - drawn.endpoints[:, 0]
        colors = direction_colors(delta, directed=directed)
    else:
        colors = palette(predictors)
    width = auto_thickness(canvas, thickness)
    if thickness == "auto":
        width = max(1, min(width, round(cell_edge(grid, to_canvas) / 20)))
    draw_colored(canvas, drawn, colors, width, arrows=directed)
    return canvas


def cell_edge(grid: Grid, matrix: Float[np.ndarray, "3 3"]) -> float:
    """Gives the shorter edge of a cell in pixels of the frame that `matrix` maps to."""
    return float(min(abs(matrix[0, 0]), abs(matrix[1, 1]))) * grid.stride


def readable_zoom(size: tuple[int, int], edge: float) -> int:
    """Gives by how much an image is to be enlarged so that segments in its cells can be told apart.

    Args:
        size: `(height, width)` of the image in pixels.
        edge: Edge of a cell in pixels of the image.

    Returns:
        A factor that gives cells of 64 px, but no picture of more than 4096 px; at least 1.
    """
    return max(1, min(int(np.ceil(_READABLE / edge - 1e-9)), _LARGEST // max(size)))


def _shade(canvas: Canvas, segments: Segments, grid: Grid, matrix: Float[np.ndarray, "3 3"]) -> None:
    """Shows the grid and the occupied cells, brighter or darker than what they lie on."""
    offset, scale = matrix[:2, 2], matrix[[0, 1], [0, 1]] * grid.stride
    shape = (grid.rows, grid.cols)
    places = [(np.arange(n) + 0.5 - offset[axis]) / scale[axis] for axis, n in enumerate(canvas.shape[1::-1])]
    inside = [(at >= 0) & (at < shape[1 - axis]) for axis, at in enumerate(places)]
    cols, rows = (np.floor(at).astype(np.int64) for at in places)
    at = np.floor(transform_points(segments.midpoints, np.linalg.inv(matrix)) / grid.stride).astype(np.int64)
    held = at[((at >= 0) & (at < shape[::-1])).all(axis=1)]
    occupied = np.zeros(shape, np.bool_)
    occupied[held[:, 1], held[:, 0]] = True
    lit = np.zeros(canvas.shape[:2], np.bool_)
    lit[np.ix_(inside[1], inside[0])] = occupied[rows[inside[1]]][:, cols[inside[0]]]
    line = max(1, round(float(np.abs(scale).min()) / 48))
    near = [
        _near_lines(at, line / abs(float(scale[axis])), shape[1 - axis]) for axis, at in enumerate(places)
    ]
    lines = (near[0] & inside[1][:, None]) | (near[1][:, None] & inside[0])
    _shift(canvas, _GRID * lines.astype(np.uint8) + _OCCUPIED * lit.astype(np.uint8))


def _near_lines(at: Float[np.ndarray, " n"], width: float, cells: int) -> Bool[np.ndarray, " n"]:
    """Tells which pixels, with centers `at` (cell units), belong to the lines, `width` cells wide."""
    nearest = np.rint(at)
    distance = at - nearest
    return np.asarray((-width / 2 <= distance) & (distance < width / 2) & (nearest >= 0) & (nearest <= cells))


def _shift(canvas: Canvas, levels: UInt8[np.ndarray, "h w"]) -> None:
    """Makes a dark canvas brighter by so many levels and a bright one darker, but where there is no room."""
    smooth = cv2.boxFilter(canvas, -1, (15, 15)).mean(axis=2)
    darker = smooth > (_BRIGHTEST if canvas.mean() < 127.5 else 255 - _BRIGHTEST)
    amount = np.repeat(levels[:, :, None], 3, axis=2)
    canvas[:] = np.where(darker[:, :, None], cv2.subtract(canvas, amount), cv2.add(canvas, amount))


__all__ = ["cell_edge", "draw_cells", "readable_zoom"]
