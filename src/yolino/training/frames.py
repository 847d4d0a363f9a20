"""The pixels of images at the scale that training needs: decoded, or mapped from a file that holds them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from numpy.typing import NDArray

from yolino.geometry import fit_matrix, transform_points
from yolino.image import as_rgb
from yolino.io import image_size, read_image, reduce_image
from yolino.training.cache import PixelCache, state_of

Matrix = Float[np.ndarray, "3 3"]
Image = Path | UInt8[np.ndarray, "h w 3"]
"""A file, or RGB pixels."""

_ENLARGED = 1.25  # little is lost, and decoding at half the size takes a third of the time


class Frames:
    """Gives the size and the pixels of whole images; a file is decoded each time."""

    def open(self, image: Path | NDArray[np.uint8]) -> Path | UInt8[np.ndarray, "h w 3"]:
        """Gives a JPEG as it is, so that it can be decoded at the needed scale, and the pixels of others."""
        if not isinstance(image, Path):
            return as_rgb(image)
        return image if image.suffix.lower() in (".jpg", ".jpeg") else read_image(image)

    def size(self, image: Path | NDArray[np.uint8]) -> tuple[int, int]:
        """Gives `(height, width)` of an image."""
        if isinstance(image, Path):
            return image_size(image)
        return image.shape[0], image.shape[1]

    def pixels(
        self, image: Path | NDArray[np.uint8], reduce: int, size: tuple[int, int]
    ) -> UInt8[np.ndarray, "a b 3"]:
        """Gives the image of `size` with one pixel for a block of `reduce` rows and columns."""
        if not isinstance(image, Path):
            return reduce_image(image, reduce)
        # EXIF may turn blocks that are cut off to the upper or left edge.
        if all(n % reduce == 0 for n in size):
            return read_image(image, reduce=reduce)
        return reduce_image(read_image(image), reduce)


class CachedFrames(Frames):
    """Gives the same; a file is decoded once at the scale of the plain fit, and then mapped.

    An augmentation that magnifies an image much reads a finer scale, which is not kept: with the preset
    `gentle` one image in 17, for which the files would have to be five times as large.

    Args:
        cache: Where the pixels are kept.
        size: `(height, width)` of the network's input.
        fit: How images are fitted to it.
    """

    def __init__(self, cache: PixelCache, size: tuple[int, int], fit: str) -> None:
        self.cache, self._target, self._fit = cache, size, fit
        self._sizes: dict[Path, tuple[tuple[int, int], tuple[int, int]]] = {}

    def open(self, image: Path | NDArray[np.uint8]) -> Path | UInt8[np.ndarray, "h w 3"]:
        """Gives a file as it is."""
        return image if isinstance(image, Path) else as_rgb(image)

    def size(self, image: Path | NDArray[np.uint8]) -> tuple[int, int]:
        """Gives `(height, width)` of an image; of some kinds of files it costs as much as decoding."""
        if not isinstance(image, Path):
            return super().size(image)
        state = state_of(image)
        if image not in self._sizes or self._sizes[image][0] != state:
            self._sizes[image] = (state, super().size(image))
        return self._sizes[image][1]

    def pixels(
        self, image: Path | NDArray[np.uint8], reduce: int, size: tuple[int, int]
    ) -> UInt8[np.ndarray, "a b 3"]:
        """Gives the image of `size` with one pixel for a block of `reduce` rows and columns."""
        if not isinstance(image, Path) or reduce != self._kept(size):
            return super().pixels(image, reduce, size)
        decode = super().pixels
        return self.cache(image, f"reduce {reduce}", lambda: decode(image, reduce, size))

    def bytes_of(self, image: Path) -> tuple[int, bool]:
        """Gives the bytes that the pixels of an image take on the disk, and whether they are there."""
        size = self.size(image)
        reduce = self._kept(size)
        return 3 * -(-size[0] // reduce) * -(-size[1] // reduce), self.cache.has(image, f"reduce {reduce}")

    def _kept(self, size: tuple[int, int]) -> int:
        return reduction(fit_matrix(size, self._target, self._fit), self._target)


def warp(
    image: Path | NDArray[np.uint8], matrix: Matrix, size: tuple[int, int], *, fill: int = 114
) -> UInt8[np.ndarray, "h w 3"]:
    """Gives the image of `size` whose points are the points of `image` after `matrix`.

    A file is decoded, and an array averaged, at the coarsest of 1, 1/2, 1/4 and 1/8 that loses little.

    Args:
        image: A file or RGB pixels.
        matrix: From the image frame to the frame of the result.
        size: `(height, width)` of the result.
        fill: Gray value where the image does not reach.
    """
    frames, reduce = Frames(), reduction(matrix, size)
    return warp_pixels(frames.pixels(image, reduce, frames.size(image)), reduce, matrix, size, fill=fill)


def warp_pixels(
    pixels: UInt8[np.ndarray, "a b 3"], reduce: int, matrix: Matrix, size: tuple[int, int], *, fill: int = 114
) -> UInt8[np.ndarray, "h w 3"]:
    """Does the same with pixels that already stand for blocks of `reduce` rows and columns of the image."""
    # OpenCV has pixel centers at integers, we have them at .5.
    half = _translation(0.5, 0.5)
    inner = _translation(-0.5, -0.5) @ matrix @ np.diag([reduce, reduce, 1.0]) @ half
    options: dict[str, Any] = {
        "dsize": (size[1], size[0]),
        "flags": cv2.INTER_LINEAR,
        "borderMode": cv2.BORDER_CONSTANT,
        "borderValue": (fill, fill, fill),
    }
    if np.array_equal(inner[2], (0.0, 0.0, 1.0)):
        return np.asarray(cv2.warpAffine(pixels, inner[:2], **options))
    return np.asarray(cv2.warpPerspective(pixels, inner, **options))


def reduction(matrix: Matrix, target: tuple[int, int]) -> int:
    """Gives the largest of 1, 2, 4, 8 from which no side of the result is enlarged much."""
    at = transform_points(corners_of(target), np.linalg.inv(matrix))
    x, y = at[1] - at[0], at[3] - at[0]
    finest = min(np.hypot(*x) / target[1], np.hypot(*y) / target[0])
    return max(k for k in (1, 2, 4, 8) if k == 1 or k <= _ENLARGED * finest)


def corners_of(size: tuple[int, int]) -> Float[np.ndarray, "4 2"]:
    """Gives the corners of a frame of `size` (height, width), clockwise from top left."""
    height, width = size
    return np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])


def _translation(x: float, y: float) -> Matrix:
    return np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])


__all__ = ["CachedFrames", "Frames", "corners_of", "reduction", "warp", "warp_pixels"]
