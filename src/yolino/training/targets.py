"""Targets: the labels of a batch as Cartesian segments per cell, independent of any representation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from numpy.typing import NDArray
from torch import Tensor

from yolino.grid import Grid, discretize
from yolino.types import Polylines


class CellTargets(NamedTuple):
    """The labels of one image, sorted by cell.

    Attributes:
        cells: Cell number `row * cols + column` of each segment.
        endpoints: Start and end point in cell units.
        labels: Class index of each segment.
        ignored: Cells that lie in an ignore region: their free predictors are not punished.
    """

    cells: Int[np.ndarray, " n"]
    endpoints: Float[np.ndarray, "n 2 2"]
    labels: Int[np.ndarray, " n"]
    ignored: Bool[np.ndarray, " s"]


class Targets(NamedTuple):
    """The labels of a batch. Segments are flat over the batch and sorted by cell.

    Attributes:
        cells: Number `image * S + row * cols + column` of each segment's cell in the batch.
        ranks: Which of the segments of its cell each one is: 0, 1, ... (the paper's j).
        endpoints: Start and end point in cell units.
        labels: Class index of each segment.
        ignored: Cells of each image that lie in an ignore region.
    """

    cells: Int[Tensor, " n"]
    ranks: Int[Tensor, " n"]
    endpoints: Float[Tensor, "n 2 2"]
    labels: Int[Tensor, " n"]
    ignored: Bool[Tensor, "b s"]


def ignored_cells(ignore: Sequence[NDArray[np.float64]], grid: Grid) -> NDArray[np.bool_]:
    """Gives for each cell, row by row, whether any part of it lies in one of the polygons (pixels)."""
    mask = np.zeros((grid.rows, grid.cols), np.uint8)
    for polygon in ignore:
        cv2.fillPoly(mask, [np.floor(np.asarray(polygon) / grid.stride).astype(np.int32)], 1)
    return mask.astype(np.bool_).ravel()


def cell_targets(
    polylines: Polylines, grid: Grid, *, border: bool, ignore: Sequence[NDArray[np.float64]] = ()
) -> CellTargets:
    """Cuts the polylines (pixels) into cells; segments of ignored cells are dropped."""
    segments = discretize(polylines, grid, border=border)
    cells = segments.cells[:, 0] * grid.cols + segments.cells[:, 1]
    ignored = ignored_cells(ignore, grid)
    order = np.argsort(cells, kind="stable")
    order = order[~ignored[cells[order]]]
    return CellTargets(
        cells[order], segments.endpoints[order].astype(np.float32), segments.labels[order], ignored
    )


def collate(samples: Sequence[CellTargets]) -> Targets:
    """Joins the targets of the images of a batch."""
    size = len(samples[0].ignored)
    cells = np.concatenate([s.cells + i * size for i, s in enumerate(samples)])
    first = np.searchsorted(cells, cells, side="left")
    return Targets(
        torch.from_numpy(cells),
        torch.from_numpy(np.arange(len(cells)) - first),
        torch.from_numpy(np.concatenate([s.endpoints for s in samples])),
        torch.from_numpy(np.concatenate([s.labels for s in samples])),
        torch.from_numpy(np.stack([s.ignored for s in samples])),
    )
