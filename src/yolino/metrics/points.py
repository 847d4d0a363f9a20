"""Precision, recall and F1 of sampled lines with orientation (paper, Sec. Line segment evaluation metrics).

What the paper leaves open is decided here:

- *Closest* is closest in position among the predicted samples within the angle radius. Position and angle
  have no common unit, and a closest one chosen before the angle is looked at would let any crossing line hide
  the right one.
- *Radius* is the Euclidean distance in pixels, and the circular difference of the angles; both inclusive.
- A predicted sample counts once, however many ground-truth samples it is the closest of; it is paired with
  the nearest of them. So |TP| is the same on both sides, and precision and recall are at most 1.
- *Per class* the metric is that of an image with the lines of one class alone, on both sides.
- *At a score* it is that of an image with the predictions of at least that score alone: a false line that
  goes may leave its ground truth to another.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from yolino.metrics.metric import Lines, SumMetric
from yolino.metrics.nearest import nearest_samples, pair_samples
from yolino.metrics.samples import Samples, require_classes, sample_lines

# Where the curve over the radius is drawn, as fractions of the radius.
RADIUS_FRACTIONS = np.arange(1, 11) / 10
# Where the curve over the score is drawn.
SCORE_THRESHOLDS = np.arange(20) / 20


@dataclass(frozen=True, eq=False)
class PointMatch:
    """Which samples of one image were found.

    Attributes:
        prediction: The predicted samples.
        truth: The ground-truth samples.
        pairs: Index of each true positive in `prediction` and of its ground truth in `truth`; each occurs
            once.
        distances: Distance of each pair in pixels.
        radius: The position radius in pixels.
    """

    prediction: Samples
    truth: Samples
    pairs: Int[np.ndarray, "k 2"]
    distances: Float[np.ndarray, " k"]
    radius: float

    @property
    def true_positives(self) -> Bool[np.ndarray, " s"]:
        """Which predicted samples are true positives."""
        return _mask(self.pairs[:, 0], len(self.prediction))

    @property
    def false_positives(self) -> Bool[np.ndarray, " s"]:
        """Which predicted samples are false positives."""
        return ~self.true_positives

    @property
    def found(self) -> Bool[np.ndarray, " s"]:
        """Which ground-truth samples are paired with a prediction."""
        return _mask(self.pairs[:, 1], len(self.truth))

    @property
    def false_negatives(self) -> Bool[np.ndarray, " s"]:
        """Which ground-truth samples are not paired with a prediction."""
        return ~self.found

    @property
    def counts(self) -> Int[np.ndarray, " 3"]:
        """Number of predicted samples, of ground-truth samples, and of true positives."""
        return np.array([len(self.prediction), len(self.truth), len(self.pairs)])

    def scores(self) -> dict[str, float]:
        """Gives `precision`, `recall` and `f1` of this image."""
        return {name: float(score) for name, score in _ratios(self.counts.astype(np.float64)).items()}


def match_points(
    prediction: Lines,
    truth: Lines,
    size: tuple[int, int],
    ignore: Sequence[Float[np.ndarray, "_ 2"]] = (),
    *,
    radius: float | None = None,
    angle_radius: float = math.pi / 4,
    directed: bool = True,
    spacing: float = 1.0,
) -> PointMatch:
    """Gives the true and false positives and negatives of one image (paper, Sec. Line segment evaluation).

    Both sides are sampled at `spacing` (`sample_lines`). The true positives are the predicted samples that
    are, for at least one ground-truth sample, the closest within both radii.

    Args:
        prediction: Predicted lines in pixels.
        truth: Labelled lines in pixels.
        size: `(height, width)` of the image; parts of lines outside it are cut off on both sides.
        ignore: Polygons in pixels; samples inside are removed on both sides.
        radius: Position radius in pixels, a fiftieth of the image width if None.
        angle_radius: Angle radius in radians.
        directed: Whether a line in the opposite direction is another line.
        spacing: Sampling distance in pixels.

    Raises:
        ValueError: A radius, size or spacing is out of its range, a coordinate is not finite, or a polygon
            has less than three corners.
    """
    _check_radii(radius, angle_radius)
    if radius is None:
        radius = size[1] / 50
    found = sample_lines(prediction, size, ignore=ignore, spacing=spacing)
    wanted = sample_lines(truth, size, ignore=ignore, spacing=spacing)
    return _match(found, wanted, radius, angle_radius, directed)


class PointMetric(SumMetric):
    """Precision, recall and F1 of sampled lines over many images, micro-averaged (sums of samples).

    A ratio without a denominator is 1 if there is neither prediction nor ground truth, else 0. So a class
    that occurs on neither side has 1, and the names of the scores do not depend on the images.

    Args:
        radius: Position radius in pixels, a fiftieth of the image width if None.
        angle_radius: Angle radius in radians.
        directed: Whether a line in the opposite direction is another line.
        spacing: Sampling distance in pixels.
        classes: Names of the classes, for scores of each class beside those of all lines; a label is an index
            of them. Empty: labels do not count.
        score_curve: Whether to match again at each of `SCORE_THRESHOLDS`; for predictions with scores in
            [0, 1].

    Raises:
        ValueError: A radius is out of its range, or two classes have one name.
    """

    headline = "f1"

    def __init__(
        self,
        *,
        radius: float | None = None,
        angle_radius: float = math.pi / 4,
        directed: bool = True,
        spacing: float = 1.0,
        classes: Sequence[str] = (),
        score_curve: bool = False,
    ) -> None:
        super().__init__()
        _check_radii(radius, angle_radius)
        if len(set(classes)) < len(classes):
            raise ValueError(f"classes must have different names, got {', '.join(classes)}.")
        self.radius = radius
        self.angle_radius = angle_radius
        self.directed = directed
        self.spacing = spacing
        self.classes = tuple(classes)
        self.thresholds = SCORE_THRESHOLDS if score_curve else SCORE_THRESHOLDS[:0]

    def match(
        self,
        prediction: Lines,
        truth: Lines,
        size: tuple[int, int],
        ignore: Sequence[Float[np.ndarray, "_ 2"]] = (),
    ) -> PointMatch:
        """Gives the `match_points` of one image at the settings of this metric; the image is not added."""
        return match_points(
            prediction,
            truth,
            size,
            ignore,
            radius=self.radius,
            angle_radius=self.angle_radius,
            directed=self.directed,
            spacing=self.spacing,
        )

    def update(
        self,
        prediction: Lines,
        truth: Lines,
        size: tuple[int, int],
        ignore: Sequence[Float[np.ndarray, "_ 2"]] = (),
    ) -> None:
        """Adds one image; the arguments and errors are those of `match_points`.

        Raises:
            ValueError: The metric has classes, and a label names none of them.
        """
        if self.classes:
            require_classes(prediction, "prediction", self.classes)
            require_classes(truth, "truth", self.classes)
        match = self.match(prediction, truth, size, ignore)
        counts = [match.counts, *self._class_counts(match), *self._threshold_counts(match, prediction)]
        limits = RADIUS_FRACTIONS[:-1] * match.radius
        within = np.searchsorted(np.sort(match.distances), limits, side="right")
        self._rows.append(np.concatenate([*counts, within]).astype(np.float64))

    def scores(self, sums: Float[np.ndarray, "*b k"]) -> dict[str, Float[np.ndarray, "*b"]]:
        """Gives the scores of sums of `rows`.

        `precision`, `recall` and `f1` of all lines; the same of each class (`f1_dashed`). With a score curve
        the same at each threshold (`f1_at_0.05`), the `best_f1` of them, and the `best_threshold`, the lowest
        that gives it.
        """
        endings = ["", *(f"_{name}" for name in self.classes), *(f"_at_{t:.2f}" for t in self.thresholds)]
        ratios = _ratios(self._counts(sums))
        scores = {name + end: ratios[name][..., i] for i, end in enumerate(endings) for name in ratios}
        if len(self.thresholds):
            f1 = ratios["f1"][..., -len(self.thresholds) :]
            scores["best_f1"] = np.asarray(f1.max(axis=-1))
            scores["best_threshold"] = np.asarray(self.thresholds[f1.argmax(axis=-1)])
        return scores

    def curve(self) -> dict[str, Float[np.ndarray, " 10"]]:
        """Gives `fraction` of the radius, and `precision`, `recall` and `f1` at that radius, over all images.

        Raises:
            ValueError: There is no image yet.
        """
        sums = self.rows.sum(axis=0)
        within = np.append(sums[1 - len(RADIUS_FRACTIONS) :], sums[2])
        counts = np.stack([np.full_like(within, sums[0]), np.full_like(within, sums[1]), within], axis=-1)
        return {"fraction": RADIUS_FRACTIONS.copy(), **_ratios(counts)}

    def score_curve(self) -> dict[str, Float[np.ndarray, " 20"]]:
        """Gives `threshold`, and `precision`, `recall` and `f1` at that score, over all images.

        Raises:
            ValueError: The metric was made without `score_curve`, or there is no image yet.
        """
        if len(self.thresholds) == 0:
            raise ValueError("This PointMetric has no curve over the score: make it with score_curve=True.")
        counts = self._counts(self.rows.sum(axis=0))[-len(self.thresholds) :]
        return {"threshold": self.thresholds.copy(), **_ratios(counts)}

    def _class_counts(self, match: PointMatch) -> list[Int[np.ndarray, " 3"]]:
        found, wanted = match.prediction, match.truth
        return [
            self._match_part(match, found[found.labels == label], wanted[wanted.labels == label])
            for label in range(len(self.classes))
        ]

    def _threshold_counts(self, match: PointMatch, prediction: Lines) -> list[Int[np.ndarray, " 3"]]:
        found, counts = match.prediction, [match.counts]
        for threshold in self.thresholds:
            kept = prediction.scores[found.owners] >= threshold
            # Samples only go as the threshold rises: as many are the same ones, with the same matches.
            same = kept.sum() == counts[-1][0]
            counts.append(counts[-1] if same else self._match_part(match, found[kept], match.truth))
        return counts[1:]

    def _match_part(self, match: PointMatch, found: Samples, wanted: Samples) -> Int[np.ndarray, " 3"]:
        return _match(found, wanted, match.radius, self.angle_radius, self.directed).counts

    def _counts(self, sums: Float[np.ndarray, "*b k"]) -> Float[np.ndarray, "*b m 3"]:
        """Gives the counts of all lines, of each class, and at each threshold; they lead each row."""
        parts = 1 + len(self.classes) + len(self.thresholds)
        return sums[..., : 3 * parts].reshape(*sums.shape[:-1], parts, 3)


def _match(found: Samples, wanted: Samples, radius: float, angle_radius: float, directed: bool) -> PointMatch:
    nearest, distances = nearest_samples(wanted, found, radius, angle_radius, directed=directed)
    rows = pair_samples(nearest, distances, wanted.labels, len(found))
    pairs = np.stack([nearest[rows], rows], axis=1)
    return PointMatch(found, wanted, pairs, distances[rows], radius)


def _ratios(counts: Float[np.ndarray, "*b 3"]) -> dict[str, Float[np.ndarray, "*b"]]:
    """Gives precision, recall and F1 of `PointMatch.counts` (paper, Sec. Line segment evaluation metrics).

    Nothing predicted where nothing is labelled is perfect (1, 1, 1); any other ratio 0 / 0 is 0.
    """
    predicted, truth, true_positives = counts[..., 0], counts[..., 1], counts[..., 2]
    empty = (predicted + truth) == 0
    precision = np.where(empty, 1.0, true_positives / np.where(predicted > 0, predicted, 1.0))
    recall = np.where(empty, 1.0, true_positives / np.where(truth > 0, truth, 1.0))
    both = precision + recall
    f1 = np.asarray(2 * precision * recall / np.where(both > 0, both, 1.0))
    return {"precision": precision, "recall": recall, "f1": f1}


def _check_radii(radius: float | None, angle_radius: float) -> None:
    if radius is not None and not 0 < radius < math.inf:
        raise ValueError(f"radius must be a positive number of pixels or None for width / 50, got {radius}.")
    if not 0 < angle_radius <= math.pi:
        raise ValueError(f"angle_radius must be in (0, pi] radians, got {angle_radius}.")


def _mask(chosen: Int[np.ndarray, " k"], size: int) -> Bool[np.ndarray, " s"]:
    mask = np.zeros(size, np.bool_)
    mask[chosen] = True
    return mask
