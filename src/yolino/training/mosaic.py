"""Augmentation that joins the parts of two training images along a random border."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from yolino.geometry import clip_polylines, transform_points
from yolino.training.augment import Augmented
from yolino.types import Polylines

PLACES = (0.25, 0.75)
"""Where the border crosses the middle row, as a share of the width."""

_SLANT = 0.35  # columns per row: the steepest border
_FAR = 1e6  # pixels: beyond every line


def join_images(left: Augmented, right: Augmented, rng: np.random.Generator) -> Augmented:
    """Gives the part of one image left of a straight border, and that of another image right of it.

    The border runs from the upper to the lower edge, upright or a little slanted. Polylines and ignored
    regions are cut there; pieces keep their directions and labels.

    Args:
        left: An image with its labels, in the network frame.
        right: Another of the same size.
        rng: Source of randomness.

    Raises:
        ValueError: The sizes differ.
    """
    if left.image.shape != right.image.shape:
        raise ValueError(
            f"Images of the shapes {left.image.shape} and {right.image.shape} cannot be joined: use one size."
        )
    height, width = left.image.shape[:2]
    slant = rng.uniform(-_SLANT, _SLANT)
    border = rng.uniform(*PLACES) * width - slant * height / 2  # at the upper edge
    column = border + slant * (np.arange(height) + 0.5)
    first = (np.arange(width) + 0.5)[None] < column[:, None]
    # Points left of the border get a positive x, as seen from it, and every y is positive.
    to_left = np.array([[-1.0, slant, border], [0.0, 1.0, _FAR], [0.0, 0.0, 1.0]])
    to_right = np.array([[1.0, -slant, -border], [0.0, 1.0, _FAR], [0.0, 0.0, 1.0]])
    parts = [_part(left, to_left), _part(right, to_right)]
    return Augmented(
        np.where(first[..., None], left.image, right.image),
        _concatenate(parts[0][0], parts[1][0]),
        (*parts[0][1], *parts[1][1]),
    )


def _part(
    one: Augmented, matrix: Float[np.ndarray, "3 3"]
) -> tuple[Polylines, list[Float[np.ndarray, "_ 2"]]]:
    """Gives the lines and regions of an image where `matrix` makes x positive."""
    back = np.linalg.inv(matrix)
    moved = one.polylines.with_vertices(transform_points(one.polylines.vertices, matrix))
    lines = clip_polylines(moved, (int(2 * _FAR), int(_FAR)))
    regions = [_clip_polygon(transform_points(polygon, matrix)) for polygon in one.ignore]
    kept = [transform_points(polygon, back) for polygon in regions if len(polygon) >= 3]
    return lines.with_vertices(transform_points(lines.vertices, back)), kept


def _clip_polygon(polygon: Float[np.ndarray, "v 2"]) -> Float[np.ndarray, "w 2"]:
    """Gives the part of a polygon with x >= 0; parts that fall apart stay joined along x = 0."""
    corners = []
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if a[0] >= 0:
            corners.append(a)
        if (a[0] >= 0) != (b[0] >= 0):
            corners.append(a + a[0] / (a[0] - b[0]) * (b - a))
    return np.array(corners).reshape(-1, 2)


def _concatenate(a: Polylines, b: Polylines) -> Polylines:
    return Polylines(
        np.concatenate([a.vertices, b.vertices]),
        np.concatenate([a.offsets, a.offsets[-1] + b.offsets[1:]]),
        np.concatenate([a.scores, b.scores]),
        np.concatenate([a.labels, b.labels]),
    )


__all__ = ["PLACES", "join_images"]
