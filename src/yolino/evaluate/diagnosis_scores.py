"""The scores of one row of a diagnosis: those of `yolino.evaluate.evaluate`, for any draw of the images."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from yolino.datasets import Dataset, TuSimple
from yolino.datasets.tusimple import polylines_to_record
from yolino.evaluate.oracles import Found
from yolino.metrics import PointMetric, TuSimpleMetric
from yolino.metrics.tusimple import Lanes, lanes_at_rows
from yolino.types import Polylines, Sample

LOWER_IS_BETTER = ("fp", "fn")
_DRAWS = 1000
_TAILS = (0.025, 0.975)


class Columns(NamedTuple):
    """Lines and labels of one image as columns at rows.

    Attributes:
        predicted: The x of each line in each row, negative where there is none.
        labelled: The same of each label.
        rows: The rows.
    """

    predicted: Lanes
    labelled: Lanes
    rows: Sequence[float]


def columns_of(
    dataset: Dataset, index: int, sample: Sample, polylines: Polylines, size: tuple[int, int]
) -> Columns:
    """Gives lines and labels at the rows of the label file, or, without such rows, at rows of the image."""
    if isinstance(dataset, TuSimple):
        label = dataset.record(index)
        found = polylines_to_record(label["raw_file"], polylines, label["h_samples"], size=size)
        return Columns(found["lanes"], label["lanes"], label["h_samples"])
    rows = np.arange(16, 72) * size[0] / 72
    labelled = lanes_at_rows(sample.polylines, rows, size)
    return Columns(lanes_at_rows(polylines, rows, size), labelled, rows.tolist())


class Scoreboard:
    """Scores of one row, image by image.

    Args:
        dataset: Where the images are from.
        directed: Whether the opposite direction is another line.
        radius: Of the point metric in pixels; None for its own. With a radius there is no accuracy: the
            model goes over scenes in windows.
    """

    def __init__(self, dataset: Dataset, *, directed: bool, radius: float | None) -> None:
        self.dataset = dataset
        self.lines = PointMetric(directed=directed, radius=radius)
        self.segments = PointMetric(directed=directed, radius=radius)
        self.tusimple: TuSimpleMetric | None = TuSimpleMetric()
        if radius is not None and not isinstance(dataset, TuSimple):
            self.tusimple = None

    def add(self, index: int, sample: Sample, size: tuple[int, int], found: Found) -> None:
        """Adds what was found in one image."""
        self.lines.update(found.polylines, sample.polylines, size, sample.ignore)
        self.segments.update(found.segments, sample.polylines, size, sample.ignore)
        if len(sample.ignore):
            self.tusimple = None
        if self.tusimple is not None:
            self.tusimple.update_lanes(*columns_of(self.dataset, index, sample, found.polylines, size))

    def weighted(self, weights: Float[np.ndarray, "b n"]) -> dict[str, Float[np.ndarray, " b"]]:
        """Gives the scores by name, once for each row of weights: how often each image counts."""
        scores: dict[str, Float[np.ndarray, " b"]] = {}
        if self.tusimple is not None:
            found = self.tusimple.weighted(weights)
            scores = {name: found[name] for name in ("accuracy", "fp", "fn")}
        scores |= self.lines.weighted(weights)
        return scores | {"segment_f1": self.segments.weighted(weights)["f1"]}


def draw_weights(count: int, groups: Sequence[str] | None) -> Float[np.ndarray, "b n"]:
    """Gives how often each image counts in each draw; the draws are those of the intervals of `evaluate`."""
    members = np.arange(count) if groups is None else np.unique(groups, return_inverse=True)[1]
    parts = int(members.max()) + 1
    drawn = np.random.default_rng(0).multinomial(parts, np.full(parts, 1 / parts), size=_DRAWS)
    return drawn.astype(np.float64)[:, members]


def interval(values: Float[np.ndarray, " b"]) -> tuple[float, float]:
    """Gives the range of the middle 95 % of the values."""
    low, high = np.quantile(values, _TAILS)
    return float(low), float(high)


def lost(
    below: Mapping[str, Float[np.ndarray, " b"]], above: Mapping[str, Float[np.ndarray, " b"]]
) -> dict[str, Float[np.ndarray, " b"]]:
    """Gives by how much each score of `below` is worse than that of `above`; negative where it is better."""
    signs = {name: -1.0 if name in LOWER_IS_BETTER else 1.0 for name in below}
    return {name: signs[name] * (above[name] - below[name]) for name in below}


__all__ = ["LOWER_IS_BETTER", "Columns", "Scoreboard", "columns_of", "draw_weights", "interval", "lost"]
