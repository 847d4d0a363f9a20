"""Noise tiles for drawn scenes: computed once per process, the same in every process."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.floating[Any]]
"""Numbers of single or double precision."""


@lru_cache(maxsize=16)
def noise(slope: float, size: int = 512) -> NDArray[np.float32]:
    """Gives a tile of Gaussian noise that continues over its borders.

    Args:
        slope: The amplitude spectrum falls with `1 / frequency ** slope`: 0 is white, 2 is clouds.
        size: Rows and columns of the tile.

    Returns:
        A read-only `(size, size)` array of mean 0 and deviation 1, clipped to [-3, 3].
    """
    rng = np.random.default_rng([int(slope * 100), size])
    spectrum = np.fft.rfft2(rng.standard_normal((size, size)))
    frequency = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None])
    frequency[0, 0] = np.inf
    tile = np.fft.irfft2(spectrum / frequency**slope, (size, size))
    tile = np.clip((tile - tile.mean()) / tile.std(), -3, 3).astype(np.float32)
    tile.flags.writeable = False
    return np.asarray(tile)


@lru_cache(maxsize=16)
def _repeated(slope: float, size: int, rows: int, columns: int) -> NDArray[np.float32]:
    tiles = np.tile(noise(slope, size), (rows, columns))
    tiles.flags.writeable = False
    return np.asarray(tiles)


def crop(
    slope: float, size: tuple[int, int], rng: np.random.Generator, tile: int = 512
) -> NDArray[np.float32]:
    """Gives a random piece of `size` (height, width) of a noise tile, read-only, repeated where needed."""
    h, w = size
    row, column = (int(v) for v in rng.integers(0, tile, 2))
    whole = _repeated(slope, tile, 1 + -(-h // tile), 1 + -(-w // tile))
    return whole[row : row + h, column : column + w]


def sample(tile: NDArray[np.float32], column: Reals, row: Reals) -> NDArray[np.float32]:
    """Gives the nearest values of a tile that repeats for ever, its size a power of two.

    Args:
        tile: `(size, size)`.
        column: Where to look, in entries: one value per pixel `(h, w)`.
        row: Likewise, one value per image row `(h, 1)`.
    """
    size = len(tile)
    index = column.astype(np.int32) & (size - 1)
    index += (row.astype(np.int32) & (size - 1)) * size
    return np.take(tile.ravel(), index)


__all__ = ["Reals", "crop", "noise", "sample"]
