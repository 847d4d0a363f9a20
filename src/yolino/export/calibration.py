"""Calibration: the images that int8 takes its ranges from, and by whose labels it is judged."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from yolino.datasets import Dataset
from yolino.evaluate import evaluate, point_radius
from yolino.inference import Predictor
from yolino.inference.rotations import turn
from yolino.inference.views import ImageRaster, view
from yolino.io import image_size, read_image
from yolino.metrics import PointMetric
from yolino.types import Sample

Progress = Callable[[Sequence[int], str], Iterable[int]]
"""Wraps indices that are looped over, to show a progress bar with a title."""
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Calibration:
    """What int8 is made and judged with.

    Attributes:
        dataset: Labelled images like those that the model will see.
        images: How many of them, taken evenly; all, if there are fewer. Of a model that sees windows, as many
            windows of these images.
        max_drop: By how much the F1 of the polylines may fall.

    Raises:
        ValueError: A number is out of range, or the dataset is empty.
    """

    dataset: Dataset
    images: int = 200
    max_drop: float = 0.01

    def __post_init__(self) -> None:
        if self.images < 1:
            raise ValueError(f"images is {self.images}, but must be at least 1.")
        if not 0 <= self.max_drop <= 1:
            raise ValueError(f"max_drop is {self.max_drop}, but an F1 falls by 0 to 1.")
        if len(self.dataset) == 0:
            raise ValueError("The calibration data has no images: check the folder and the split.")

    def chosen(self) -> Chosen:
        """Gives the images that are used.

        Raises:
            ValueError: None of them has a label.
        """
        chosen = Chosen(self.dataset, evenly(len(self.dataset), self.images))
        if not any(len(chosen[i].polylines) for i in range(len(chosen))):
            raise ValueError(
                f"None of the {len(chosen)} calibration images has a labelled line, and what int8 costs is "
                "measured with labels: give labelled images."
            )
        return chosen


def evenly(total: int, count: int) -> list[int]:
    """Gives `count` of the indices below `total` at even distances, from 0 on; all, if there are fewer."""
    count = min(count, total)
    return [i * total // count for i in range(count)]


class Chosen:
    """Some samples of a dataset, itself a dataset."""

    def __init__(self, dataset: Dataset, indices: Sequence[int]) -> None:
        self.classes, self.directed = dataset.classes, dataset.directed
        self._dataset, self._indices = dataset, indices

    def __len__(self) -> int:
        return len(self._indices)

    def __getitem__(self, index: int) -> Sample:
        return self._dataset[self._indices[index]]


class Inputs:
    """What the network sees of images, one input at a time: `(1, h, w, 3)`, as in prediction.

    They are read when they are asked for, as all of them may not fit into the memory. Of a model that sees
    windows, these are windows evenly taken from all of the images', turned by turns.

    Args:
        predictor: The model.
        dataset: The images.
        count: Number of inputs at most.
        progress: Shows a progress bar at each walk over the inputs.
    """

    def __init__(self, predictor: Predictor, dataset: Dataset, count: int, progress: Progress) -> None:
        self._predictor, self._dataset, self._progress = predictor, dataset, progress
        places = [(i, window) for i in range(len(dataset)) for window in range(self._views(i))]
        self._places = [places[i] for i in evenly(len(places), count)]
        self._pixels = lru_cache(maxsize=1)(self._read)  # windows of one image follow each other

    def __len__(self) -> int:
        return len(self._places)

    def __iter__(self) -> Iterator[UInt8[np.ndarray, "1 h w 3"]]:
        for i in self._progress(range(len(self)), "calibrating"):
            yield self[i]

    def __getitem__(self, index: int) -> UInt8[np.ndarray, "1 h w 3"]:
        image, number = self._places[index]
        pixels, predictor = self._pixels(image), self._predictor
        if predictor.header.fit != "window":
            return np.ascontiguousarray(predictor.preprocess(pixels)[0][None])
        window = predictor.plan((pixels.shape[0], pixels.shape[1]))[number]
        seen = view(ImageRaster(pixels), window, predictor.header.size, predictor.header.scale).rgb
        return np.ascontiguousarray(turn(seen, predictor.quarters[index % len(predictor.quarters)])[None])

    def _views(self, index: int) -> int:
        """Gives how many inputs the image makes."""
        if self._predictor.header.fit != "window":
            return 1
        image = self._dataset[index].image
        return len(self._predictor.plan(image_size(image) if isinstance(image, Path) else image.shape[:2]))

    def _read(self, index: int) -> UInt8[np.ndarray, "h w 3"]:
        image = self._dataset[index].image
        return read_image(image) if isinstance(image, Path) else image


def polyline_f1(predictor: Predictor, dataset: Dataset, progress: Progress, title: str) -> float:
    """Gives the F1 of the polylines, as `yolino evaluate` reports it."""
    directed = predictor.header.directed and dataset.directed
    metric = PointMetric(directed=directed, radius=point_radius(predictor.header))
    found = evaluate(
        predictor, dataset, metrics={"points": metric}, progress=lambda indices: progress(indices, title)
    )
    return float(found.scores["f1"])


def check_drop(before: float, after: float, max_drop: float, images: int) -> None:
    """Refuses a quantized network that finds too much less.

    Args:
        before: F1 of the polylines.
        after: F1 of the polylines of the quantized network.
        max_drop: By how much it may fall, inclusive.
        images: Number of images that both were measured on.

    Raises:
        ValueError: It falls by more, or was 0 already, which shows nothing.
    """
    if not before > 0:
        raise ValueError(
            f"The model finds none of the lines in the {images} calibration images even before it is "
            "quantized (F1 0): give images like those it was trained on."
        )
    drop = before - after
    if not drop <= max_drop + _ROUNDING:
        raise ValueError(
            f"int8 lowers the F1 of the polylines on the {images} calibration images from {before:.4f} to "
            f"{after:.4f}: by {drop:.4f}, but at most {max_drop:g} is allowed. Calibrate with more or other "
            "images, allow more with --max-drop, or take --precision fp16."
        )


__all__ = ["Calibration", "Chosen", "Inputs", "Progress", "check_drop", "evenly", "polyline_f1"]
