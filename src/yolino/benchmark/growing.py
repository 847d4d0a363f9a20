"""Measures how a call's time and memory grow with the size of its input."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from yolino.benchmark.clock import race
from yolino.benchmark.curves import Curve, Point
from yolino.benchmark.measure import Measure, Target, at_most
from yolino.benchmark.memory import peak_megabytes
from yolino.benchmark.setup import Setup

NEAR_LINEAR = at_most(1.2)
_ROUNDS, _SECONDS = 15, 0.6
_MILLI = 1e3


class Case(NamedTuple):
    """What is called at one size.

    Attributes:
        value: The size.
        run: What to call.
        label: The size in words, where the number says too little.
        fresh: What to call instead for its memory, where `run` keeps memory from one call to the next.
    """

    value: float | int
    run: Callable[[], object]
    label: str = ""
    fresh: Callable[[], object] | None = None


def grow(setup: Setup, name: str, title: str, x: str, cases: Sequence[Case]) -> Curve:
    """Measures time and memory of all sizes; sizes take turns, so a slow moment bends no curve.

    Args:
        setup: How to measure.
        name: See `Curve`.
        title: See `Curve`.
        x: See `Curve`.
        cases: What to call at each size, by rising size.
    """
    times = race(
        {str(number): case.run for number, case in enumerate(cases)},
        rounds=min(setup.repeats, _ROUNDS),
        seconds=min(setup.seconds, _SECONDS),
    )
    points = []
    for case, taken in zip(cases, times.values(), strict=True):
        low, high = taken.quartiles
        megabytes = peak_megabytes(case.fresh or case.run)
        cost = (taken.median * _MILLI, low * _MILLI, high * _MILLI, megabytes)
        points.append(Point(float(case.value), *cost, case.label))
    return Curve(name, title, x, tuple(points))


def exponents(curve: Curve, target: Target | None = NEAR_LINEAR) -> dict[str, Measure]:
    """Gives the exponents of a curve as measures: `NAME_time`, and `NAME_memory` where it is known.

    Args:
        curve: Time and memory against size.
        target: What both have to reach, or None.
    """
    found = {"time": curve.exponent, "memory": curve.memory_exponent}
    return {
        f"{curve.name}_{cost}": Measure(
            f"{curve.title}, by {curve.x}: exponent of the {cost}", value, target=target
        )
        for cost, value in found.items()
        if value is not None
    }


__all__ = ["NEAR_LINEAR", "Case", "exponents", "grow"]
