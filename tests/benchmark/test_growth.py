"""Growth: the exponent is that of the curve, memory is what a call takes, and larger scenes are as dense."""

from __future__ import annotations

import math
import sys
import time

import numpy as np
import pytest

from yolino.benchmark.curves import Curve, Point, growth_exponent
from yolino.benchmark.growing import NEAR_LINEAR, Case, exponents, grow
from yolino.benchmark.growth import PER_LINE, lines_apart
from yolino.benchmark.measure import at_most
from yolino.benchmark.memory import peak_megabytes
from yolino.benchmark.scenes import STRIDE
from yolino.benchmark.setup import Setup
from yolino.postprocess import NMS, ChainLinker

SIZES = [100, 300, 1000, 3000, 10_000, 30_000, 100_000]


def curve(costs: list[float], megabytes: list[float | None] | None = None) -> Curve:
    memory = megabytes or [None] * len(costs)
    sizes = SIZES[: len(costs)]
    points = (Point(float(x), y, y, y, mb) for x, y, mb in zip(sizes, costs, memory, strict=True))
    return Curve("one", "One", "candidates", tuple(points))


@pytest.mark.parametrize(
    ("cost", "exponent"),
    [
        (lambda n: 3.0 * n, 1.0),
        (lambda n: n**2 / 7, 2.0),
        (lambda n: 5.0, 0.0),
        (math.sqrt, 0.5),
        # d log(n log n) / d log n = 1 + 1 / log n: 1.12 at 3,000, 1.09 at 100,000
        (lambda n: n * math.log(n), 1.1),
    ],
)
def test_the_exponent_is_that_of_the_curve(cost, exponent):
    found = growth_exponent(SIZES, [cost(n) for n in SIZES])
    assert found == pytest.approx(exponent, abs=0.005 if exponent == 1.1 else 1e-12)


def test_the_exponent_is_the_least_squares_slope():
    # log2 sizes 0, 1, 2, log2 costs 0, 1, 5: slope (-1 * (0 - 2) + 1 * (5 - 2)) / 2
    assert growth_exponent([1, 2, 4], [1, 2, 32]) == pytest.approx(2.5)
    assert growth_exponent([4, 1, 2], [32, 1, 2]) == pytest.approx(2.5)


def test_what_every_call_costs_does_not_hide_the_growth():
    costs = [10.0, 10.0, 10.0, *(n / 300 for n in SIZES[3:])]
    assert growth_exponent(SIZES, costs) == pytest.approx(1.0)


def test_at_least_a_decade_and_three_sizes_count():
    assert growth_exponent([1, 10, 11, 100], [1, 1, 1, 1000]) != pytest.approx(0.0, abs=0.5)
    decade = growth_exponent([1, 2, 5, 10], [1, 2, 5, 10])
    assert decade == pytest.approx(1.0)
    # Of 1 to 10 all sizes count, though the middle of the range is above 3.
    assert growth_exponent([1, 4, 7, 10], [100, 4, 7, 10]) != pytest.approx(1.0, abs=0.1)
    assert growth_exponent([1, 1e3, 1e6], [1, 1, 1e6]) == pytest.approx(1.0)


def test_one_point_has_no_exponent():
    assert growth_exponent([5], [1.0]) is None
    assert growth_exponent([], []) is None
    assert curve([3.0]).exponent is None
    assert exponents(curve([3.0])) == {}


def test_the_exponent_of_the_memory_needs_megabytes():
    times = [float(n) for n in SIZES]
    enough = curve(times, [n / 1e3 for n in SIZES])
    assert enough.memory_exponent == pytest.approx(1.0)
    assert curve(times, [n / 1e6 for n in SIZES]).memory_exponent is None
    assert curve(times).memory_exponent is None
    assert curve(times, [None, *(5.0 for _ in SIZES[1:])]).memory_exponent is None
    assert curve([]).memory_exponent is None


def test_exponents_are_measures_with_a_target():
    found = exponents(curve([n**2.0 for n in SIZES], [n / 1e3 for n in SIZES]))
    assert list(found) == ["one_time", "one_memory"]
    assert at_most(1.2) == NEAR_LINEAR
    assert [measure.to_dict()["met"] for measure in found.values()] == [False, True]
    assert found["one_time"].title == "One, by candidates: exponent of the time"
    assert exponents(curve([1.0, 2.0]), None)["one_time"].target is None


def test_a_curve_is_measured_at_each_size(tmp_path):
    cases = [Case(n, lambda n=n: time.sleep(0.004 * n), f"{n} naps") for n in (1, 2, 4)]
    found = grow(Setup(tmp_path, repeats=3, seconds=0.0), "naps", "Naps", "naps", cases)
    assert [(point.value, point.label) for point in found.points] == [
        (1, "1 naps"),
        (2, "2 naps"),
        (4, "4 naps"),
    ]
    assert all(4 * p.value <= p.low <= p.median <= p.high for p in found.points)
    assert found.exponent == pytest.approx(1.0, abs=0.3)
    assert set(found.to_dict()["points"][0]) == {"value", "median", "low", "high", "megabytes", "label"}


def test_memory_is_measured_on_what_stands_for_a_fresh_start(tmp_path):
    calls = []
    case = Case(1, lambda: None, fresh=lambda: calls.append(1))
    grow(Setup(tmp_path, repeats=1, seconds=0.0), "one", "One", "x", [case])
    assert calls == [1] or peak_megabytes(lambda: None) is None


@pytest.mark.skipif(sys.platform != "linux", reason="the system counts memory on Linux only")
def test_the_peak_is_what_a_call_takes_even_if_it_gives_it_back():
    def take(megabytes: int) -> float:
        return float(np.ones(megabytes * 125_000).sum())

    take(40)  # what was freed before does not count as there
    for megabytes in (16, 64):
        assert peak_megabytes(lambda m=megabytes: take(m)) == pytest.approx(megabytes, abs=1.5)
    assert peak_megabytes(lambda: None) < 1


def test_elsewhere_memory_is_not_known(monkeypatch):
    monkeypatch.setattr(sys, "platform", "darwin")
    assert peak_megabytes(lambda: None) is None


@pytest.mark.parametrize("count", [1, 2, 30])
def test_every_line_has_its_own_field_and_as_many_candidates(count):
    candidates = lines_apart(np.random.default_rng(3), count)
    assert len(candidates) == PER_LINE * count
    again = lines_apart(np.random.default_rng(3), count)
    np.testing.assert_array_equal(candidates.endpoints, again.endpoints)
    lines = ChainLinker(float(STRIDE), min_length_cells=4.0)(NMS(float(STRIDE))(candidates))
    assert 0.9 * count <= len(lines) <= 1.1 * count
