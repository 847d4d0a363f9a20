"""What every metric is: images are added one by one, and any choice of them has its scores."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from yolino.types import Polylines, Segments

Lines = Segments | Polylines


class Metric(ABC):
    """Scores over many images.

    What an image adds is kept per image, so the images can be drawn again with other weights
    (`yolino.metrics.bootstrap`). The order of the images never matters.

    Attributes:
        headline: Name of the score to quote if only one is quoted: 1 for a perfect prediction.
    """

    headline: ClassVar[str]

    @abstractmethod
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
            ignore: Polygons in pixels inside which nothing is scored.
        """

    @abstractmethod
    def __len__(self) -> int:
        """Gives the number of images added so far."""

    @abstractmethod
    def weighted(self, weights: Float[np.ndarray, "b n"]) -> dict[str, Float[np.ndarray, " b"]]:
        """Gives the scores by name, once for each row of weights: how often each image counts.

        Raises:
            ValueError: There is no image yet.
        """

    def compute(self) -> dict[str, float]:
        """Gives the scores over all images added so far, by name.

        Raises:
            ValueError: There is no image yet.
        """
        return {name: float(score[0]) for name, score in self.weighted(np.ones((1, len(self)))).items()}

    def require_images(self) -> None:
        """Raises ValueError if there is no image yet."""
        if len(self) == 0:
            raise ValueError(
                f"{type(self).__name__} has no scores before the first image: call update() first."
            )


class SumMetric(Metric):
    """A metric whose scores depend on the sum of one row of numbers per image alone.

    So results of several processes are added.
    """

    def __init__(self) -> None:
        self._rows: list[Float[np.ndarray, " k"]] = []

    def __len__(self) -> int:
        return len(self._rows)

    @abstractmethod
    def scores(self, sums: Float[np.ndarray, "*b k"]) -> dict[str, Float[np.ndarray, "*b"]]:
        """Gives the scores that belong to sums of `rows`, by name."""

    @property
    def rows(self) -> Float[np.ndarray, "n k"]:
        """The numbers of each image added so far.

        Raises:
            ValueError: There is no image yet.
        """
        self.require_images()
        return np.stack(self._rows)

    def weighted(self, weights: Float[np.ndarray, "b n"]) -> dict[str, Float[np.ndarray, " b"]]:
        """Gives the scores by name, once for each row of weights: how often each image counts.

        Raises:
            ValueError: There is no image yet.
        """
        return self.scores(weights @ self.rows)


__all__ = ["Lines", "Metric", "SumMetric"]
