"""How a cost grows with the size of what it is for: points, and the slope through them on two log axes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

_LEAST_POINTS = 3
_LEAST_MEGABYTES = 1.0  # below, the few pages that any call touches count for more than its data
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Point:
    """What a call costs at one size.

    Attributes:
        value: The size.
        median: Median of the time.
        low: First quartile of the time.
        high: Third quartile of the time.
        megabytes: Memory that the call takes (see `peak_megabytes`); None where the system does not tell.
        label: The size in words, where the number says too little.
    """

    value: float
    median: float
    low: float
    high: float
    megabytes: float | None = None
    label: str = ""


@dataclass(frozen=True)
class Curve:
    """Time and memory against size.

    Attributes:
        name: A name that stays the same.
        title: What was called.
        x: What the size counts; curves with the same one belong together.
        points: What a call costs, by rising size.
        unit: Unit of the times.
    """

    name: str
    title: str
    x: str
    points: tuple[Point, ...]
    unit: str = "ms"

    @property
    def exponent(self) -> float | None:
        """Exponent of the time: 1 is linear, 2 is quadratic; None if there is but one point."""
        return growth_exponent([p.value for p in self.points], [p.median for p in self.points])

    @property
    def memory_exponent(self) -> float | None:
        """Exponent of the memory; None where it is not known, or less than a megabyte."""
        costs = [p.megabytes for p in self.points if p.megabytes is not None]
        sizes = [p.value for p in self.points]
        if not sizes or len(costs) < len(sizes):
            return None
        upper = [(x, y) for x, y in zip(sizes, costs, strict=True) if x >= upper_start(sizes)]
        if min(y for _, y in upper) < _LEAST_MEGABYTES:
            return None
        return growth_exponent([x for x, _ in upper], [y for _, y in upper])

    def to_dict(self) -> dict[str, Any]:
        """Gives the curve as JSON has it."""
        return {
            "name": self.name,
            "title": self.title,
            "x": self.x,
            "unit": self.unit,
            "points": [asdict(point) for point in self.points],
            "exponent": self.exponent,
            "memory_exponent": self.memory_exponent,
        }


def growth_exponent(sizes: Sequence[float | int], costs: Sequence[float | int]) -> float | None:
    """Gives the slope of the costs' logarithm over that of the sizes, by least squares over the upper sizes.

    Small sizes are left out, as what a call costs in any case would hide how it grows: only the upper half of
    the range (on the log axis) counts, but at least a decade and at least the three largest sizes.

    Args:
        sizes: Positive sizes, in any order.
        costs: What each of them costs, positive.

    Returns:
        The exponent; None without two different sizes.
    """
    if len(set(sizes)) < 2:
        return None
    start = upper_start(sizes)
    pairs = [(math.log(x), math.log(y)) for x, y in zip(sizes, costs, strict=True) if x >= start]
    x, y = np.array(pairs).T
    x = x - x.mean()
    return float(x @ (y - y.mean()) / (x @ x))


def upper_start(sizes: Sequence[float | int]) -> float:
    """Gives the size from which on sizes count for the exponent (see `growth_exponent`)."""
    ordered = sorted(sizes)
    middle = math.sqrt(ordered[0] * ordered[-1])
    return float(min(middle, ordered[-1] / 10, ordered[-_LEAST_POINTS:][0])) * (1 - _ROUNDING)


__all__ = ["Curve", "Point", "growth_exponent", "upper_start"]
