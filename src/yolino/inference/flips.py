"""Mirrored images: the network sees each image and its mirror image, and its answers are joined.

A mirror exchanges left and right alone, so lines that run from bottom to top still do.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, UInt8

from yolino.types import Segments


def with_mirrors(batch: UInt8[np.ndarray, "b h w 3"]) -> UInt8[np.ndarray, "b2 h w 3"]:
    """Gives the images, then their mirror images in the same order, as one batch."""
    return np.concatenate([batch, batch[:, :, ::-1]])


def mirror_segments(segments: Segments, width: int) -> Segments:
    """Gives the segments of a mirror image in the image itself, or the other way round.

    Args:
        segments: In pixels of the network's input.
        width: Of the network's input, in pixels.
    """
    endpoints: Float[np.ndarray, "n 2 2"] = segments.endpoints.copy()
    endpoints[..., 0] = width - endpoints[..., 0]
    return segments.with_endpoints(endpoints)


__all__ = ["mirror_segments", "with_mirrors"]
