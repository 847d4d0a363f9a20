"""Timing is fair, and measures know their targets."""

from __future__ import annotations

import numpy as np
import pytest

from yolino.benchmark.clock import Times, race
from yolino.benchmark.measure import Measure, Target, at_least, at_most, milliseconds, ratio


def test_contestants_take_turns_and_each_is_first_in_its_round():
    log: list[str] = []
    times = race(
        {name: lambda name=name: log.append(name) for name in "abc"}, rounds=4, seconds=100.0, calls=1
    )
    assert "".join(log) == "aabbcc" + "abc" + "bca" + "cab" + "abc"
    assert all(len(t.seconds) == 4 for t in times.values())


def test_a_slow_race_ends_after_three_rounds():
    assert len(race({"a": lambda: None}, rounds=50, seconds=0.0)["a"].seconds) == 3


def test_short_calls_are_repeated_within_a_turn():
    calls: list[int] = []
    race({"a": lambda: calls.append(1)}, rounds=1, seconds=0.0)
    assert len(calls) == 2 + 100


def test_a_ratio_is_the_median_of_the_rounds_ratios():
    slow, fast = Times(np.array([3.0, 8.0, 10.0])), Times(np.array([1.0, 1.0, 5.0]))
    found = ratio("x", slow, fast, at_least(4))
    assert (found.value, found.low, found.high) == (3.0, 2.5, 5.5)
    assert found.to_dict()["met"] is False
    assert milliseconds("y", fast).value == 1e3


@pytest.mark.parametrize(
    ("target", "value", "met"),
    [
        (at_least(3), 3.0, True),
        (at_least(3), 2.9, False),
        (at_most(3), 3.0, True),
        (at_most(3), 3.1, False),
        (Target("equal to", True), True, True),
        (Target("equal to", True), False, False),
        (at_least(3), None, None),
        (None, 3.0, None),
    ],
)
def test_a_target_is_met_or_missed_or_unknown(target, value, met):
    assert Measure("m", value, target=target).to_dict()["met"] is met
