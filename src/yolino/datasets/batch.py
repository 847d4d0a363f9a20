"""Samples side by side, so that what is computed for each polyline is computed for many at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from yolino.datasets.report import Size
from yolino.types import Polylines


@dataclass(frozen=True, eq=False)
class Batch:
    """The polylines of some samples, one sample after the other.

    Attributes:
        names: Name of each sample.
        sizes: `(height, width)` of the image of each sample; None where nobody knows.
        lines: All polylines, in pixels of their image.
        samples: Index of the sample of each polyline.
    """

    names: Sequence[str]
    sizes: Sequence[Size | None]
    lines: Polylines
    samples: Int[np.ndarray, " n"]

    @classmethod
    def of(cls, names: Sequence[str], sizes: Sequence[Size | None], lines: Sequence[Polylines]) -> Batch:
        """Gives the batch of samples with these names, sizes and polylines."""
        counts = np.concatenate([np.diff(one.offsets) for one in lines]) if lines else np.zeros(0, np.int64)
        together = Polylines(
            np.concatenate([one.vertices for one in lines]) if lines else np.zeros((0, 2)),
            np.concatenate([[0], np.cumsum(counts)]),
            labels=np.concatenate([one.labels for one in lines]) if lines else None,
        )
        samples = np.repeat(np.arange(len(lines)), [len(one) for one in lines])
        return cls(names, sizes, together, samples)

    @property
    def finite(self) -> Bool[np.ndarray, " n"]:
        """Whether all vertices of each polyline are finite."""
        return np.asarray(self.count(~np.isfinite(self.lines.vertices).all(axis=1)) == 0)

    @property
    def limits(self) -> Float[np.ndarray, "n 2"]:
        """`(width, height)` of the image of each polyline; NaN where nobody knows."""
        known = [(np.nan, np.nan) if size is None else (size[1], size[0]) for size in self.sizes]
        return np.asarray(np.array(known, np.float64).reshape(-1, 2)[self.samples])

    @property
    def owners(self) -> Int[np.ndarray, " v"]:
        """Index of the polyline of each vertex."""
        return np.repeat(np.arange(len(self.lines)), np.diff(self.lines.offsets))

    def count(self, marked: Bool[np.ndarray, " v"]) -> Int[np.ndarray, " n"]:
        """Gives the number of marked vertices of each polyline."""
        return np.bincount(self.owners[marked], minlength=len(self.lines))


__all__ = ["Batch"]
