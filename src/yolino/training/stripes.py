"""Stripes along a line of a photograph: the share of each pixel that they cover, mixed into its color."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from yolino.training.bands import Band

_FAINT = 0.004  # less is not painted
_SHARP = 8.0  # pixels per row: flatter lines are not followed further


class Cover(NamedTuple):
    """The pixels of a stripe.

    `owners` are rows of its band, `rows` and `columns` those of the image; `across` is the distance in pixels
    from its middle, to the right, and `share` how much of the pixel it covers.
    """

    owners: Int[np.ndarray, " p"]
    rows: Int[np.ndarray, " p"]
    columns: Int[np.ndarray, " p"]
    across: Float[np.ndarray, " p"]
    share: Float[np.ndarray, " p"]


def cover(band: Band, strength: Float[np.ndarray, " r"], softness: float = 0.0) -> Cover:
    """Gives the pixels of the stripe that fills a band, with smooth edges, and their covered shares.

    Across, the width is averaged over the pixel and over the slant of the line within a row; so what is
    thinner than a pixel gets faint.

    Args:
        band: The rows, the middle and half the width of the stripe.
        strength: The share of each row that is painted along the line.
        softness: Pixels over which the edges fade, as a share of the width, beyond what a pixel needs.
    """
    slant = np.abs(np.gradient(band.center)).clip(0, _SHARP)
    blur = np.maximum(np.maximum(1.0, slant), 2 * softness * band.half)
    first = np.floor(band.center - band.half - blur / 2).clip(band.first, band.stop).astype(np.int64)
    stop = np.ceil(band.center + band.half + blur / 2).clip(first, band.stop).astype(np.int64)
    counts = np.where(strength > _FAINT, stop - first, 0)
    owners = np.repeat(np.arange(len(counts)), counts)
    columns = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts - first, counts)
    across = columns + 0.5 - band.center[owners]
    low = np.maximum(across - blur[owners] / 2, -band.half[owners])
    high = np.minimum(across + blur[owners] / 2, band.half[owners])
    share = np.maximum(high - low, 0) / blur[owners] * strength[owners]
    return Cover(owners, band.rows[owners], columns, across, share)


def mix(
    image: UInt8[np.ndarray, "h w 3"],
    cover: Cover,
    colors: Float[np.ndarray, "p 3"] | Float32[np.ndarray, "p 3"],
) -> None:
    """Mixes the color of each covered pixel into an image, in place."""
    old = image[cover.rows, cover.columns].astype(np.float32)
    new = old + cover.share[:, None] * (colors - old)
    image[cover.rows, cover.columns] = np.rint(new).clip(0, 255).astype(np.uint8)


__all__ = ["Cover", "cover", "mix"]
