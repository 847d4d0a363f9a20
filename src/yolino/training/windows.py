"""Windows of large images: aerial tiles and scans are trained in pieces of the network's size.

An image is decoded once, at the scale of the network, into a file that is mapped into memory; a window then
costs what it shows, not what the image holds.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, UInt8
from numpy.typing import NDArray

from yolino.datasets import Dataset
from yolino.geometry import resample
from yolino.io import image_size
from yolino.training.cache import PixelCache
from yolino.training.frames import warp
from yolino.types import Polylines, Sample

_APART = 32.0  # pixels of the network between neighboring places to look at along a line


class ScaledImages:
    """Gives images at one scale, each decoded once and then mapped from a file.

    Args:
        cache: Where the pixels are kept.
        scale: Pixels of the result per pixel of the image.
    """

    def __init__(self, cache: PixelCache, scale: float) -> None:
        self.cache, self.scale = cache, float(scale)

    def __call__(self, image: Path | NDArray[np.uint8]) -> UInt8[np.ndarray, "h w 3"]:
        """Gives the pixels of an image at the scale.

        Raises:
            FileNotFoundError: There is no such image.
            ValueError: It cannot be decoded.
            OSError: Its pixels cannot be written.
        """
        if not isinstance(image, Path):
            return image if self.scale == 1 else self._scaled(image)
        return self.cache(image, repr(self.scale), lambda: self._scaled(image))

    def size(self, image: Path | NDArray[np.uint8]) -> tuple[int, int]:
        """Gives `(height, width)` of an image at the scale."""
        height, width = image_size(image) if isinstance(image, Path) else image.shape[:2]
        return max(round(height * self.scale), 1), max(round(width * self.scale), 1)

    def bytes_of(self, image: Path) -> tuple[int, bool]:
        """Gives the bytes that the pixels of an image take on the disk, and whether they are there."""
        height, width = self.size(image)
        return 3 * height * width, self.cache.has(image, repr(self.scale))

    def _scaled(self, image: Path | NDArray[np.uint8]) -> UInt8[np.ndarray, "h w 3"]:
        return warp(image, np.diag([self.scale, self.scale, 1.0]), self.size(image))


class _Labels(NamedTuple):
    """The labels of one image in pixels of the network, with the box of each line and each region."""

    lines: Polylines
    boxes: Float[np.ndarray, "n 2 2"]
    ignore: Sequence[Float[np.ndarray, "_ 2"]]
    regions: Float[np.ndarray, "r 2 2"]


class Windows:
    """The windows of a dataset's images: a grid of them by index, or anywhere by `draw`.

    Args:
        dataset: The whole images.
        size: `(height, width)` of a window in pixels of the network.
        scale: Pixels of the network per pixel of the image.
        cache: Where the decoded images are kept.
        margin: How many times larger than `size` a drawn window is, so that there are pixels left where it
            is turned.
        near_lines: Share of drawn windows whose center lies on a line.
    """

    def __init__(
        self,
        dataset: Dataset,
        size: tuple[int, int],
        *,
        scale: float,
        cache: PixelCache,
        margin: float = 1.8,
        near_lines: float = 0.8,
    ) -> None:
        self.dataset, self.size, self.scale = dataset, size, float(scale)
        self.pixels, self.margin, self.near_lines = ScaledImages(cache, scale), margin, near_lines
        self.classes, self.directed = dataset.classes, dataset.directed

    @cached_property
    def _samples(self) -> list[Sample]:
        return [self.dataset[i] for i in range(len(self.dataset))]

    @cached_property
    def _labels(self) -> list[_Labels]:
        return [_scaled_labels(sample, self.scale) for sample in self._samples]

    @cached_property
    def _corners(self) -> list[tuple[int, int, int]]:
        """Image, top and left of the windows of the grid."""
        found = []
        for index, sample in enumerate(self._samples):
            tops, lefts = (
                _starts(whole, part)
                for whole, part in zip(self.pixels.size(sample.image), self.size, strict=True)
            )
            found += [(index, top, left) for top in tops for left in lefts]
        return found

    @cached_property
    def _places(self) -> list[Float[np.ndarray, "_ 2"]]:
        """Points on the lines of each image."""
        nothing = np.zeros((0, 2))
        return [
            np.concatenate([nothing, *(resample(line, _APART) for line in one.lines if len(line))])
            for one in self._labels
        ]

    def __len__(self) -> int:
        return len(self._corners)

    def __getitem__(self, index: int) -> Sample:
        image, top, left = self._corners[index]
        return self._window(image, (top, left), self.size)

    def draw(self, rng: np.random.Generator) -> Sample:
        """Gives a random window, larger than the network's input by the margin."""
        counts = np.array([len(places) for places in self._places])
        size = (int(np.ceil(self.margin * self.size[0])), int(np.ceil(self.margin * self.size[1])))
        if rng.random() < self.near_lines and counts.sum():
            image = int(rng.choice(len(counts), p=counts / counts.sum()))
            center = self._places[image][rng.integers(counts[image])]
            center = center + rng.uniform(-0.5, 0.5, 2) * 0.5 * np.array(self.size[::-1])
        else:
            image = int(rng.integers(len(counts)))
            center = rng.random(2) * self.pixels.size(self._samples[image].image)[::-1]
        whole = np.array(self.pixels.size(self._samples[image].image)[::-1], np.float64)
        half = np.minimum(np.array(self.size[::-1]), whole) / 2
        center = np.clip(center, half, whole - half)  # pixels beyond the image teach nothing
        left, top = np.floor(center - np.array(size[::-1]) / 2).astype(np.int64).tolist()
        return self._window(image, (top, left), size)

    def _window(self, index: int, corner: tuple[int, int], size: tuple[int, int]) -> Sample:
        """Gives a window, gray where the image does not reach; lines that only leave it are kept whole."""
        (top, left), (height, width) = corner, size
        pixels = self.pixels(self._samples[index].image)
        window = np.full((height, width, 3), 114, np.uint8)
        rows = slice(max(top, 0), min(top + height, pixels.shape[0]))
        columns = slice(max(left, 0), min(left + width, pixels.shape[1]))
        if rows.start < rows.stop and columns.start < columns.stop:
            window[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left] = pixels[
                rows, columns
            ]
        labels, origin = self._labels[index], np.array([left, top], np.float64)
        box = origin + np.array([[0.0, 0.0], [width, height]])
        lines = labels.lines[_touches(labels.boxes, box)]
        ignore = [labels.ignore[i] - origin for i in np.flatnonzero(_touches(labels.regions, box)).tolist()]
        ignore += _outside(pixels.shape[:2], box)
        name = f"{self._samples[index].name}, window {left},{top}"
        return Sample(name, window, lines.with_vertices(lines.vertices - origin), ignore, size)


