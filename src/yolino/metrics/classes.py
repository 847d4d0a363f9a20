"""How many found samples carry the right class (the paper: 96 % on two classes, Sec. Results)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from yolino.metrics.metric import Lines, SumMetric
from yolino.metrics.points import PointMetric
from yolino.metrics.samples import require_classes


class ClassMetric(SumMetric):
    """Class accuracy over the sample pairs of `match_points`, over many images, with its confusion matrix.

    Lines that were not found do not count: `PointMetric` counts those. Where no sample was found the accuracy
    is 1 if there was neither prediction nor ground truth, else 0.

    Args:
        classes: Names of the classes. Empty: as many classes as the largest label needs.
        radius: Position radius in pixels, a fiftieth of the image width if None.
        angle_radius: Angle radius in radians.
        directed: Whether a line in the opposite direction is another line.
        spacing: Sampling distance in pixels.

    Raises:
        ValueError: A radius is out of its range.
    """

    headline = "class_accuracy"

    def __init__(
        self,
        classes: Sequence[str] = (),
        *,
        radius: float | None = None,
        angle_radius: float = math.pi / 4,
        directed: bool = True,
        spacing: float = 1.0,
    ) -> None:
        super().__init__()
        self.classes = tuple(classes)
        self._points = PointMetric(
            radius=radius, angle_radius=angle_radius, directed=directed, spacing=spacing
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
            ValueError: A label is negative or names no class.
        """
        n = max(self._side_for(prediction, "prediction"), self._side_for(truth, "truth"))
        match = self._points.match(prediction, truth, size, ignore)
        found, wanted = match.prediction.labels[match.pairs[:, 0]], match.truth.labels[match.pairs[:, 1]]
        confusion = np.bincount(wanted * n + found, minlength=n * n).astype(np.float64)
        anything = float(len(match.prediction) + len(match.truth) > 0)
        self._rows.append(np.concatenate([[anything], confusion]))

    @property
    def rows(self) -> Float[np.ndarray, "n k"]:
        """Of each image: whether it has any line, then its confusion matrix row by row.

        Raises:
            ValueError: There is no image yet.
        """
        size = max((_side(row) for row in self._rows), default=0)
        self._rows = [_widen(row, size) for row in self._rows]
        return super().rows

    @property
    def confusion(self) -> Int[np.ndarray, "c c"]:
        """Number of found samples of each true class (row) and predicted class (column).

        `confusion[t, p]` counts the pairs of `match_points` whose ground truth has label t and whose
        prediction has label p. Its size is the number of `classes`, or without names the largest label so
        far plus 1. What was not found, and what was predicted where nothing is, is not in it.

        Raises:
            ValueError: There is no image yet.
        """
        sums = self.rows.sum(axis=0)
        side = _side(sums)
        return np.asarray(sums[1:].reshape(side, side), dtype=np.int64)

    def scores(self, sums: Float[np.ndarray, "*b k"]) -> dict[str, Float[np.ndarray, "*b"]]:
        """Gives `class_accuracy` of sums of `rows`."""
        side = _side(sums)
        right, found = sums[..., 1 :: side + 1].sum(axis=-1), sums[..., 1:].sum(axis=-1)
        nothing = (sums[..., 0] == 0).astype(np.float64)
        return {"class_accuracy": np.where(found > 0, right / np.where(found > 0, found, 1.0), nothing)}

    def _side_for(self, lines: Lines, name: str) -> int:
        """Gives the number of classes that the labels need."""
        require_classes(lines, name, self.classes)
        return len(self.classes) or int(lines.labels.max(initial=0)) + 1


def _side(row: Float[np.ndarray, "*b k"]) -> int:
    return math.isqrt(row.shape[-1] - 1)


def _widen(row: Float[np.ndarray, " k"], size: int) -> Float[np.ndarray, " m"]:
    """Gives the row with a confusion matrix of `size` classes."""
    side = _side(row)
    confusion = np.zeros((size, size))
    confusion[:side, :side] = row[1:].reshape(side, side)
    return np.concatenate([row[:1], confusion.ravel()])
