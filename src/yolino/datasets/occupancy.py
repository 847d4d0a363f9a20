"""How many segments the cells of many images hold, counted without making the segments: compiled."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Float, Int

from yolino.compiled import compiled
from yolino.datasets.batch import Batch
from yolino.datasets.report import Occupancy, Size
from yolino.geometry import clip_polylines, transform_points
from yolino.grid import Grid
from yolino.types import Polylines

Matrix = Float[np.ndarray, "3 3"]

# As in yolino.grid: cell units. Coordinates this near to a border lie on it; chords this short are none.
_ON_BORDER = 1e-9
_SHORTEST = 1e-6


class Frame(NamedTuple):
    """The frame that cells are cut in.

    Attributes:
        matrix: From the image frame to it, or what gives it for an image size; None: it is the image frame.
        size: Its `(height, width)`; None: that of the image.
    """

    matrix: Matrix | Callable[[Size], Matrix] | None = None
    size: Size | None = None

    def place(self, polylines: Polylines, image: Size) -> Polylines:
        """Gives polylines of an image of this size in the frame, cut off at its border."""
        if self.matrix is None or self.size is None:
            return clip_polylines(polylines, image)
        matrix = self.matrix(image) if callable(self.matrix) else self.matrix
        return clip_polylines(
            polylines.with_vertices(transform_points(polylines.vertices, matrix)), self.size
        )

    def grid(self, image: Size, stride: int) -> Grid:
        """Gives the cells for an image of this size; without a size of its own, filled up to whole cells."""
        size = self.size or (-(-image[0] // stride) * stride, -(-image[1] // stride) * stride)
        return Grid(size, stride)


def occupancy(batch: Batch, frame: Frame, strides: Sequence[int], predictors: int) -> tuple[Occupancy, ...]:
    """Gives how full the cells of each stride are, of all samples whose image has a known size.

    Counts what `yolino.grid.discretize` makes with loose ends, in a small part of its time. Polylines with a
    vertex that is not finite do not count.

    Args:
        batch: The samples.
        frame: The frame that cells are cut in.
        strides: Sides of the cells, in pixels of the frame.
        predictors: Predictors per cell that the cells are compared with.
    """
    totals = [Occupancy(stride, predictors) for stride in strides]
    finite = batch.finite
    for size in dict.fromkeys(batch.sizes):
        if size is not None:
            of_size = np.array([one == size for one in batch.sizes], np.bool_)
            chosen = np.flatnonzero(finite & of_size[batch.samples])
            # The label says the sample, so that it is known after cutting off.
            lines = batch.lines[chosen]
            lines = Polylines(lines.vertices, lines.offsets, labels=batch.samples[chosen])
            placed = frame.place(lines, size)
            for i, stride in enumerate(strides):
                counts = count_cells(placed, frame.grid(size, stride), predictors)
                totals[i] += Occupancy(stride, predictors, *counts.tolist())
    return tuple(totals)


def count_cells(polylines: Polylines, grid: Grid, predictors: int) -> Int[np.ndarray, " four"]:
    """Gives the number of segments, of filled cells, of segments in the fullest cell, and the surplus.

    Args:
        polylines: Polylines of many images, cut off at the border of the grid. The label is the image; the
            polylines of an image follow one another.
        grid: The cells of each image.
        predictors: Predictors per cell; further segments are surplus.
    """
    cells = polylines.vertices / grid.stride
    nearest = np.rint(cells)
    cells = np.where(np.abs(cells - nearest) < _ON_BORDER, nearest, cells)
    counted = _count(cells, polylines.offsets, polylines.labels, (grid.rows, grid.cols), predictors)
    return np.asarray(counted)


@compiled
@no_type_check
def _count(vertices, offsets, images, shape, predictors):
    """Counts for polylines in cell units."""
    cells = np.zeros(shape[0] * shape[1], np.int64)
    filled = np.empty(len(cells), np.int64)
    used = 0
    totals = np.zeros(4, np.int64)
    for i in range(len(images)):
        if i > 0 and images[i] != images[i - 1]:
            _sum_up(cells, filled[:used], predictors, totals)
            used = 0
        used = _walk(vertices[offsets[i] : offsets[i + 1]], shape, cells, filled, used)
    _sum_up(cells, filled[:used], predictors, totals)
    return totals


@compiled
@no_type_check
def _sum_up(cells, filled, predictors, totals):
    """Adds the cells of one image to the totals and empties them."""
    for cell in filled:
        totals[0] += cells[cell]
        totals[1] += 1
        totals[2] = max(totals[2], cells[cell])
        totals[3] += max(cells[cell] - predictors, 0)
        cells[cell] = 0


@compiled
@no_type_check
def _walk(line, shape, cells, filled, used):
    """Counts one segment in each cell that a polyline visits, each time; gives how many cells are filled.

    A visit is an uninterrupted stay. The order of the operations is that of `yolino.grid.discretize`, so that
    both round alike.
    """
    row, col = -1, -1
    enter_x, enter_y = 0.0, 0.0
    for k in range(1, len(line)):
        ax, ay, bx, by = line[k - 1, 0], line[k - 1, 1], line[k, 0], line[k, 1]
        x_lines, x_line, x_step = _lines_between(ax, bx)
        y_lines, y_line, y_step = _lines_between(ay, by)
        px, py = ax, ay
        for last in range(x_lines + y_lines, -1, -1):
            tx = (x_line - ax) / (bx - ax) if x_lines > 0 else np.inf
            ty = (y_line - ay) / (by - ay) if y_lines > 0 else np.inf
            if last == 0:
                qx, qy = bx, by
            elif tx <= ty:
                qx, qy = x_line, ay + tx * (by - ay)
                x_lines, x_line = x_lines - 1, x_line + x_step
            else:
                qx, qy = ax + ty * (bx - ax), y_line
                y_lines, y_line = y_lines - 1, y_line + y_step
            if px == qx and py == qy:
                continue
            to_row = int(min(np.floor((py + qy) / 2), shape[0] - 1))
            to_col = int(min(np.floor((px + qx) / 2), shape[1] - 1))
            if to_row != row or to_col != col:
                if row >= 0 and _is_long(enter_x, enter_y, px, py):
                    used = _fill(row * shape[1] + col, cells, filled, used)
                row, col, enter_x, enter_y = to_row, to_col, px, py
            px, py = qx, qy
    if row >= 0 and _is_long(enter_x, enter_y, line[-1, 0], line[-1, 1]):
        used = _fill(row * shape[1] + col, cells, filled, used)
    return used


@compiled
@no_type_check
def _lines_between(a, b):
    """Gives the number of grid lines strictly between two coordinates, the first from a, and the step."""
    lowest, highest = np.floor(min(a, b)) + 1, np.ceil(max(a, b)) - 1
    count = max(int(highest - lowest) + 1, 0)
    return (count, lowest, 1.0) if a <= b else (count, highest, -1.0)


@compiled
@no_type_check
def _is_long(ax, ay, bx, by):
    """Tells whether a chord is a segment."""
    return abs(bx - ax) > _SHORTEST or abs(by - ay) > _SHORTEST


@compiled
@no_type_check
def _fill(cell, cells, filled, used):
    if cells[cell] == 0:
        filled[used] = cell
        used += 1
    cells[cell] += 1
    return used


__all__ = ["Frame", "count_cells", "occupancy"]
