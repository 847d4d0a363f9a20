"""Precision, recall and F1 of sampled lines with orientation (paper, Sec. Line segment evaluation metrics).

What the paper leaves open is decided here:

- *Closest* is closest in position among the predicted samples within the angle radius. Position and angle
  have no common unit, and a closest one chosen before the angle is looked at would let any crossing line hide
  the right one.
- *Radius* is the Euclidean distance in pixels, and the circular difference of the angles; both inclusive.
- A predicted sample counts once, however many ground-truth samples it is the closest of; it is paired with
  the nearest of them. So |TP| is the same on both sides, and precision and recall are at most 1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import NDArray

from yolino.metrics.metric import Lines, SumMetric
from yolino.metrics.nearest import nearest_samples, pair_samples
from yolino.metrics.samples import Samples, sample_lines

# Where the curve over the radius is drawn, as fractions of the radius.
RADIUS_FRACTIONS = np.arange(1, 11) / 10


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

    def scores(self) -> dict[str, float]:
        """Gives `precision`, `recall` and `f1` of this image."""
        counts = (np.array(float(len(each))) for each in (self.pairs, self.prediction, self.truth))
        return {name: float(score) for name, score in _scores(*counts).items()}


def match_points(
    prediction: Lines,
    truth: Lines,
    size: tuple[int, int],
    ignore: Sequence[Float[np.ndarray, "v 2"]] = (),
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
    nearest, distances = nearest_samples(wanted, found, radius, angle_radius, directed=directed)
    rows = pair_samples(nearest, distances, wanted.labels, len(found))
    pairs = np.stack([nearest[rows], rows], axis=1)
    return PointMatch(found, wanted, pairs, distances[rows], radius)


class PointMetric(SumMetric):
    """Precision, recall and F1 of sampled lines over many images, micro-averaged (sums of samples).

    A ratio without a denominator is 1 if there is neither prediction nor ground truth, else 0.

    Args:
        radius: Position radius in pixels, a fiftieth of the image width if None.
        angle_radius: Angle radius in radians.
        directed: Whether a line in the opposite direction is another line.
        spacing: Sampling distance in pixels.

    Raises:
        ValueError: A radius is out of its range.
    """

    headline = "f1"

    def __init__(
        self,
        *,
        radius: float | None = None,
        angle_radius: float = math.pi / 4,
        directed: bool = True,
        spacing: float = 1.0,
    ) -> None:
        super().__init__()
        _check_radii(radius, angle_radius)
        self.radius = radius
        self.angle_radius = angle_radius
        self.directed = directed
        self.spacing = spacing

    def match(
        self,
        prediction: Lines,
        truth: Lines,
        size: tuple[int, int],
        ignore: Sequence[Float[np.ndarray, "v 2"]] = (),
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
        ignore: Sequence[Float[np.ndarray, "v 2"]] = (),
    ) -> None:
        """Adds one image; the arguments and errors are those of `match_points`."""
        match = self.match(prediction, truth, size, ignore)
        limits = RADIUS_FRACTIONS[:-1] * match.radius
        within = np.searchsorted(np.sort(match.distances), limits, side="right")
        counts = [len(match.prediction), len(match.truth), *within, len(match.pairs)]
        self._rows.append(np.array(counts, np.float64))

    def scores(self, sums: Float[np.ndarray, "*b k"]) -> dict[str, Float[np.ndarray, "*b"]]:
        """Gives `precision`, `recall` and `f1` of sums of `rows`."""
        return _scores(sums[..., -1], sums[..., 0], sums[..., 1])

    def curve(self) -> dict[str, Float[np.ndarray, " 10"]]:
        """Gives `fraction` of the radius, and `precision`, `recall` and `f1` at that radius, over all images.

        Raises:
            ValueError: There is no image yet.
        """
        sums = self.rows.sum(axis=0)
        return {"fraction": RADIUS_FRACTIONS.copy(), **_scores(sums[2:], sums[0:1], sums[1:2])}


def _scores(
    true_positives: NDArray[np.float64], predicted: NDArray[np.float64], truth: NDArray[np.float64]
) -> dict[str, NDArray[np.float64]]:
    """Gives precision, recall and F1 of counts (paper, Sec. Line segment evaluation metrics).

    Nothing predicted where nothing is labelled is perfect (1, 1, 1); any other ratio 0 / 0 is 0.
    """
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
