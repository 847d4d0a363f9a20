"""Confidence intervals by drawing images."""

from __future__ import annotations

import numpy as np
import pytest

from yolino.metrics.bootstrap import bootstrap_intervals
from yolino.metrics.points import PointMetric
from yolino.metrics.tusimple import TuSimpleMetric
from yolino.types import Polylines


def lines(*heights: float) -> Polylines:
    return Polylines.from_list([[[10, y], [60, y]] for y in heights])


def test_equal_images_leave_no_doubt() -> None:
    metric = PointMetric()
    for _ in range(5):
        metric.update(lines(20, 50), lines(20), (100, 200))
    intervals = bootstrap_intervals(metric, np.random.default_rng(0), resamples=20)
    assert intervals == {"precision": (0.5, 0.5), "recall": (1, 1), "f1": (pytest.approx(2 / 3),) * 2}


def test_the_interval_of_a_mean_is_that_of_the_normal_distribution() -> None:
    rng = np.random.default_rng(1)
    metric, rows = TuSimpleMetric(), np.arange(100.0)
    right = rng.integers(0, 101, 400)
    for count in right:
        metric.update_lanes([np.where(rows < count, 300.0, 900.0)], [np.full(100, 300.0)], rows)
    mean, error = right.mean() / 100, right.std() / 100 / np.sqrt(400)
    for confidence, width in ((0.95, 1.96), (0.68, 0.994)):
        low, high = bootstrap_intervals(metric, rng, resamples=2000, confidence=confidence)["accuracy"]
        assert low == pytest.approx(mean - width * error, abs=0.2 * error)
        assert high == pytest.approx(mean + width * error, abs=0.2 * error)


def test_ratios_are_drawn_as_ratios_of_sums() -> None:
    metric = PointMetric()
    metric.update(lines(20), lines(20), (100, 200))
    metric.update(lines(80), lines(20, 40, 60), (100, 200))
    # Two images: both the first (recall 1), one of each (.25), both the second (0).
    low, high = bootstrap_intervals(metric, np.random.default_rng(2), resamples=500, confidence=0.99)[
        "recall"
    ]
    assert (low, high) == (0, 1)
    low, high = bootstrap_intervals(metric, np.random.default_rng(2), resamples=500, confidence=0.2)["recall"]
    assert (low, high) == (0.25, 0.25)


def test_the_generator_decides() -> None:
    metric = PointMetric()
    for y in range(20, 90, 3):
        metric.update(lines(y), lines(y, *range(y % 7)), (100, 200))
    first, same, other = (
        bootstrap_intervals(metric, np.random.default_rng(seed), resamples=30)["f1"] for seed in (0, 0, 1)
    )
    assert first == same != other


def test_bad_arguments_are_named() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match="first image"):
        bootstrap_intervals(PointMetric(), rng)
    with pytest.raises(ValueError, match="confidence must be between"):
        bootstrap_intervals(PointMetric(), rng, confidence=1.0)
    with pytest.raises(ValueError, match="resamples must be at least 1"):
        bootstrap_intervals(PointMetric(), rng, resamples=0)
