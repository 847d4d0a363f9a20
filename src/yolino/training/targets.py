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
        table: For each of the u cells that hold any, its segments by rank; -1 beyond its last one.
        turns: Rows of `table` that hold a segment of rank 0, then those that hold one of rank 1, and so on.
        counts: How many rows that are, for each rank: numbers that a GPU need not be asked for.
    """

    cells: Int[Tensor, " n"]
    ranks: Int[Tensor, " n"]
    endpoints: Float[Tensor, "n 2 2"]
    labels: Int[Tensor, " n"]
    ignored: Bool[Tensor, "b s"]
    table: Int[Tensor, "u l"]
    turns: Int[Tensor, " n"]
    counts: tuple[int, ...]


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
    ranks = np.arange(len(cells)) - first
    rows = np.cumsum(ranks == 0) - 1
    counts = np.bincount(ranks)
    table = np.full((counts[0] if len(counts) else 0, len(counts)), -1)
    table[rows, ranks] = np.arange(len(cells))
    return Targets(
        torch.from_numpy(cells),
        torch.from_numpy(ranks),
        torch.from_numpy(np.concatenate([s.endpoints for s in samples])),
        torch.from_numpy(np.concatenate([s.labels for s in samples])),
        torch.from_numpy(np.stack([s.ignored for s in samples])),
        torch.from_numpy(table),
        torch.from_numpy(rows[np.argsort(ranks, kind="stable")]),
        tuple(counts.tolist()),
    )
