"""What a window shows: a part of a scene, read with what is around it, as pixels of the network's input.

Each pixel of the input depends on where it lies in the scene alone, never on the window: what two windows see
of the same place is the same to the last bit.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int, UInt8
from numpy.typing import NDArray

from yolino.image import as_rgb
from yolino.inference.preprocess import FILL
from yolino.inference.windows import Window
from yolino.io import reduce_image

Box = tuple[int, int, int, int]
"""Part of an image in whole pixels: left, top, right, bottom."""


class Pixels(NamedTuple):
    """Pixels of a part of a scene.

    Attributes:
        rgb: The colors.
        valid: Whether a pixel says anything; None if all do.
    """

    rgb: UInt8[np.ndarray, "h w 3"]
    valid: Bool[np.ndarray, "h w"] | None


@runtime_checkable
class Raster(Protocol):
    """Something of any size whose pixels can be read in parts."""

    @property
    def size(self) -> tuple[int, int]:
        """`(height, width)` in pixels."""
        ...

    def read(self, box: Box, /) -> Pixels:
        """Gives the pixels in a box that lies inside."""
        ...


class ImageRaster:
    """An image in memory, RGB `(h, w, 3)` or gray `(h, w)` of uint8.

    Raises:
        ValueError: If it is no such image.
    """

    def __init__(self, image: NDArray[np.generic]) -> None:
        self._image = as_rgb(image)
        self.size = (self._image.shape[0], self._image.shape[1])

    def read(self, box: Box) -> Pixels:
        """Gives the pixels in a box that lies inside."""
        left, top, right, bottom = box
        return Pixels(self._image[top:bottom, left:right], None)


def view(raster: Raster, window: Window, size: tuple[int, int], scale: float) -> Pixels:
    """Gives what the network sees of a scene in a window; beyond the scene it is gray, and not valid.

    Pixels are averaged where the network sees the scene much smaller, and interpolated for the rest.

    Args:
        raster: The scene.
        window: The window.
        size: `(height, width)` of the window in pixels of the network's input.
        scale: Pixels of the network's input per pixel of the scene.
    """
    factor = 1
    while scale * factor <= 0.5 + 1e-9:
        factor *= 2
    rows, columns = (
        _Axis.of(start, edge, extent, scale, factor)
        for start, edge, extent in zip((window.top, window.left), size, raster.size, strict=True)
    )
    canvas = np.full((*size, 3), FILL, np.uint8)
    seen = np.zeros(size, np.bool_)
    if rows.inside.start < rows.inside.stop and columns.inside.start < columns.inside.stop:
        pixels = raster.read((columns.low, rows.low, columns.high, rows.high))
        canvas[rows.inside, columns.inside] = _sample(reduce_image(pixels.rgb, factor), rows, columns)
        seen[rows.inside, columns.inside] = True
        if pixels.valid is not None:
            seen[rows.inside, columns.inside] = pixels.valid[np.ix_(rows.centers, columns.centers)]
    return Pixels(canvas, None if seen.all() else seen)


class _Axis(NamedTuple):
    """How the pixels of a window come from those of the scene, along one axis.

    Attributes:
        inside: Pixels of the window whose centers lie in the scene; the rest is about these.
        low: First pixel of the scene that is needed.
        high: The one behind the last.
        centers: Pixel of the scene, from `low` on, in which each center lies.
        before: Reduced pixel, from `low` on, whose center lies before each center.
        after: The one that follows it.
        share: Of the one after, 0..1.
    """

    inside: slice
    low: int
    high: int
    centers: Int[np.ndarray, " n"]
    before: Int[np.ndarray, " n"]
    after: Int[np.ndarray, " n"]
    share: Float32[np.ndarray, " n"]

    @classmethod
    def of(cls, start: int, edge: int, extent: int, scale: float, factor: int) -> _Axis:
        """Plans the pixels from `start` on, of a scene of `extent` pixels that is first reduced."""
        first = min(max(-start, 0), edge)
        pixels = max(math.ceil(extent * scale - 0.5), 1)  # less than half a pixel is seen, too
        last = min(max(pixels - start, first), edge)
        places: Float64[np.ndarray, " n"] = np.arange(first + start, last + start) + 0.5
        if not len(places):
            none = np.zeros(0, np.int64)
            return cls(slice(first, first), 0, 0, none, none, none, np.zeros(0, np.float32))
        at, most = places / (scale * factor) - 0.5, -(-extent // factor) - 1
        floor = np.floor(at)
        before, after = (np.clip(floor + i, 0, most).astype(np.int64) for i in (0, 1))
        low, high = int(before[0]), int(after[-1]) + 1
        centers = np.minimum(places / scale, extent - 1).astype(np.int64) - low * factor
        ends = low * factor, min(high * factor, extent)
        share = (at - floor).astype(np.float32)
        return cls(slice(first, last), *ends, centers, before - low, after - low, share)


def _sample(image: UInt8[np.ndarray, "h w 3"], rows: _Axis, columns: _Axis) -> UInt8[np.ndarray, "nh nw 3"]:
    """Gives the colors at the centers, bilinear."""
    if not (rows.share.any() or columns.share.any()):
        return np.asarray(image[rows.before][:, columns.before])
    right, below = columns.share[None, :, None], rows.share[:, None, None]
    lines = image[rows.before] * (1 - below) + image[rows.after] * below
    mixed = lines[:, columns.before] * (1 - right) + lines[:, columns.after] * right
    return np.asarray((mixed + 0.5).astype(np.uint8))


__all__ = ["Box", "ImageRaster", "Pixels", "Raster", "view"]
