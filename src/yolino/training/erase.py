"""Augmentation that removes an outer polyline with its pixels, so that fewer lines become a common sight."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from yolino.training.bands import (
    LEAST_ROWS,
    MARGIN,
    Band,
    bare_rows,
    columns_of,
    continued,
    extent_of,
    pixels_of,
)
from yolino.types import Polylines

_HALF_WIDTH = 0.1  # of the distance to the neighbour: paint with the error of its label
_LEAST_HALF_WIDTH = 2.5  # pixels
_REACH = 1.25  # half widths: from 1 to here the new pixels fade into the old ones
_STEP = 2.5  # half widths: how far away the new pixels are taken
_EDGE = 20.0  # gray values between both sides from which their border stays sharp


def erase_outer_line(
    image: UInt8[np.ndarray, "h w 3"],
    polylines: Polylines,
    rng: np.random.Generator,
    *,
    corners: Float[np.ndarray, "k 2"] | None = None,
) -> tuple[UInt8[np.ndarray, "h w 3"], Polylines]:
    """Gives image and labels without the leftmost or the rightmost polyline, where that can be done.

    The band around the line takes the pixels from both of its sides, faded into one another, or with a
    sharp border where they are two surfaces. Rows in which something covers the line (a car) keep their
    pixels. Image and labels come back as they are where there are fewer than three polylines, no polyline
    is outermost in all rows it shares with others, or too much of it is covered.

    Args:
        image: The image; it is not changed.
        polylines: Lines that run up the image, in pixels of `image`.
        rng: Chooses between left and right.
        corners: The convex polygon of the image that holds a picture, if not all of it does: the fill of an
            augmentation is no road.
    """
    if len(polylines) < 3:
        return image, polylines
    height, width = image.shape[:2]
    if corners is None:
        corners = np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
    extent = extent_of(corners, height, width)
    columns = np.stack([columns_of(line, height) for line in polylines])
    for side in (-1.0, 1.0) if rng.random() < 0.5 else (1.0, -1.0):
        index = _outermost(columns, side)
        if index is None:
            continue
        band = _band(columns, index, side, extent)
        filled = None if band is None else _fill(image, band, rng)
        if filled is not None:
            keep: Bool[np.ndarray, " n"] = np.arange(len(polylines)) != index
            return filled, polylines[keep]
    return image, polylines


def _outermost(columns: Float[np.ndarray, "n h"], side: float) -> int | None:
    """Gives the line that lies left (-1) or right (1) of every other in all rows both have, or None."""
    for index, own in enumerate(columns):
        ahead = side * (own - np.delete(columns, index, axis=0))
        shared = ~np.isnan(ahead)
        if shared.any() and np.all(ahead[shared] > 0):
            return index
    return None


def _band(
    columns: Float[np.ndarray, "n h"], index: int, side: float, extent: Int[np.ndarray, "2 h"]
) -> Band | None:
    """Gives the band around a line, or None if the line is too short.

    It is as wide as the distance to the neighbour asks for: this and the width of the paint grow linearly
    from the horizon down. Labels end before the image does: the lower end is continued straight to the
    edge.
    """
    own = columns[index]
    gap = np.nan_to_num(side * (own - np.delete(columns, index, axis=0)), nan=np.inf).min(axis=0)
    known = np.flatnonzero(np.isfinite(gap))
    labelled = np.flatnonzero(~np.isnan(own))
    if min(len(known), len(labelled)) < LEAST_ROWS:
        return None
    rows, center = continued(own)
    growth, offset = np.polyfit(known, gap[known], 1)
    half = np.maximum(_HALF_WIDTH * (growth * rows + offset), _LEAST_HALF_WIDTH)
    first, stop = extent[:, rows]
    near = (center > first - MARGIN - _REACH * half) & (center < stop + MARGIN + _REACH * half)
    rows, center, half, first, stop = (values[near] for values in (rows, center, half, first, stop))
    return Band(rows, center, half, first, stop) if len(rows) >= LEAST_ROWS else None


def _fill(
    image: UInt8[np.ndarray, "h w 3"], band: Band, rng: np.random.Generator
) -> UInt8[np.ndarray, "h w 3"] | None:
    """Gives the image with the band filled from both sides, or None if too much of the line is covered."""
    pixels = pixels_of(band, _REACH)
    first, stop = band.first[pixels.owners], band.stop[pixels.owners]
    step = np.rint(_STEP * band.half).astype(np.int64)[pixels.owners]
    left, right = pixels.columns - step, pixels.columns + step
    from_left = image[pixels.rows, left.clip(first)].astype(np.float32)
    from_right = image[pixels.rows, right.clip(max=stop - 1)].astype(np.float32)
    # Where one side lies beside the picture, the other stands for both.
    from_left, from_right = (
        np.where((left < first)[:, None], from_right, from_left),
        np.where((right >= stop)[:, None], from_left, from_right),
    )
    count = np.bincount(pixels.owners, minlength=len(band.rows))
    seen = count > 0
    means = [_row_means(values, pixels.owners, count) for values in (from_left, from_right)]
    bare, contrast = bare_rows(means[0][seen], means[1][seen])
    if seen.sum() < LEAST_ROWS or bare.mean() < 0.65:
        return None
    sharpness, border = (4.0, rng.uniform(-0.8, 0.8)) if contrast > _EDGE else (0.5, 0.0)
    share = np.clip(sharpness * (pixels.at - border) + 0.5, 0, 1)[:, None]
    opacity = np.zeros(len(band.rows))
    opacity[seen] = np.convolve(np.pad(bare.astype(float), 1, "edge"), [0.25, 0.5, 0.25], "valid")
    opacity = opacity[pixels.owners] * np.clip((_REACH - np.abs(pixels.at)) / (_REACH - 1), 0, 1)
    old = image[pixels.rows, pixels.columns].astype(np.float32)
    new = old + opacity[:, None] * ((1 - share) * from_left + share * from_right - old)
    result = image.copy()
    result[pixels.rows, pixels.columns] = np.rint(new).astype(np.uint8)
    return result


def _row_means(
    values: Float[np.ndarray, "p 3"], owners: Int[np.ndarray, " p"], count: Int[np.ndarray, " r"]
) -> Float[np.ndarray, "r 3"]:
    sums = [np.bincount(owners, weights=values[:, channel], minlength=len(count)) for channel in range(3)]
    return np.asarray(np.stack(sums, axis=1) / np.maximum(count, 1)[:, None])


__all__ = ["erase_outer_line"]