def _scaled_labels(sample: Sample, scale: float) -> _Labels:
    lines = sample.polylines.with_vertices(sample.polylines.vertices * scale)
    ignore = [np.asarray(polygon, np.float64) * scale for polygon in sample.ignore]
    return _Labels(lines, _boxes(list(lines)), ignore, _boxes(ignore))


def _boxes(shapes: Sequence[Float[np.ndarray, "_ 2"]]) -> Float[np.ndarray, "n 2 2"]:
    """Gives the least and greatest x and y of each shape; a shape without points touches nothing."""
    boxes = [(one.min(axis=0), one.max(axis=0)) if len(one) else np.full((2, 2), np.nan) for one in shapes]
    return np.asarray(boxes, np.float64).reshape(-1, 2, 2)


def _touches(boxes: Float[np.ndarray, "n 2 2"], box: Float[np.ndarray, "2 2"]) -> NDArray[np.bool_]:
    return np.asarray((boxes[:, 0] <= box[1]).all(axis=1) & (boxes[:, 1] >= box[0]).all(axis=1))


def _starts(whole: int, part: int) -> list[int]:
    """Gives where parts begin that cover the whole; the last one ends with it."""
    return sorted({*range(0, max(whole - part, 0) + 1, part), max(whole - part, 0)})


def _outside(size: tuple[int, int], box: Float[np.ndarray, "2 2"]) -> list[Float[np.ndarray, "4 2"]]:
    """Gives the parts of a window beyond the image, in the window: nobody knows what is there."""
    height, width = size
    (left, top), (right, bottom) = box
    beyond = (
        (left, top, min(0.0, right), bottom),
        (max(float(width), left), top, right, bottom),
        (left, top, right, min(0.0, bottom)),
        (left, max(float(height), top), right, bottom),
    )
    return [
        np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]) - box[0]
        for x0, y0, x1, y1 in beyond
        if x0 < x1 and y0 < y1
    ]


__all__ = ["ScaledImages", "Windows"]
