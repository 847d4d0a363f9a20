"""Windows over a scene of any size, such that exactly one of them answers for each cell of the scene.

All windows begin at multiples of 32 pixels of the network's input, the coarsest stride of its backbone. So
the cells of all windows coincide, and a cell gets the same answer from every window that sees enough of what
is around it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from yolino.header import Header
from yolino.types import Segments

STRIDE = 32
OVERLAP = 256


class Window(NamedTuple):
    """One window of a plan, in pixels of the network's input counted from the corner of the scene.

    Attributes:
        left: Left edge, which may lie before the scene.
        top: Upper edge.
        core: The part that this window answers for, `(left, top, right, bottom)`: multiples of 32 inside the
            window. The cores of a plan cover the scene without overlap.
    """

    left: int
    top: int
    core: tuple[int, int, int, int]


@dataclass(frozen=True)
class WindowPlan:
    """Where the windows over one scene lie: `len(plan)` of them, `plan[i]` row by row.

    Neighbors share `overlap` pixels or more; the last of each row and column is moved inwards, so that it
    hangs over the scene by less than 32 pixels. A scene smaller than a window has one.

    Attributes:
        extent: `(height, width)` of the scene in pixels of the network's input, a started one counts.
        window: `(height, width)` of a window.
        overlap: What neighbors share at least, a multiple of 32; each answers for its half.
        offset: How far before the scene the first window begins, down and right: multiples of 32. The lines
            do not depend on it.

    Raises:
        ValueError: A size is not positive, or overlap or offset do not fit the windows.
    """

    extent: tuple[int, int]
    window: tuple[int, int]
    overlap: int
    offset: tuple[int, int] = (0, 0)

    def __post_init__(self) -> None:
        if min(*self.extent, *self.window) < 1:
            raise ValueError(
                f"Sizes must be positive, got a scene of {self.extent} and windows of {self.window}."
            )
        largest = min(_largest_step(edge) for edge in self.window) - STRIDE
        if largest < 0:
            raise ValueError(f"Windows of {self.window} are too small: both edges must be at least {STRIDE}.")
        if self.overlap % STRIDE or not 0 <= self.overlap <= largest:
            raise ValueError(
                f"The overlap is {self.overlap}, but windows of {self.window[0]} x {self.window[1]} pixels "
                f"need a multiple of {STRIDE} from 0 to {largest}."
            )
        steps = (_largest_step(edge) - self.overlap for edge in self.window)
        if any(n % STRIDE or not 0 <= n < step for n, step in zip(self.offset, steps, strict=True)):
            raise ValueError(
                f"The offset is {self.offset}, but must be multiples of {STRIDE}, less than a step."
            )

    def __len__(self) -> int:
        rows, columns = self._axes
        return len(rows) * len(columns)

    def __getitem__(self, index: int) -> Window:
        rows, columns = self._axes
        if not 0 <= index < len(self):
            raise IndexError(f"Window {index} of {len(self)}.")
        row, column = rows[index // len(columns)], columns[index % len(columns)]
        return Window(column.start, row.start, (column.low, row.low, column.high, row.high))

    def __iter__(self) -> Iterator[Window]:
        return (self[i] for i in range(len(self)))

    @cached_property
    def _axes(self) -> tuple[list[_Stretch], list[_Stretch]]:
        height, width = (
            _stretches(extent, edge, self.overlap, offset)
            for extent, edge, offset in zip(self.extent, self.window, self.offset, strict=True)
        )
        return height, width


class _Stretch(NamedTuple):
    """What a window is along one axis: where it starts, and from where to where it answers."""

    start: int
    low: int
    high: int


def plan_windows(
    size: tuple[int, int], header: Header, *, overlap: int | None = None, offset: tuple[int, int] = (0, 0)
) -> WindowPlan:
    """Gives the windows of a model over a scene.

    Args:
        size: `(height, width)` of the scene in its own pixels.
        header: Of the model; its `size` is one window, its `scale` the pixels of the network per pixel.
        overlap: What neighbors share, in pixels of the network; by default a quarter of the window, at most
            256.
        offset: See `WindowPlan`.

    Raises:
        ValueError: Overlap or offset do not fit the windows.
    """
    height, width = (max(math.ceil(side * header.scale - 1e-6), 1) for side in size)
    if overlap is None:
        overlap = min(OVERLAP, min(header.size) // 4 // STRIDE * STRIDE)
    return WindowPlan((height, width), header.size, overlap, offset)


def owned_predictors(window: Window, header: Header) -> Bool[np.ndarray, " n"]:
    """Tells of each predictor of the network whether its cell lies in the core of the window.

    The cells are in the order of the network's output: row by row, all predictors of a cell in a row.
    """
    left, top, right, bottom = window.core
    y, x = (np.arange(0, edge, header.stride) for edge in header.size)
    rows = (y + window.top >= top) & (y + window.top < bottom)
    columns = (x + window.left >= left) & (x + window.left < right)
    return np.repeat((rows[:, None] & columns).ravel(), header.predictors)


def drop_invalid(segments: Segments, valid: Bool[np.ndarray, "h w"] | None) -> Segments:
    """Gives the segments whose midpoint lies in a valid pixel of the window, or next to one at its edge.

    Args:
        segments: In pixels of the window.
        valid: Which pixels of the window say anything, None: all.
    """
    if valid is None:
        return segments
    last = np.array(valid.shape[::-1]) - 1
    x, y = np.clip(np.floor(segments.midpoints), 0, last).astype(np.int64).T
    return segments[valid[y, x]]


def join_segments(parts: Sequence[Segments], size: tuple[int, int], header: Header) -> Segments:
    """Gives the segments of all windows as one value, in an order that does not depend on the windows.

    Those whose midpoint lies beyond the scene are dropped.

    Args:
        parts: Segments in pixels of the network's input, counted from the corner of the scene.
        size: `(height, width)` of the scene in its own pixels.
        header: Of the model.
    """
    endpoints = np.concatenate([np.zeros((0, 2, 2)), *(part.endpoints for part in parts)])
    scores = np.concatenate([np.zeros(0), *(part.scores for part in parts)])
    order = np.lexsort((*endpoints.reshape(-1, 4).T, scores))
    middles = endpoints[order].mean(axis=1) / header.scale
    order = order[(middles >= 0).all(axis=1) & (middles <= size[::-1]).all(axis=1)]
    shares = None
    if classes := len(header.classes):
        shares = np.concatenate([np.zeros((0, classes)), *(_shares(part) for part in parts if len(part))])[
            order
        ]
    return Segments(endpoints[order], scores[order], probabilities=shares)


def _shares(part: Segments) -> Float[np.ndarray, "n c"]:
    if part.probabilities is None:
        raise ValueError("The network gave no class probabilities, but its header names classes.")
    return part.probabilities


def _largest_step(edge: int) -> int:
    """Gives the largest multiple of 32 by which windows of this edge can follow each other without gaps."""
    return edge // STRIDE * STRIDE


def _stretches(extent: int, edge: int, overlap: int, offset: int) -> list[_Stretch]:
    step = _largest_step(edge) - overlap
    last = -(-(extent - edge) // STRIDE) * STRIDE  # the first multiple from which a window reaches the end
    starts = [*range(-offset, last, step), max(last, -offset)]
    middles = [max((a + edge + b) // 2, 0) // STRIDE * STRIDE for a, b in pairwise(starts)]
    end = -(-extent // STRIDE) * STRIDE
    return [_Stretch(*stretch) for stretch in zip(starts, [0, *middles], [*middles, end], strict=True)]


__all__ = [
    "OVERLAP",
    "STRIDE",
    "Window",
    "WindowPlan",
    "drop_invalid",
    "join_segments",
    "owned_predictors",
    "plan_windows",
]
