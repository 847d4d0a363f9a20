"""What a benchmark finds: measures with a unit and a target, in sections."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import Any, Literal

import numpy as np

from yolino.benchmark.clock import Times
from yolino.benchmark.curves import Curve

Bound = Literal["at least", "at most", "equal to"]
_MILLI = 1e3


@dataclass(frozen=True)
class Target:
    """What a measure has to reach."""

    bound: Bound
    value: float | bool

    def met(self, value: float | bool) -> bool:
        """Tells whether `value` reaches it."""
        if self.bound == "equal to":
            return value == self.value
        return value >= self.value if self.bound == "at least" else value <= self.value


@dataclass(frozen=True)
class Measure:
    """One number.

    Attributes:
        title: What was measured.
        value: The median; None if it could not be measured, then `note` says why.
        unit: Unit of `value`, `low`, `high` and the target.
        low: First quartile, where there are several values.
        high: Third quartile.
        target: What it has to reach, or None.
        note: What else is to be said.
    """

    title: str
    value: float | bool | None
    unit: str = ""
    low: float | None = None
    high: float | None = None
    target: Target | None = None
    note: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Gives the measure as JSON has it."""
        target, value = self.target, self.value
        return {
            "title": self.title,
            "value": value,
            "unit": self.unit,
            "low": self.low,
            "high": self.high,
            "target": target.value if target else None,
            "bound": target.bound if target else None,
            "met": target.met(value) if target is not None and value is not None else None,
            "note": self.note,
        }


@dataclass(frozen=True)
class Section:
    """Measures that belong together.

    Attributes:
        title: What they are about.
        about: How they were taken, and what the others are that they are compared with.
        measures: The measures, by a name that stays the same.
        not_measured: Why there are none, or an empty text.
        curves: How costs grow with size.
    """

    title: str
    about: str
    measures: Mapping[str, Measure] = field(default_factory=dict)
    not_measured: str = ""
    curves: Sequence[Curve] = ()

    def to_dict(self) -> dict[str, Any]:
        """Gives the section as JSON has it."""
        return {
            "title": self.title,
            "about": self.about,
            "not_measured": self.not_measured or None,
            "measures": {name: measure.to_dict() for name, measure in self.measures.items()},
            "curves": [curve.to_dict() for curve in self.curves],
        }


def at_least(value: float | int) -> Target:
    """Gives the target `>= value`."""
    return Target("at least", float(value))


def at_most(value: float | int) -> Target:
    """Gives the target `<= value`."""
    return Target("at most", float(value))


TRUE = Target("equal to", True)


def milliseconds(title: str, times: Times, target: Target | None = None, *, note: str = "") -> Measure:
    """Gives the time of a call."""
    return _of_values(title, times.seconds * _MILLI, "ms", target, note)


def ratio(title: str, slow: Times, fast: Times, target: Target | None = None, *, note: str = "") -> Measure:
    """Gives how many times as long `slow` takes: the median of the ratios of each round."""
    return _of_values(title, slow.seconds / fast.seconds, "x", target, note)


def percent(
    title: str, shares: np.ndarray | list[float], target: Target | None = None, *, note: str = ""
) -> Measure:
    """Gives shares (1 is all) in percent."""
    return _of_values(title, 100 * np.asarray(shares, np.float64), "%", target, note)


def missing(title: str, unit: str, target: Target | None, why: str) -> Measure:
    """Gives a measure that could not be taken."""
    return Measure(title, None, unit, target=target, note=f"not measured: {why}")


def _of_values(title: str, values: np.ndarray, unit: str, target: Target | None, note: str) -> Measure:
    low, middle, high = (float(q) for q in np.quantile(values, (0.25, 0.5, 0.75)))
    return Measure(title, middle, unit, low, high, target, note)


_EXTRAS = {
    "sklearn": "pip install scikit-learn",
    "openvino": "needs yolino[openvino], pip install 'yolino[openvino]'",
}


def lacking(*modules: str) -> str:
    """Gives what to do about the first of `modules` that is not installed, or an empty text."""
    for name in modules:
        if find_spec(name) is None:
            return _EXTRAS.get(name, "needs yolino[train], pip install 'yolino[train]'")
    return ""


__all__ = [
    "TRUE",
    "Measure",
    "Section",
    "Target",
    "at_least",
    "at_most",
    "lacking",
    "milliseconds",
    "missing",
    "percent",
    "ratio",
]
