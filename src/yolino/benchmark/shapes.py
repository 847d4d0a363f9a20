"""Made-up scenes of all shapes, and segments of them as networks of different quality give them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from yolino.datasets.synthetic_shapes import KINDS
from yolino.grid import Grid, cells_to_pixels, discretize
from yolino.types import Polylines, Segments

SIZE = (960, 960)
STRIDE = 16
SHAPES = ("line", "dashes", "two-way", "branch", "branch", "loop", "crossing")
_CLUTTER = 0.05
# These two lines share vertices but do not meet: one is moved, else TOPO takes them for a junction.
_APART = ("two-way", "crossing")
_STEP = (1.5, 1.5)


class Quality(NamedTuple):
    """How good segments are.

    Attributes:
        title: In words.
        jitter_cells: Standard deviation of the end points, in cells.
        turn: Standard deviation of the angle, in radians.
        clutter: False segments for each true one.
        lost: Share of the segments that are missing.
    """

    title: str
    jitter_cells: float = 0.0
    turn: float = 0.0
    clutter: float = 0.0
    lost: float = 0.0


QUALITIES = {
    "perfect": Quality("perfect segments"),
    "noisy": Quality("end points off by .1 cells", 0.1, 0.05, _CLUTTER),
    "rough": Quality("end points off by .2 cells", 0.2, 0.1, _CLUTTER),
    "lost10": Quality("10 % of the segments lost", lost=0.1),
    "lost30": Quality("30 % of the segments lost", lost=0.3),
}


def shapes(rng: np.random.Generator) -> Polylines:
    """Gives a curve, dashes, a two-way line, two branches, a loop and a crossing, in pixels."""
    lines = []
    for kind in SHAPES:
        drawn = [shape.vertices for shape in KINDS[kind](rng, SIZE)]
        if kind in _APART:
            drawn[1] = drawn[1] + _STEP
        lines += drawn
    return Polylines.from_list(lines)


def segments_of(lines: Polylines, quality: Quality, rng: np.random.Generator) -> Segments:
    """Gives the segments that a network of this quality would give for the lines, in pixels."""
    grid = Grid(SIZE, STRIDE)
    endpoints = cells_to_pixels(discretize(lines, grid, border=False), grid).endpoints
    endpoints = endpoints[rng.random(len(endpoints)) >= quality.lost]
    endpoints = _turn(endpoints, rng.normal(0, 1, len(endpoints)) * quality.turn)
    endpoints = endpoints + rng.normal(0, 1, endpoints.shape) * quality.jitter_cells * STRIDE
    count = round(quality.clutter * len(endpoints))
    starts = rng.uniform(0, (SIZE[1], SIZE[0]), (count, 2))
    angles, lengths = rng.uniform(-np.pi, np.pi, count), rng.uniform(0.3, 1.0, count) * STRIDE
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1) * lengths[:, None]
    scores = np.concatenate([np.ones(len(endpoints)), rng.uniform(0.3, 0.8, count)])
    order = rng.permutation(len(scores))
    return Segments(
        np.concatenate([endpoints, np.stack([starts, starts + ways], axis=1)])[order], scores[order]
    )


def _turn(endpoints: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Gives the segments turned around their middles."""
    middles, halves = endpoints.mean(axis=1), (endpoints[:, 1] - endpoints[:, 0]) / 2
    cosines, sines = np.cos(angles), np.sin(angles)
    x = cosines * halves[:, 0] - sines * halves[:, 1]
    y = sines * halves[:, 0] + cosines * halves[:, 1]
    ways = np.stack([x, y], axis=1)
    return np.stack([middles - ways, middles + ways], axis=1)


__all__ = ["QUALITIES", "SHAPES", "SIZE", "STRIDE", "Quality", "segments_of", "shapes"]
