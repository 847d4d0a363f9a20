"""What tuning makes as large as it can: one number for any choice of images."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from yolino.datasets import Dataset, TuSimple
from yolino.evaluate import point_radius
from yolino.header import Header
from yolino.metrics import METRICS, Metric

Scores = Mapping[str, Float[np.ndarray, " b"]]
_LANES, _POINTS = "lanes", "f1"
_BY_CLASS = "classes"  # compares classes, which no linker parameter makes


def _lanes(scores: Scores) -> Float[np.ndarray, " b"]:
    return np.asarray(scores["accuracy"] - scores["fp"] / 2 - scores["fn"] / 2)


OBJECTIVES: dict[str, tuple[str, str, Callable[[Scores], Float[np.ndarray, " b"]] | None]] = {
    _LANES: ("accuracy - FP / 2 - FN / 2 of the TuSimple benchmark", "tusimple", _lanes),
    "accuracy": ("the accuracy of the TuSimple benchmark alone", "tusimple", None),
    _POINTS: ("F1 of the paper's point metric over the polylines", "points", None),
    **{
        name: (f"{kind.headline} of the metric {name}", name, None)
        for name, kind in METRICS.items()
        if name not in ("tusimple", "points", _BY_CLASS)
    },
}
"""By name: what it is, its metric in `METRICS`, and how it is computed (None: the metric's headline)."""


@dataclass(frozen=True)
class Objective:
    """The number to make large.

    Attributes:
        name: A name in `OBJECTIVES`.
        meaning: What it is.
        make: Gives its metric without images.
    """

    name: str
    meaning: str
    make: Callable[[], Metric]

    def values(self, metric: Metric, weights: Float[np.ndarray, "b n"]) -> Float[np.ndarray, " b"]:
        """Gives the number of each choice of the metric's images: how often each counts."""
        scores = metric.weighted(weights)
        formula = OBJECTIVES[self.name][2]
        return np.asarray(scores[metric.headline] if formula is None else formula(scores))


def build_objective(name: str | None, header: Header, dataset: Dataset) -> Objective:
    """Gives an objective for a model on a dataset.

    Args:
        name: A name in `OBJECTIVES`; None: `lanes` for TuSimple, else `f1`.
        header: The model's.
        dataset: The images.

    Raises:
        ValueError: The name is unknown.
    """
    if name is None:
        name = _LANES if isinstance(dataset, TuSimple) else _POINTS
    if name not in OBJECTIVES:
        from yolino.config import suggest

        raise ValueError(
            f"The metric {name!r} is unknown; {suggest(name, OBJECTIVES)}use one of {', '.join(OBJECTIVES)}."
        )
    meaning, metric, _ = OBJECTIVES[name]
    offered = {"directed": header.directed and dataset.directed, "radius": point_radius(header)}
    known = inspect.signature(METRICS[metric]).parameters
    arguments: dict[str, Any] = {k: v for k, v in offered.items() if k in known and v is not None}

    def make() -> Metric:
        return METRICS[metric](**arguments)

    return Objective(name, meaning, make)


__all__ = ["OBJECTIVES", "Objective", "build_objective"]
