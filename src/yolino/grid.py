"""Polylines to cells and back: slice, merge, extrapolate, drop (paper, Fig. 3), and the error of that.

A cell owns its left and top border: what runs exactly along the border between two cells belongs to the
right or the lower one, and on the right or bottom border of the image to the last column or row.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from yolino.geometry import clip_segments, distance_to_segments, follows, sample_segments
from yolino.types import CellSegments, Polylines, Segments

# Cell units. Coordinates this near to a border lie on it; chords this short are no segments.
_ON_BORDER = 1e-9
_SHORTEST = 1e-6


@dataclass(frozen=True)
class Grid:
    """The cells of an image: squares of `stride` pixels.

    Attributes:
        size: `(height, width)` of the image in pixels.
        stride: Side of a cell in pixels.

    Raises:
        ValueError: A size or the stride is not positive, or the stride does not divide the size.
    """

    size: tuple[int, int]
    stride: int

    def __post_init__(self) -> None:
        if self.stride < 1 or min(self.size) < 1:
            raise ValueError(
                f"size and stride must be positive, got size {self.size} and stride {self.stride}."
            )
        if any(s % self.stride for s in self.size):
            raise ValueError(
                f"size {self.size} (height, width) is not divisible by the stride {self.stride}: "
                f"choose multiples of {self.stride}."
            )

    @property
    def rows(self) -> int:
        """Number of cell rows."""
        return self.size[0] // self.stride

    @property
    def cols(self) -> int:
        """Number of cell columns."""
        return self.size[1] // self.stride


def discretize(polylines: Polylines, grid: Grid, *, border: bool) -> CellSegments:
    """Gives one straight chord for each visit of a polyline to a cell (paper, Sec. Pre-processing).

    A visit is an uninterrupted stay in one cell. Its chord runs from where the polyline enters (or starts)
    to where it leaves (or ends); vertices in between are dropped. A polyline may visit a cell several
    times. It is cut off exactly at the image border. Visits that end where they began (a spike, a ring
    within one cell) have no chord. Chords are ordered by polyline, then along it, and keep its direction.

    Args:
        polylines: Polylines in pixels of the image that the grid covers.
        grid: The cells.
        border: Whether every chord must run from cell border to cell border (representations 1D and Eu). A
            chord with a loose end is then extended along its direction if it covers more than half of the
            full chord through its cell, and dropped otherwise. If False, loose ends stay where they are
            (Po).

    Raises:
        ValueError: A vertex is NaN or infinite.
    """
    if not np.isfinite(polylines.vertices).all():
        row = int(np.flatnonzero(~np.isfinite(polylines.vertices).all(axis=1))[0])
        owner = int(np.searchsorted(polylines.offsets, row, side="right")) - 1
        raise ValueError(f"vertex {polylines.vertices[row]} of polyline {owner} is not finite: remove it.")
    parts, owners = _slice(polylines, grid)
    cells, endpoints, owners = _merge(parts, owners, grid)
    if border:
        endpoints, kept = _extrapolate(endpoints)
        cells, owners = cells[kept], owners[kept]
    return CellSegments(cells, endpoints, polylines.labels[owners], owners)


def cells_to_pixels(cell_segments: CellSegments, grid: Grid) -> Segments:
    """Gives the same segments in image pixels: `(cell_xy + (column, row)) * stride`, all with score 1."""
    endpoints = (cell_segments.endpoints + cell_segments.cells[:, None, ::-1]) * grid.stride
    return Segments(endpoints, labels=cell_segments.labels)


def deviation(polylines: Polylines, segments: Segments, spacing: float = 1.0) -> float:
    """Gives the mean distance between polylines and the segments they became, in pixels (paper, Tab. 6).

    It is the average of two means: of the distance from the points of the polylines to the nearest segment,
    and from the points of the segments to the nearest piece of a polyline, both taken every `spacing`
    pixels. Clip polylines that leave the image before (`yolino.geometry.clip_polylines`).

    Args:
        polylines: The original.
        segments: The discretized, in the same frame.
        spacing: Distance between the points, in pixels.

    Returns:
        The deviation in pixels: 0 if both are empty, infinite if only one of them is.
    """
    pieces = polylines.endpoints
    if len(pieces) == 0 or len(segments) == 0:
        return 0.0 if len(pieces) == len(segments) else float("inf")
    mean = 0.0
    for source, target in ((pieces, segments.endpoints), (segments.endpoints, pieces)):
        points, weights = sample_segments(source, spacing)
        distances = distance_to_segments(points, target)
        mean += float(np.average(distances, weights=weights) if weights.sum() > 0 else distances.mean()) / 2
    return mean


def surplus(cell_segments: CellSegments, grid: Grid, predictors: int) -> int:
    """Gives how many segments find no predictor, because their cell holds more than `predictors` of them."""
    flat = cell_segments.cells[:, 0] * grid.cols + cell_segments.cells[:, 1]
    counts = np.bincount(flat, minlength=grid.rows * grid.cols)
    return int(np.maximum(counts - predictors, 0).sum())


def _snap(points: Float[np.ndarray, "*shape 2"]) -> Float[np.ndarray, "*shape 2"]:
    """Gives `points` (cell units) with coordinates next to a cell border moved onto it."""
    nearest = np.rint(points)
    return np.where(np.abs(points - nearest) < _ON_BORDER, nearest, points)


def _differ(a: Float[np.ndarray, "n 2"], b: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
    return np.asarray((a[:, 0] != b[:, 0]) | (a[:, 1] != b[:, 1]))


def _slice(polylines: Polylines, grid: Grid) -> tuple[Float[np.ndarray, "s 2 2"], Int[np.ndarray, " s"]]:
    """Gives the polylines cut at the image border and at every grid line, in cell units, and their owners."""
    pieces = _snap(polylines.endpoints / grid.stride)
    owners = polylines.owners
    long = _differ(pieces[:, 0], pieces[:, 1])
    pieces, kept = clip_segments(pieces[long], (grid.rows, grid.cols))
    owners = owners[long][kept]
    start, end = pieces[:, 0], pieces[:, 1]
    delta = end - start
    lowest = np.floor(np.minimum(start, end)) + 1
    counts = np.maximum(np.ceil(np.maximum(start, end)) - lowest, 0).astype(np.int64).ravel()
    entry = np.repeat(np.arange(len(counts)), counts)
    piece, axis = entry // 2, entry % 2
    line = lowest.ravel()[entry] + np.arange(len(entry)) - np.repeat(np.cumsum(counts) - counts, counts)
    t = (line - start[piece, axis]) / delta[piece, axis]
    crossing = start[piece] + t[:, None] * delta[piece]
    crossing[np.arange(len(entry)), axis] = line
    every = np.arange(len(pieces))
    owner = np.concatenate([every, piece, every])
    order = np.lexsort((np.concatenate([np.zeros(len(pieces)), t, np.ones(len(pieces))]), owner))
    points = np.concatenate([start, crossing, end])[order]
    owner = owner[order]
    moves = (owner[1:] == owner[:-1]) & _differ(points[1:], points[:-1])
    parts = np.stack([points[:-1][moves], points[1:][moves]], axis=1)
    return parts, owners[owner[:-1][moves]]


def _merge(
    parts: Float[np.ndarray, "s 2 2"], owners: Int[np.ndarray, " s"], grid: Grid
) -> tuple[Int[np.ndarray, "n 2"], Float[np.ndarray, "n 2 2"], Int[np.ndarray, " n"]]:
    """Gives cells, chords (in the unit square) and owners of the visits that consecutive parts make up."""
    last_cell = np.array([grid.cols - 1.0, grid.rows - 1.0])
    corners = np.minimum(np.floor((parts[:, 0] + parts[:, 1]) / 2), last_cell)
    stays = follows(parts, owners, _SHORTEST) & ~_differ(corners[1:], corners[:-1])
    first = np.flatnonzero(np.append(True, ~stays)[: len(parts)])
    last = np.append(first[1:], len(parts))[: len(first)] - 1
    chords = np.stack([parts[first, 0], parts[last, 1]], axis=1) - corners[first, None]
    chords = np.clip(_snap(chords), 0.0, 1.0)
    run = np.abs(chords[:, 1] - chords[:, 0]) > _SHORTEST
    long = run[:, 0] | run[:, 1]
    return corners[first][long, ::-1].astype(np.int64), chords[long], owners[first][long]


def _extrapolate(
    chords: Float[np.ndarray, "n 2 2"],
) -> tuple[Float[np.ndarray, "m 2 2"], Bool[np.ndarray, " n"]]:
    """Gives the chords, with loose ends moved to the border or the chord dropped, and which stay."""
    inner = (chords > 0) & (chords < 1)
    loose = inner[..., 0] & inner[..., 1]
    start, delta = chords[:, 0], chords[:, 1] - chords[:, 0]
    level = delta == 0
    step = np.where(level, 1.0, delta)
    low, high = -start / step, (1.0 - start) / step
    enter, leave = (
        np.where(level, -np.inf, np.minimum(low, high)),
        np.where(level, np.inf, np.maximum(low, high)),
    )
    enter, leave = np.maximum(enter[:, 0], enter[:, 1]), np.minimum(leave[:, 0], leave[:, 1])
    full = np.stack([start + enter[:, None] * delta, start + leave[:, None] * delta], axis=1)
    full = np.clip(_snap(full), 0.0, 1.0)
    kept = ~(loose[:, 0] | loose[:, 1]) | (leave - enter < 2.0 - _ON_BORDER)
    return np.where(loose[:, :, None], full, chords)[kept], kept
