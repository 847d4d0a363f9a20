"""Average precision and F1 of whole polylines, told apart by their Chamfer or Frechet distance.

The rules are those of MapTR (github.com/hustvl/MapTR, after VectorMapNet) and OpenLane-V2: from the highest
score on, a prediction takes its nearest label if that is within the threshold and still free; if it is taken
already, the prediction is wrong, even if another label is near enough. What they leave to chance or leave out
is decided here:

- Predictions of equal score are one step of the curve of precision over recall.
- Of labels that are equally near, a free one is taken.
- A line is *optional* if more than half of it lies in ignored regions. An optional label need not be found,
  and what finds it counts as neither right nor wrong; an optional prediction counts only if it is right.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Int8

from yolino.metrics.distances import SAMPLES, chamfer_distances, frechet_distances, visible_lines
from yolino.metrics.metric import Lines, Metric
from yolino.metrics.samples import require_classes
from yolino.types import Polylines

# Thresholds as fractions of the image's width where none are given in pixels.
FRACTIONS = (0.01, 0.02, 0.04)
_RIGHT, _WRONG, _UNCOUNTED = 1, 0, -1


class _Image(NamedTuple):
    """What an image adds: predictions with an outcome at each threshold, labels by class, counts for F1."""

    scores: Float[np.ndarray, " p"]
    labels: Int[np.ndarray, " p"]
    outcomes: Int8[np.ndarray, "k p"]
    truth: Float[np.ndarray, " c"]
    counts: Float[np.ndarray, " 3"]


class InstanceMetric(Metric):
    """Average precision and F1 of whole polylines under a distance that subclasses define.

    `ap_<threshold>` is the area under the curve of precision over recall, where precision at a recall is the
    best at that or any higher recall; with classes, the mean over those that occur in the labels. `ap` is the
    mean over the thresholds. `precision`, `recall` and `f1` count all predictions whatever their score, with
    as many pairs as a one-to-one assignment allows within the middle threshold. Where nothing is labelled, a
    score is 1 if nothing is predicted, else 0.

    Segments count as polylines of two vertices. Lines are cut at the image's border; one that leaves the
    image and returns becomes several. Parts shorter than a pixel are dropped.

    Args:
        thresholds: Distances in pixels up to which two lines match, inclusive. None: 1, 2 and 4 percent of
            the width of each image.
        classes: Names of the classes: a prediction matches labels of its own class only. Empty: all lines
            are of one class, whatever their labels.
        samples: Number of points by which lines are compared.

    Raises:
        ValueError: A threshold is not a positive number, two are alike or there is none, or `samples` is
            less than 2.
    """

    headline = "ap"

    def __init__(
        self,
        *,
        thresholds: Sequence[float | int] | None = None,
        classes: Sequence[str] = (),
        samples: int = SAMPLES,
    ) -> None:
        if samples < 2:
            raise ValueError(f"samples must be at least 2 (both ends of a line), got {samples}.")
        self.thresholds = None if thresholds is None else tuple(sorted(float(each) for each in thresholds))
        self.classes = tuple(classes)
        self.samples = samples
        if self.thresholds is None:
            self._names = [f"ap_{100 * fraction:g}%" for fraction in FRACTIONS]
        else:
            self._names = [f"ap_{threshold:g}px" for threshold in self.thresholds]
            if not self.thresholds or not all(0 < threshold < math.inf for threshold in self.thresholds):
                raise ValueError(f"thresholds must be positive numbers of pixels, got {thresholds}.")
            if len(set(self._names)) < len(self._names):
                raise ValueError(f"thresholds must differ from each other, got {thresholds}.")
        self._images: list[_Image] = []

    @abstractmethod
    def distances(self, prediction: Polylines, truth: Polylines, limit: float) -> Float[np.ndarray, "p t"]:
        """Gives the distance of each sampled prediction to each sampled label; any number beyond `limit`."""

    def __len__(self) -> int:
        return len(self._images)

    def update(
        self,
        prediction: Lines,
        truth: Lines,
        size: tuple[int, int],
        ignore: Sequence[Float[np.ndarray, "_ 2"]] = (),
    ) -> None:
        """Adds one image.

        Args:
            prediction: Predicted lines in pixels of the image.
            truth: Labelled lines in pixels of the image.
            size: `(height, width)` of the image.
            ignore: Polygons (even-odd rule) in pixels; the points of lines inside are removed on both sides.

        Raises:
            ValueError: A coordinate or a score is not finite, a polygon has less than three corners, `size`
                is not positive, or a label is negative or names no class.
        """
        for lines, name in (prediction, "prediction"), (truth, "truth"):
            require_classes(lines, name, self.classes)
        found = visible_lines(prediction, size, ignore, samples=self.samples)
        wanted = visible_lines(truth, size, ignore, samples=self.samples)
        limits = self.thresholds or tuple(fraction * size[1] for fraction in FRACTIONS)
        distances = self.distances(found.lines, wanted.lines, limits[-1])
        if self.classes:
            distances[found.lines.labels[:, None] != wanted.lines.labels] = np.inf
        outcomes = [_outcomes(distances, found.optional, wanted.optional, limit) for limit in limits]
        middle = distances <= limits[(len(limits) - 1) // 2]
        self._images.append(
            _Image(
                found.lines.scores,
                found.lines.labels,
                np.stack(outcomes),
                self._count(wanted.lines.labels[~wanted.optional]),
                _assign(middle, found.optional, wanted.optional),
            )
        )

    def weighted(self, weights: Float[np.ndarray, "b n"]) -> dict[str, Float[np.ndarray, " b"]]:
        """Gives the scores by name, once for each row of weights: how often each image counts.

        Raises:
            ValueError: There is no image yet.
        """
        self.require_images()
        scores = np.concatenate([image.scores for image in self._images])
        order = np.argsort(-scores, kind="stable")
        labels = np.concatenate([image.labels for image in self._images])[order]
        outcomes = np.concatenate([image.outcomes for image in self._images], axis=1)[:, order]
        owners = np.repeat(np.arange(len(self)), [len(image.scores) for image in self._images])[order]
        truth = weights @ np.stack([image.truth for image in self._images])
        precisions = {}
        for name, outcome in zip(self._names, outcomes, strict=True):
            counted = outcome != _UNCOUNTED
            ranking = _Ranking(
                scores[order][counted], labels[counted], outcome[counted] == _RIGHT, owners[counted]
            )
            precisions[name] = self._precision(weights, ranking, truth)
        counts = weights @ np.stack([image.counts for image in self._images])
        mean = np.mean(list(precisions.values()), axis=0)
        return {"ap": mean, **precisions, **_ratios(counts)}

    def _precision(
        self, weights: Float[np.ndarray, "b n"], ranking: _Ranking, truth: Float[np.ndarray, "b c"]
    ) -> Float[np.ndarray, " b"]:
        """Gives the mean average precision over the classes that occur in the labels."""
        columns, occurring, total = weights[:, ranking.owners], truth > 0, np.zeros(len(weights))
        for label in range(truth.shape[1]):
            of_class = ranking.labels == label if self.classes else slice(None)
            right, scores = ranking.right[of_class], ranking.scores[of_class]
            total += _average_precision(columns[:, of_class], scores, right, truth[:, label])
        nothing = (columns.sum(axis=1) == 0).astype(np.float64)
        mean = total / np.maximum(occurring.sum(axis=1), 1)
        return np.asarray(np.where(occurring.any(axis=1), mean, nothing))

    def _count(self, labels: Int[np.ndarray, " t"]) -> Float[np.ndarray, " c"]:
        if not self.classes:
            return np.array([float(len(labels))])
        return np.bincount(labels, minlength=len(self.classes)).astype(np.float64)


class ChamferMetric(InstanceMetric):
    """Average precision and F1 of polylines by their Chamfer distance (MapTR, after VectorMapNet).

    The Chamfer distance knows no direction. Arguments, scores and errors are those of `InstanceMetric`.
    """

    def distances(self, prediction: Polylines, truth: Polylines, limit: float) -> Float[np.ndarray, "p t"]:
        """Gives the Chamfer distances in pixels, infinite for pairs that are certainly beyond `limit`."""
        return chamfer_distances(prediction, truth, limit=limit)


class FrechetMetric(InstanceMetric):
    """Average precision and F1 of polylines by their discrete Frechet distance (OpenLane-V2).

    Arguments, scores and errors are those of `InstanceMetric`; without `directed`, a line in the opposite
    direction is the same line.
    """

    def __init__(
        self,
        *,
        thresholds: Sequence[float | int] | None = None,
        classes: Sequence[str] = (),
        samples: int = SAMPLES,
        directed: bool = True,
    ) -> None:
        super().__init__(thresholds=thresholds, classes=classes, samples=samples)
        self.directed = directed

    def distances(self, prediction: Polylines, truth: Polylines, limit: float) -> Float[np.ndarray, "p t"]:
        """Gives the Frechet distances in pixels, infinite for pairs that are certainly beyond `limit`."""
        return frechet_distances(prediction, truth, directed=self.directed, limit=limit)


class _Ranking(NamedTuple):
    """The counted predictions of all images at one threshold, best score first."""

    scores: Float[np.ndarray, " p"]
    labels: Int[np.ndarray, " p"]
    right: Bool[np.ndarray, " p"]
    owners: Int[np.ndarray, " p"]


def _outcomes(
    distances: Float[np.ndarray, "p t"],
    optional: Bool[np.ndarray, " p"],
    optional_truth: Bool[np.ndarray, " t"],
    threshold: float,
) -> Int8[np.ndarray, " p"]:
    """Gives the outcome of each prediction; predictions and labels in an order that is their own."""
    outcomes = np.where(optional, _UNCOUNTED, _WRONG).astype(np.int8)
    free = ~optional_truth
    nearest = distances.min(axis=1, initial=np.inf)
    for row in np.flatnonzero(nearest <= threshold):
        candidates = np.flatnonzero(distances[row] == nearest[row])
        chosen = candidates[free[candidates]][:1]
        if len(chosen):
            outcomes[row], free[chosen] = _RIGHT, False
        elif optional_truth[candidates].any():
            outcomes[row] = _UNCOUNTED
    return outcomes


def _assign(
    near: Bool[np.ndarray, "p t"], optional: Bool[np.ndarray, " p"], optional_truth: Bool[np.ndarray, " t"]
) -> Float[np.ndarray, " 3"]:
    """Gives the numbers of pairs, of predictions and of labels that count, under the best assignment.

    The best has the most pairs, and among those the least wrong predictions: pairing one that would be wrong
    gains more. That costs no pair, as predictions that can be paired stay paired in some largest assignment.
    """
    from scipy.optimize import linear_sum_assignment  # takes half a second, which a detector need not wait

    uncounted = optional | near[:, optional_truth].any(axis=1)
    gain = near[:, ~optional_truth] * np.where(uncounted, 1.0, 2.0)[:, None]
    rows, columns = linear_sum_assignment(gain, maximize=True)
    paired = rows[gain[rows, columns] > 0]
    wrong = np.count_nonzero(np.delete(~uncounted, paired))
    return np.array([len(paired), len(paired) + wrong, gain.shape[1]], np.float64)


def _ratios(counts: Float[np.ndarray, "b 3"]) -> dict[str, Float[np.ndarray, " b"]]:
    """Gives precision, recall and F1 of numbers of pairs, predictions and labels."""
    pairs, predicted, truth = counts.T
    nothing = (truth == 0) & (predicted == 0)
    fractions = {
        "precision": (pairs, predicted),
        "recall": (pairs, truth),
        "f1": (2 * pairs, predicted + truth),
    }
    return {
        name: np.where(nothing, 1.0, top / np.where(bottom > 0, bottom, 1.0))
        for name, (top, bottom) in fractions.items()
    }


def _average_precision(
    columns: Float[np.ndarray, "b p"],
    scores: Float[np.ndarray, " p"],
    right: Bool[np.ndarray, " p"],
    truth: Float[np.ndarray, " b"],
) -> Float[np.ndarray, " b"]:
    """Gives the area under precision over recall, 0 without labels, for predictions in order of their score.

    Args:
        columns: How often each prediction counts.
        scores: Scores, not increasing; equal ones are one step of the curve.
        right: Which predictions are right.
        truth: Number of labels.
    """
    last = np.flatnonzero(scores != np.append(scores, np.nan)[1:])
    predicted = np.cumsum(columns, axis=1)[:, last]
    found = np.cumsum(columns * right, axis=1)[:, last]
    precision = found / np.where(predicted > 0, predicted, 1.0)
    best = np.maximum.accumulate(precision[:, ::-1], axis=1)[:, ::-1]
    area = (np.diff(found, axis=1, prepend=0.0) * best).sum(axis=1)
    return np.asarray(area / np.where(truth > 0, truth, 1.0))


__all__ = ["FRACTIONS", "ChamferMetric", "FrechetMetric", "InstanceMetric"]
