"""Image -> input of the network, and the matrix that maps results back.

The input is axis-aligned in the image, so a crop and one resize do what a general warp would, much faster.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8
from numpy.typing import NDArray

from yolino.geometry import fit_matrix, transform_points
from yolino.header import FITS
from yolino.image import as_rgb
from yolino.io import reduce_image

# Where the network sees beyond the image: the gray in the middle of the colors that it normalizes with.
FILL = 114
_EXACT = 1e-6
_LARGEST_REDUCTION = 8  # of a JPEG decoder


class Preprocess:
    """Fits images of any size to the input of a network.

    Args:
        size: Input of the network in pixels, (height, width).
        fit: "bottom" keeps the aspect ratio, fills the width and aligns the lower edges (a front view keeps
            the road), "stretch" fills the input, "letterbox" keeps the aspect ratio and shows everything.

    Raises:
        ValueError: If `fit` is none of these or `size` is not positive.
    """

    def __init__(self, size: tuple[int, int], fit: str = "bottom") -> None:
        if fit not in FITS:
            raise ValueError(f"fit is {fit!r}, but must be one of {', '.join(FITS)}.")
        if min(size) < 1:
            raise ValueError(f"size is {size}, but (height, width) must be positive.")
        self.size = size
        self.fit = fit

    def matrix(self, image_size: tuple[int, int]) -> Float[np.ndarray, "3 3"]:
        """Gives the matrix from pixels of an image of `image_size` (height, width) to pixels of the input."""
        return fit_matrix(image_size, self.size, self.fit)

    def __call__(
        self, image: NDArray[np.generic]
    ) -> tuple[UInt8[np.ndarray, "h w 3"], Float[np.ndarray, "3 3"]]:
        """Gives the input of the network, and the matrix from its pixels to pixels of the image.

        Args:
            image: RGB `(h, w, 3)` or gray `(h, w)`, uint8.

        Raises:
            ValueError: If the array is no such image; the message says what it is and what is allowed.
        """
        image = as_rgb(image)
        plan = _plan((image.shape[0], image.shape[1]), self.size, self.fit)
        if image.strides[2] < 0:  # `bgr[..., ::-1]`: turning the colors of the small result is cheaper
            fitted = _fit(image[:, :, ::-1], plan, self.size)[:, :, ::-1]
        else:
            fitted = _fit(image, plan, self.size)
        return fitted, plan.backward.copy()

    def reduction(self, image_size: tuple[int, int]) -> int:
        """Gives by how much an image of `image_size` (height, width) is reduced anyway: 1, 2, 4 or 8.

        No side of the result is enlarged by more than rounding afterwards.
        """
        return min(_plan(image_size, self.size, self.fit).factor, _LARGEST_REDUCTION)


class _Plan(NamedTuple):
    """How images of one size become the input.

    Attributes:
        backward: Matrix from pixels of the input to pixels of the image.
        box: Part of the image that is seen, whole pixels `((left, top), (right, bottom))`.
        factor: By how much that part is reduced first, so that no pixel is skipped.
        target: Where it goes in the input, `((left, top), (right, bottom))`.
        resized: Whether one resize does the rest; else it is warped.
        covered: Whether it fills the input.
        scale: Of the warp, along x and y.
        shift: Of the warp, in pixels of the input.
    """

    backward: Float[np.ndarray, "3 3"]
    box: Int[np.ndarray, "2 2"]
    factor: int
    target: Float[np.ndarray, "2 2"]
    resized: bool
    covered: bool
    scale: Float[np.ndarray, "xy=2"]
    shift: Float[np.ndarray, "xy=2"]


@lru_cache(maxsize=64)  # the frames of a camera have one size: planning anew costs as much as the resize
def _plan(image_size: tuple[int, int], size: tuple[int, int], fit: str) -> _Plan:
    matrix = fit_matrix(image_size, size, fit)
    backward = np.linalg.inv(matrix)
    limits = np.array(image_size[::-1], np.float64), np.array(size[::-1], np.float64)
    source = np.clip(transform_points(np.array([[0.0, 0.0], limits[1]]), backward), 0, limits[0])
    target = np.clip(transform_points(source, matrix), 0, limits[1])
    box, scale, factor = _whole_box(source), np.diag(matrix)[:2].copy(), 1
    while (scale * factor).max() <= 0.5 + _EXACT:
        factor *= 2
    resized = _is_whole(source) and _is_whole(target) and not ((box[1] - box[0]) % factor).any()
    covered = bool(np.all(target[0] <= _EXACT) and np.all(target[1] >= limits[1] - _EXACT))
    shift = matrix[:2, 2] + scale * box[0]
    return _Plan(backward, box, factor, target, resized, covered, scale * factor, shift)


def _fit(
    image: UInt8[np.ndarray, "h w 3"], plan: _Plan, size: tuple[int, int]
) -> UInt8[np.ndarray, "nh nw 3"]:
    """Gives the pixels of the input: the part that is seen, reduced, then resized or warped."""
    (left, top), (right, bottom) = plan.box
    part = image[top:bottom, left:right]
    for _ in range(plan.factor.bit_length() - 1):  # halving twice takes half as long as quartering
        part = reduce_image(part, 2)
    fitted = _resize(part, plan.target) if plan.resized else _warp(part, plan.scale, plan.shift, size)
    return fitted if plan.covered else _paste(fitted, plan.target, size)


def _whole_box(box: Float[np.ndarray, "2 2"]) -> Int[np.ndarray, "2 2"]:
    return np.stack([np.floor(box[0] + _EXACT), np.ceil(box[1] - _EXACT)]).astype(np.int64)


def _is_whole(box: Float[np.ndarray, "2 2"]) -> bool:
    return bool((np.abs(box - box.round()) <= _EXACT).all())


def _resize(
    image: UInt8[np.ndarray, "h w 3"], target: Float[np.ndarray, "2 2"]
) -> UInt8[np.ndarray, "th tw 3"]:
    width, height = (target[1] - target[0]).round().astype(np.int64).tolist()
    if (height, width) == image.shape[:2]:
        return image
    far = image.shape[0] >= 2 * height or image.shape[1] >= 2 * width
    interpolation = cv2.INTER_AREA if far else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, (width, height), interpolation=interpolation), np.uint8)


def _warp(
    image: UInt8[np.ndarray, "h w 3"],
    scale: Float[np.ndarray, "xy=2"],
    shift: Float[np.ndarray, "xy=2"],
    size: tuple[int, int],
) -> UInt8[np.ndarray, "nh nw 3"]:
    """Gives the whole input; beyond the image its outermost pixels go on."""
    matrix = np.column_stack(
        [np.diag(scale), shift + 0.5 * scale - 0.5]
    )  # OpenCV counts from the first center
    warped = cv2.warpAffine(
        image, matrix, size[::-1], flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(warped, np.uint8)


def _paste(
    fitted: UInt8[np.ndarray, "h w 3"], target: Float[np.ndarray, "2 2"], size: tuple[int, int]
) -> UInt8[np.ndarray, "nh nw 3"]:
    """Gives the input with the image in the box `target` (pixels, rounded) and the fill color elsewhere."""
    (left, top), (right, bottom) = target.round().astype(np.int64)
    canvas = np.full((*size, 3), FILL, np.uint8)
    part = fitted[top:bottom, left:right] if fitted.shape[:2] == size else fitted
    canvas[top:bottom, left:right] = part
    return canvas


__all__ = ["FILL", "Preprocess"]
