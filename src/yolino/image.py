"""What counts as an image: an array of RGB pixels, or a file of such a suffix."""

from __future__ import annotations

import numpy as np
from jaxtyping import UInt8
from numpy.typing import NDArray

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".bmp", ".jp2", ".ppm", ".pgm")
"""Suffixes of the image files that folders are searched for, in lower case."""


def as_rgb(image: object) -> UInt8[np.ndarray, "h w 3"]:
    """Gives `image` as `(h, w, 3)` uint8: unchanged if it is that, repeated three times if it is gray.

    Raises:
        ValueError: If it is no array of such pixels.
    """
    if not isinstance(image, np.ndarray):
        raise ValueError(
            f"An image must be a numpy array (h, w, 3) of uint8 RGB pixels, got {type(image).__name__}; "
            "read a file with yolino.io.read_image(path)."
        )
    if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] != 3):
        hint = (
            "; drop the alpha channel with image[..., :3]" if image.ndim == 3 and image.shape[2] == 4 else ""
        )
        raise ValueError(f"An image must have the shape (h, w, 3) or (h, w), got {image.shape}{hint}.")
    if image.size == 0:
        raise ValueError(f"The image is empty: its shape is {image.shape}.")
    if image.dtype != np.uint8:
        raise ValueError(
            f"An image must be uint8 with values in 0..255, got {image.dtype}{_dtype_hint(image)}."
        )
    return image if image.ndim == 3 else np.repeat(image[:, :, None], 3, axis=2)


def check_batch(batch: np.ndarray, size: tuple[int, int]) -> None:
    """Raises ValueError if this is no batch of RGB images of the network's input `size`, (height, width).

    Not every engine would notice: OpenVINO makes uint8 of any type.
    """
    if batch.ndim != 4 or batch.dtype != np.uint8 or batch.shape[3] != 3 or len(batch) == 0:
        raise ValueError(
            "The network takes a batch of at least one RGB image, uint8 (b, h, w, 3), got "
            f"{batch.dtype} {batch.shape}."
        )
    if batch.shape[1:3] != tuple(size):
        raise ValueError(f"The network takes images of {size} (height, width), got {batch.shape[1:3]}.")


def _dtype_hint(image: NDArray[np.generic]) -> str:
    if image.dtype == np.uint16:
        return "; scale 16 bits with (image >> 8).astype(np.uint8)"
    if image.dtype == np.bool_ or np.issubdtype(image.dtype, np.floating):
        return "; scale 0..1 with (image * 255).round().astype(np.uint8)"
    return "; convert with image.astype(np.uint8)"


__all__ = ["IMAGE_SUFFIXES", "as_rgb", "check_batch"]
