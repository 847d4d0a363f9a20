"""Sections `discretize` and `points`: what is done with labels, in training and in scoring."""

from __future__ import annotations

import numpy as np

from yolino.benchmark.baselines.loop_points import match_in_a_loop
from yolino.benchmark.clock import race
from yolino.benchmark.measure import TRUE, Measure, Section, at_least, at_most, milliseconds, ratio
from yolino.benchmark.scenes import SIZE, STRIDE, converging_lanes
from yolino.benchmark.setup import FRAME_SIZE, Setup
from yolino.grid import Grid, discretize
from yolino.metrics.points import match_points
from yolino.metrics.samples import sample_lines
from yolino.types import Polylines

_LANES = 5
_TARGET_MS = 3
DISCRETIZE = f"Five lanes of 48 vertices each in {SIZE[0]}x{SIZE[1]}, cut into cells of {STRIDE} px."
POINTS = (
    "Five lanes in 720x1280 against five noisy ones, a sample per pixel, from lines to true positives. "
    "The other matches the same samples in a loop over the ground-truth ones, comparing all predicted "
    "samples at once with numpy in each turn."
)


def measure_discretize(setup: Setup) -> Section:
    """Times the cutting of one label, with loose ends and from border to border."""
    lanes, grid = converging_lanes(setup.rng, SIZE, _LANES), Grid(SIZE, STRIDE)
    times = race(
        {
            "points": lambda: discretize(lanes, grid, border=False),
            "border": lambda: discretize(lanes, grid, border=True),
        },
        **setup.pace,
    )
    titles = {"points": "loose ends stay", "border": "from border to border"}
    measures = {
        name: milliseconds(f"5-lane label, {titles[name]}", times[name], at_most(_TARGET_MS))
        for name in times
    }
    return Section("Polylines to cells", DISCRETIZE, measures)


def measure_points(setup: Setup) -> Section:
    """Times the point metric of one image."""
    size = SIZE if setup.quick else FRAME_SIZE
    truth = converging_lanes(setup.rng, size, _LANES, nearest=0.08)
    noise = np.random.default_rng(1).normal(0, 2.0, truth.vertices.shape)
    prediction = truth.with_vertices(truth.vertices + noise)
    radius = size[1] / 50

    def loop() -> int:
        found, wanted = sample_lines(prediction, size), sample_lines(truth, size)
        return int(match_in_a_loop(found, wanted, radius).sum())

    times = race({"ours": lambda: _match(prediction, truth, size), "loop": loop}, **setup.pace)
    same = _match(prediction, truth, size) == loop()
    samples = len(sample_lines(truth, size))
    measures = {
        "ours": milliseconds(f"{samples} ground-truth samples: yolino", times["ours"]),
        "loop": milliseconds(f"{samples} ground-truth samples: loop", times["loop"]),
        "speedup": ratio("yolino is faster", times["loop"], times["ours"], at_least(80)),
        "identical": Measure("same number of true positives", same, target=TRUE),
    }
    return Section("Point metric beside a loop", POINTS, measures)


def _match(prediction: Polylines, truth: Polylines, size: tuple[int, int]) -> int:
    return len(match_points(prediction, truth, size).pairs)


__all__ = ["measure_discretize", "measure_points"]
