"""The images that a model does worst on, with what it found, missed and made up."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt8

from yolino.io import read_image, write_image
from yolino.metrics import PointMatch
from yolino.types import Sample
from yolino.viz import contact_sheet, draw_matches, enlarge, fit_tile, tiny_zoom

_DRAWN = (720, 1280)  # pixels: height and width in which images of the sheet are drawn, twice a tile
Image = UInt8[np.ndarray, "h w 3"]


def pixels_of(sample: Sample) -> Image:
    """Gives the RGB pixels of a sample."""
    return read_image(sample.image) if isinstance(sample.image, Path) else sample.image


@dataclass(frozen=True)
class BadImage:
    """One of the worst images.

    Attributes:
        name: Name of the sample.
        f1: Its F1 by the point metric.
        precision: Its precision.
        recall: Its recall.
        picture: The file with its picture.
    """

    name: str
    f1: float
    precision: float
    recall: float
    picture: Path


class _Candidate(NamedTuple):
    """An image that is among the worst so far; ordered by badness, then by place."""

    badness: float
    place: int
    sample: Sample
    match: PointMatch


class WorstImages:
    """Remembers the worst images, by the F1 of their points, and draws them."""

    def __init__(self, count: int) -> None:
        self.count, self._seen = count, 0
        self._heap: list[_Candidate] = []

    def add(self, sample: Sample, match: PointMatch) -> None:
        """Takes note of one image."""
        self._seen += 1
        candidate = _Candidate(1 - match.scores()["f1"], -self._seen, sample, match)
        if len(self._heap) < self.count:
            heapq.heappush(self._heap, candidate)
        elif self._heap:
            heapq.heappushpop(self._heap, candidate)

    def write(self, folder: Path) -> Sequence[BadImage]:
        """Writes a picture of each, and all of them on one sheet: hits, false alarms and misses."""
        pictures, titles, written = [], [], []
        for rank, (_, _, sample, match) in enumerate(sorted(self._heap, reverse=True), 1):
            image = pixels_of(sample)
            picture = _draw(enlarge(image, tiny_zoom((image.shape[0], image.shape[1]))), image.shape, match)
            name = Path(sample.name).with_suffix("").as_posix().replace("/", "-")
            path = folder / "worst" / f"{rank:02d}-{name}.png"
            write_image(path, picture)
            scores = match.scores()
            written.append(BadImage(sample.name, scores["f1"], scores["precision"], scores["recall"], path))
            # Lines of the picture would vanish on the sheet, lines drawn in its size would hide each other.
            pictures.append(_draw(fit_tile(image, _DRAWN), image.shape, match))
            titles.append(f"F1 {scores['f1']:.2f}  {sample.name}")
        if pictures:
            write_image(folder / "worst.png", contact_sheet(pictures, titles))
        return written


def _draw(canvas: Image, size: tuple[int, ...], match: PointMatch) -> Image:
    """Gives an image of `size`, of which `canvas` is a copy in another size, with what was counted."""
    scale = np.array(canvas.shape[1::-1]) / np.array(size[1::-1])
    found, truth = match.prediction.points * scale, match.truth.points * scale
    return draw_matches(
        canvas,
        hits=found[match.true_positives],
        false_alarms=found[match.false_positives],
        misses=truth[match.false_negatives],
        reach=match.radius * float(scale.min()),
    )


__all__ = ["BadImage", "WorstImages", "pixels_of"]
