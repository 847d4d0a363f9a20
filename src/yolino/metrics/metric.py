"""What every metric is: counts of each image that add up, and the scores of a sum."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from yolino.types import Polylines, Segments

Lines = Segments | Polylines


class Metric(ABC):
    """Scores over many images, computed from the sum of one row of numbers per image.

    As the scores depend on that sum alone, the order of the images does not matter, results of several
    processes are added, and the images can be resampled (`yolino.metrics.bootstrap`).

    Attributes:
        headline: Name of the score to quote if only one is quoted: 1 for a perfect prediction.
    """

    headline: ClassVar[str]

    def __init__(self) -> None:
        self._rows: list[Float[np.ndarray, " k"]] = []

    @abstractmethod
    def update(
        self,
        prediction: Lines,
        truth: Lines,
        size: tuple[int, int],
        ignore: Sequence[Float[np.ndarray, "v 2"]] = (),
    ) -> None:
        """Adds one image.

        Args:
            prediction: Predicted lines in pixels of the image.
            truth: Labelled lines in pixels of the image.
            size: `(height, width)` of the image.
            ignore: Polygons in pixels inside which nothing is scored.
        """

    @abstractmethod
    def scores(self, sums: Float[np.ndarray, "*b k"]) -> dict[str, Float[np.ndarray, "*b"]]:
        """Gives the scores that belong to sums of `rows`, by name."""

    @property
    def rows(self) -> Float[np.ndarray, "n k"]:
        """The numbers of each image added so far.

        Raises:
            ValueError: There is no image yet.
        """
        if not self._rows:
            raise ValueError(
                f"{type(self).__name__} has no scores before the first image: call update() first."
            )
        return np.stack(self._rows)

    def compute(self) -> dict[str, float]:
        """Gives the scores over all images added so far, by name.

        Raises:
            ValueError: There is no image yet.
        """
        return {name: float(score) for name, score in self.scores(self.rows.sum(axis=0)).items()}
