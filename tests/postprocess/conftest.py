"""What the tests of the post-processing share: chains, noise, and lanes that meet in one point."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from yolino.grid import Grid, cells_to_pixels, discretize
from yolino.types import Polylines, Segments

CELL = 16.0


@pytest.fixture(scope="session")
def chain() -> Callable[..., Segments]:
    """Makes segments from vertex to vertex, in pixels."""

    def make(vertices: object, score: float = 1.0, label: int = 0) -> Segments:
        points = np.array(vertices, float)
        n = len(points) - 1
        endpoints = np.stack([points[:-1], points[1:]], axis=1)
        return Segments(endpoints, np.full(n, score), np.full(n, label))

    return make


@pytest.fixture(scope="session")
def join() -> Callable[..., Segments]:
    """Puts segments of several sets into one."""

    def make(*parts: Segments) -> Segments:
        return Segments(
            np.concatenate([p.endpoints for p in parts]),
            np.concatenate([p.scores for p in parts]),
            np.concatenate([p.labels for p in parts]),
        )

    return make


@pytest.fixture(scope="session")
def noisy() -> Callable[[int, int], Segments]:
    """Makes n candidates in heaps of about five around random segments, some of them opposite."""

    def make(seed: int, n: int) -> Segments:
        rng = np.random.default_rng(seed)
        count = max(n // 5, 1)
        middles, angles = rng.uniform(0, 160, (count, 2)), rng.uniform(-np.pi, np.pi, count)
        way = np.stack([np.cos(angles), np.sin(angles)], axis=1) * rng.uniform(4, 11, (count, 1))
        chosen = rng.integers(count, size=n)
        endpoints = np.stack([middles - way, middles + way], axis=1)[chosen]
        flip = rng.random(n) < 0.2
        endpoints[flip] = endpoints[flip][:, ::-1]
        return Segments(
            endpoints + rng.normal(0, 1, (n, 2, 2)), rng.uniform(0.3, 1, n), rng.integers(3, size=n)
        )

    return make


@pytest.fixture(scope="session")
def road() -> Callable[..., tuple[Polylines, Segments]]:
    """Makes the bent lanes of a road that meet at the horizon, and the segments a perfect network gives."""

    def make(seed: int, lanes: int, stride: int = 16) -> tuple[Polylines, Segments]:
        rng = np.random.default_rng(seed)
        height, width = 320, 640
        x, y = width * rng.uniform(0.35, 0.65), height * rng.uniform(0.15, 0.4)
        bend, t = width * rng.uniform(-0.15, 0.15), np.linspace(1, 0, 40)
        feet = np.linspace(-0.2, 1.2, lanes) * width
        lines = Polylines.from_list(
            [np.stack([x + t * (f - x) + bend * t * (1 - t), y + t * (height - y)], axis=1) for f in feet]
        )
        grid = Grid((height, width), stride)
        segments = cells_to_pixels(discretize(lines, grid, border=False), grid)
        return lines, segments[rng.permutation(len(segments))]

    return make
