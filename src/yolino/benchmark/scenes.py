"""Made-up input for the benchmark: converging lanes, noisy candidates around them, candidates in one heap."""

from __future__ import annotations

import math

import numpy as np

from yolino.grid import Grid, cells_to_pixels, discretize
from yolino.types import Output, Polylines, Segments

SIZE = (320, 640)
STRIDE = 16
LANES = 4
# Candidates in a picture of SIZE; more of them get a larger picture with more lanes, and are as dense.
_USUAL = 500
_NOISE_CELLS = 0.06
_CLUTTER = 0.1


def converging_lanes(
    rng: np.random.Generator,
    size: tuple[int, int],
    count: int,
    *,
    nearest: float = 0.0,
    vertices: int = 48,
) -> Polylines:
    """Gives lanes of one bent road from the bottom of the image to (or near) one vanishing point.

    Args:
        rng: Source of all randomness.
        size: `(height, width)` in pixels.
        count: Number of lanes.
        nearest: Where lanes end, as a fraction of the way from the vanishing point to the bottom.
        vertices: Vertices of each lane.
    """
    height, width = size
    x, y = width * rng.uniform(0.4, 0.6), height * rng.uniform(0.15, 0.3)
    bend = width * rng.uniform(-0.15, 0.15)
    feet = np.linspace(-0.25, 1.25, count) * width + rng.uniform(-0.05, 0.05, count) * width / count
    t = np.linspace(1.0, nearest, vertices)
    rows = y + t * (height - y)
    return Polylines.from_list(
        [np.stack([x + t * (foot - x) + bend * t * (1 - t), rows], axis=1) for foot in feet]
    )


def true_segments(lanes: Polylines, size: tuple[int, int], stride: int) -> Segments:
    """Gives the segments that a perfect network would give for the lanes, in pixels."""
    height, width = (-(-edge // stride) * stride for edge in size)
    grid = Grid((height, width), stride)
    return cells_to_pixels(discretize(lanes, grid, border=False), grid)


def noisy_candidates(
    rng: np.random.Generator,
    count: int,
    *,
    size: tuple[int, int] | None = None,
    stride: int = STRIDE,
) -> Segments:
    """Gives candidates as a network does: about five around each piece of a lane, a tenth of them clutter.

    Args:
        rng: Source of all randomness.
        count: Number of candidates.
        size: `(height, width)` in pixels; by default 320x640, and larger for more than 500 candidates.
        stride: Side of a cell in pixels.
    """
    scale = math.sqrt(max(count / _USUAL, 1.0))
    if size is None:
        size = (round(SIZE[0] * scale), round(SIZE[1] * scale))
    lanes = converging_lanes(rng, size, max(round(LANES * scale), 2), nearest=0.08)
    return candidates_around(rng, lanes, count, size, stride)


def candidates_around(
    rng: np.random.Generator, lines: Polylines, count: int, size: tuple[int, int], stride: int
) -> Segments:
    """Gives candidates around the pieces of lines, a tenth of them clutter, in any order.

    Args:
        rng: Source of all randomness.
        lines: What there is to see, in pixels.
        count: Number of candidates.
        size: `(height, width)` of the picture in pixels.
        stride: Side of a cell in pixels.
    """
    pieces = true_segments(lines, size, stride).endpoints
    clutter = round(_CLUTTER * count)
    chosen = pieces[rng.integers(len(pieces), size=count - clutter)]
    noisy = chosen + rng.normal(0, _NOISE_CELLS * stride, chosen.shape)
    starts = rng.uniform(0, (size[1], size[0]), (clutter, 2))
    angles, lengths = rng.uniform(-np.pi, np.pi, clutter), rng.uniform(0.3, 1.0, clutter) * stride
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1) * lengths[:, None]
    scores = np.concatenate([rng.beta(8, 2, count - clutter), rng.uniform(0.1, 0.8, clutter)])
    order = rng.permutation(count)
    return Segments(np.concatenate([noisy, np.stack([starts, starts + ways], axis=1)])[order], scores[order])


def heaped_candidates(rng: np.random.Generator, count: int, *, stride: int = STRIDE) -> Segments:
    """Gives candidates that all lie within one radius of the NMS: each is a neighbor of every other."""
    segment = np.array([[100.0, 100.0], [108.0, 88.0]])
    endpoints = segment + rng.uniform(-0.01, 0.01, (count, 2, 2)) * stride
    return Segments(endpoints, rng.beta(8, 2, count))


def as_output(candidates: Segments, predictors: int, threshold: float, classes: int) -> Output:
    """Gives the candidates as the output of a network for one image, spread among silent predictors.

    Args:
        candidates: What is found; their scores are moved above the threshold.
        predictors: Predictors of the image in all, at least as many as candidates.
        threshold: Lowest score that counts.
        classes: Number of classes.
    """
    at = np.linspace(0, predictors - 1, len(candidates)).round().astype(np.int64)
    endpoints = np.zeros((1, predictors, 2, 2), np.float32)
    scores = np.zeros((1, predictors), np.float32)
    endpoints[0, at] = candidates.endpoints
    scores[0, at] = np.minimum(threshold + 1e-3 + (1 - threshold) * candidates.scores, 1.0)
    if not classes:
        return Output(endpoints, scores, None)
    return Output(endpoints, scores, np.full((1, predictors, classes), 1 / classes, np.float32))


__all__ = [
    "LANES",
    "SIZE",
    "STRIDE",
    "as_output",
    "candidates_around",
    "converging_lanes",
    "heaped_candidates",
    "noisy_candidates",
    "true_segments",
]
