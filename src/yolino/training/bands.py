"""The pixels around lines that run up the image, row by row."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

LEAST_ROWS = 12  # of a line that anything is done with
MARGIN = 20  # pixels left and right of the image in which a line still counts
_SURFACE = 40.0  # gray values: further apart are two surfaces, or a car on one of them


class Band(NamedTuple):
    """In each row, the columns around `center` that are changed; `half` is half their number.

    Only columns from `first` up to `stop` hold a picture.
    """

    rows: Int[np.ndarray, " r"]
    center: Float[np.ndarray, " r"]
    half: Float[np.ndarray, " r"]
    first: Int[np.ndarray, " r"]
    stop: Int[np.ndarray, " r"]

    def where(self, chosen: Bool[np.ndarray, " r"]) -> Band:
        """Gives some of the rows."""
        return Band(*(values[chosen] for values in self))


class Pixels(NamedTuple):
    """The pixels of a band, row by row.

    `owners` are rows of the band, `rows` and `columns` those of the image; `at` is the place from -1 (left
    end of the band) to 1 (right end).
    """

    owners: Int[np.ndarray, " p"]
    rows: Int[np.ndarray, " p"]
    columns: Int[np.ndarray, " p"]
    at: Float[np.ndarray, " p"]


def columns_of(line: Float[np.ndarray, "v 2"], height: int) -> Float[np.ndarray, " h"]:
    """Gives the x of the line at the center of each image row, NaN above and below it."""
    if len(line) == 0:
        return np.full(height, np.nan)
    upward = line[np.argsort(line[:, 1], kind="stable")]
    rows = np.arange(height) + 0.5
    return np.asarray(np.interp(rows, upward[:, 1], upward[:, 0], left=np.nan, right=np.nan))


def continued(own: Float[np.ndarray, " h"]) -> tuple[Int[np.ndarray, " r"], Float[np.ndarray, " r"]]:
    """Gives the rows from the upper end of a line down to the edge of the image, and its x there.

    Labels end before the image does: the lower end is continued straight. The line has `LEAST_ROWS` rows.
    """
    labelled = np.flatnonzero(~np.isnan(own))
    rows = np.arange(labelled[0], len(own))
    last = labelled[-1]
    slope = (own[last] - own[last - 8]) / 8
    return rows, np.where(rows <= last, own[rows], own[last] + slope * (rows - last))


def extent_of(corners: Float[np.ndarray, "k 2"], height: int, width: int) -> Int[np.ndarray, "2 h"]:
    """Gives for each row the first column inside a convex polygon, and the one behind the last."""
    y = np.arange(height)[:, None] + 0.5
    start, delta = corners, np.roll(corners, -1, axis=0) - corners
    with np.errstate(divide="ignore", invalid="ignore"):
        at = (y - start[:, 1]) / delta[:, 1]
        x = start[:, 0] + at * delta[:, 0]
    crosses = (at >= 0) & (at <= 1)
    first = np.where(crosses, x, np.inf).min(axis=1).clip(0, width)
    stop = np.where(crosses, x, -np.inf).max(axis=1).clip(0, width)
    first, stop = np.ceil(first).astype(np.int64), np.floor(stop).astype(np.int64)
    return np.stack([first, np.maximum(first, stop)])


def pixels_of(band: Band, reach: float = 1.0) -> Pixels:
    """Gives the pixels within `reach` half widths of the band's center line that lie in the picture."""
    first = np.ceil(band.center - reach * band.half - 0.5).astype(np.int64).clip(band.first, band.stop)
    stop = np.floor(band.center + reach * band.half + 0.5).astype(np.int64).clip(first, band.stop)
    counts = stop - first
    owners = np.repeat(np.arange(len(counts)), counts)
    columns = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts - first, counts)
    at = (columns + 0.5 - band.center[owners]) / band.half[owners]
    return Pixels(owners, band.rows[owners], columns, at)


def bare_rows(
    left: Float[np.ndarray, "r 3"], right: Float[np.ndarray, "r 3"]
) -> tuple[Bool[np.ndarray, " r"], float]:
    """Gives the rows in which the ground shows on both sides, and the contrast between the sides there.

    The ground is the same color left and right (also in a shadow), or each side has its usual color.
    """
    if len(left) == 0:
        return np.zeros(0, np.bool_), 0.0
    across = np.abs(left - right).max(axis=1)
    unusual = [np.abs(side - np.median(side, axis=0)).max(axis=1) for side in (left, right)]
    bare = (across < _SURFACE) | (np.maximum(*unusual) < _SURFACE)
    return bare, float(np.median(across[bare])) if bare.any() else 0.0


__all__ = [
    "LEAST_ROWS",
    "MARGIN",
    "Band",
    "Pixels",
    "bare_rows",
    "columns_of",
    "continued",
    "extent_of",
    "pixels_of",
]
