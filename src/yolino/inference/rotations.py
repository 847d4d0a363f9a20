"""Windows turned by quarters: a network without an up sees each several times, and its answers are joined."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, UInt8

from yolino.types import Segments

# Quarters to turn by, for each number of rotations.
QUARTERS = {1: (0,), 2: (0, 2), 4: (0, 1, 2, 3)}


def turn(image: UInt8[np.ndarray, "h w 3"], quarters: int) -> UInt8[np.ndarray, "h2 w2 3"]:
    """Gives an image turned counterclockwise by quarters."""
    return np.rot90(image, quarters)


def turn_predictors(
    chosen: Bool[np.ndarray, " n"], grid: tuple[int, int], quarters: int
) -> Bool[np.ndarray, " n"]:
    """Gives which predictors of the turned image lie in the cells of the chosen ones.

    Args:
        chosen: Of each predictor, cell by cell in rows.
        grid: Rows and columns of the cells before the turn.
        quarters: How far the image is turned.
    """
    return np.rot90(chosen.reshape(*grid, -1), quarters).ravel()


def turn_back(
    endpoints: Float[np.ndarray, "n 2 2"], size: tuple[int, int], quarters: int
) -> Float[np.ndarray, "n 2 2"]:
    """Gives points of the turned image in the image before the turn.

    Args:
        endpoints: In pixels of the turned image.
        size: `(height, width)` of the image before the turn.
        quarters: How far the image was turned.
    """
    x, y = endpoints[..., 0], endpoints[..., 1]
    height, width = size
    back = ((x, y), (width - y, x), (width - x, height - y), (y, height - x))
    return np.stack(back[quarters % 4], axis=-1)


def join_views(views: Sequence[Segments]) -> Segments:
    """Gives the segments of several views of one window as one value."""
    if len(views) == 1:
        return views[0]
    shares = [view.probabilities for view in views if view.probabilities is not None]
    return Segments(
        np.concatenate([view.endpoints for view in views]),
        np.concatenate([view.scores for view in views]),
        probabilities=np.concatenate(shares) if len(shares) == len(views) else None,
    )


__all__ = ["QUARTERS", "join_views", "turn", "turn_back", "turn_predictors"]
