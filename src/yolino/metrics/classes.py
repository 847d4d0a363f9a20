"""How much of what was found carries the right class (the paper: 96 % on two classes, Sec. Results)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from yolino.metrics.metric import Lines, SumMetric
from yolino.metrics.points import PointMatch, PointMetric
from yolino.metrics.samples import require_classes

# Part of a labelled line that must be found before it is said which class it was found as.
FOUND = 0.5


class ClassMetric(SumMetric):
    """Class accuracy of what was found, over many images, with its confusion matrices.

    It is counted twice: over the sample pairs of `match_points`, and over labelled lines, each as a whole. A
    line is found if at least half of its samples are, and was found as the class that most of them carry (of
    several the lowest label).

    What was not found does not count: `PointMetric` counts that. Where nothing was found the accuracy is 1 if
    there was neither prediction nor ground truth, else 0.

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
        lines_found, lines_wanted = _lines(match, n)
        anything = float(len(match.prediction) + len(match.truth) > 0)
        counts = _count(wanted, found, n), _count(lines_wanted, lines_found, n)
        self._rows.append(np.concatenate([[anything], *counts]))

    @property
    def rows(self) -> Float[np.ndarray, "n k"]:
        """Of each image: whether it has any line, then its two confusion matrices row by row.

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
        return np.asarray(_matrices(self.rows.sum(axis=0))[0], np.int64)

    @property
    def line_confusion(self) -> Int[np.ndarray, "c c"]:
        """Number of found lines of each true class (row) and of the class that they were found as (column).

        Raises:
            ValueError: There is no image yet.
        """
        return np.asarray(_matrices(self.rows.sum(axis=0))[1], np.int64)

    def scores(self, sums: Float[np.ndarray, "*b k"]) -> dict[str, Float[np.ndarray, "*b"]]:
        """Gives the scores of sums of `rows`.

        `class_accuracy` is that of samples, `class_accuracy_lines` that of lines. For named classes there are
        also `class_recall_<name>` and `class_recall_lines_<name>`: of what was found of a class, the part
        that carries it; 1 for a class that neither side has, 0 if the predictions alone have it.
        """
        scores = {}
        matrices = np.moveaxis(_matrices(sums), -3, 0)
        nothing = (sums[..., 0] == 0).astype(np.float64)
        for ending, matrix in zip(("", "_lines"), matrices, strict=True):
            right = np.diagonal(matrix, axis1=-2, axis2=-1)
            scores[f"class_accuracy{ending}"] = _ratio(right.sum(axis=-1), matrix.sum(axis=(-2, -1)), nothing)
            absent = (matrix.sum(axis=-1) + matrix.sum(axis=-2) == 0).astype(np.float64)
            recalls = _ratio(right, matrix.sum(axis=-1), absent)
            for label, name in enumerate(self.classes):
                scores[f"class_recall{ending}_{name}"] = recalls[..., label]
        return scores

    def _side_for(self, lines: Lines, name: str) -> int:
        """Gives the number of classes that the labels need."""
        require_classes(lines, name, self.classes)
        return len(self.classes) or int(lines.labels.max(initial=0)) + 1


def _lines(match: PointMatch, n: int) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Gives the class as which each line was found that was found, and its true class."""
    owners = match.truth.owners
    lines = int(owners.max(initial=-1)) + 1
    paired = owners[match.pairs[:, 1]]
    votes = np.bincount(paired * n + match.prediction.labels[match.pairs[:, 0]], minlength=lines * n).reshape(
        lines, n
    )
    found = (votes.sum(axis=1) >= FOUND * np.bincount(owners, minlength=lines)) & votes.any(axis=1)
    labels = np.zeros(lines, np.int64)
    labels[owners] = match.truth.labels
    return votes.argmax(axis=1)[found], labels[found]


def _count(wanted: Int[np.ndarray, " k"], found: Int[np.ndarray, " k"], n: int) -> Float[np.ndarray, " m"]:
    """Gives a confusion matrix of n classes, row by row."""
    return np.bincount(wanted * n + found, minlength=n * n).astype(np.float64)


def _ratio(part: ArrayLike, whole: ArrayLike, otherwise: ArrayLike) -> Float[np.ndarray, "*b"]:
    """Gives `part / whole`, and `otherwise` where there is nothing; sums of single rows are no arrays."""
    part, whole = np.asarray(part), np.asarray(whole)
    return np.asarray(np.where(whole > 0, part / np.where(whole > 0, whole, 1.0), otherwise))


def _side(row: Float[np.ndarray, "*b k"]) -> int:
    return math.isqrt((row.shape[-1] - 1) // 2)


def _matrices(row: Float[np.ndarray, "*b k"]) -> Float[np.ndarray, "*b 2 c c"]:
    """Gives the confusion matrices of samples and of lines."""
    side = _side(row)
    return row[..., 1:].reshape(*row.shape[:-1], 2, side, side)


def _widen(row: Float[np.ndarray, " k"], size: int) -> Float[np.ndarray, " m"]:
    """Gives the row with confusion matrices of `size` classes."""
    side = _side(row)
    wide = np.zeros((2, size, size))
    wide[:, :side, :side] = _matrices(row)
    return np.concatenate([row[:1], wide.ravel()])
