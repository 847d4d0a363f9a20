"""A linker in plain Python: two nested loops over the segments, chains, and scipy's smoothing spline."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.interpolate import splev, splprep

from yolino.types import Polylines, Segments

_RADIUS_CELLS = 0.75
_SMOOTHING = 0.05
_SAMPLES_PER_SEGMENT = 3


def link_in_loops(segments: Segments, cell_size: float) -> Polylines:
    """Joins each segment to the nearest start ahead of its end, and draws a spline through each chain."""
    starts = (segments.starts / cell_size).tolist()
    ends = (segments.ends / cell_size).tolist()
    chains = _chains(_successors(starts, ends))
    lines = [_spline(starts, ends, chain) * cell_size for chain in chains if len(chain) > 1]
    return Polylines.from_list(lines)


def _successors(starts: list[list[float]], ends: list[list[float]]) -> dict[int, int]:
    """Gives the successor of each segment that has one; of several that want it, the nearest gets it."""
    links: list[tuple[float, int, int]] = []
    for i, (x, y) in enumerate(ends):
        dx, dy = x - starts[i][0], y - starts[i][1]
        nearest, successor = _RADIUS_CELLS**2, -1
        for j, (u, v) in enumerate(starts):
            squared = (u - x) ** 2 + (v - y) ** 2
            if squared >= nearest or i == j:
                continue
            if (ends[j][0] - u) * dx + (ends[j][1] - v) * dy > 0 and (u - starts[i][0]) * dx + (
                v - starts[i][1]
            ) * dy > 0:
                nearest, successor = squared, j
        if successor >= 0:
            links.append((nearest, i, successor))
    successors: dict[int, int] = {}
    taken: set[int] = set()
    for _, i, j in sorted(links):
        if j not in taken:
            successors[i] = j
            taken.add(j)
    return successors | {-1 - i: i for i in range(len(starts)) if i not in taken}


def _chains(successors: dict[int, int]) -> list[list[int]]:
    """Gives the chains from those that nobody precedes (noted under negative numbers)."""
    chains = []
    for root in [j for i, j in successors.items() if i < 0]:
        chain = [root]
        while chain[-1] in successors:
            chain.append(successors[chain[-1]])
        chains.append(chain)
    return chains


def _spline(starts: list[list[float]], ends: list[list[float]], chain: list[int]) -> np.ndarray:
    """Gives points on the smoothing spline through first start, midpoints and last end, in cell units."""
    points = [starts[chain[0]]]
    points += [
        [(starts[i][0] + ends[i][0]) / 2, (starts[i][1] + ends[i][1]) / 2]
        for i in chain
        if math.dist(starts[i], ends[i]) > 0
    ]
    points.append(ends[chain[-1]])
    knots: Any = splprep(np.array(points).T, s=_SMOOTHING, k=min(3, len(points) - 1))[0]
    x, y = splev(np.linspace(0, 1, _SAMPLES_PER_SEGMENT * len(chain)), knots)
    return np.stack([x, y], axis=1)


__all__ = ["link_in_loops"]
