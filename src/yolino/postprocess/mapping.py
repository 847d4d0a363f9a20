"""Results in another frame along the axes, compiled: the last step of an image.

Like `thresholding`, the first one, it runs when the processor's caches are cold.
"""

from __future__ import annotations

from typing import no_type_check

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from yolino.compiled import compiled
from yolino.geometry import transform_points
from yolino.postprocess.inputs import plain
from yolino.types import Polylines, Segments


def map_segments(segments: Segments, matrix: Float[np.ndarray, "3 3"]) -> Segments:
    """Gives the segments in the frame that the homography `matrix` maps to."""
    points = _map_points(segments.endpoints, matrix)
    return Segments.trusted(points, segments.scores, segments.labels, segments.probabilities)


def map_polylines(lines: Polylines, matrix: Float[np.ndarray, "3 3"]) -> Polylines:
    """Gives the polylines in the frame that the homography `matrix` maps to."""
    points = _map_points(lines.vertices, matrix)
    return Polylines.trusted(points, lines.offsets, lines.scores, lines.labels, lines.probabilities)


def _map_points(points: NDArray[np.float64], matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Gives what `transform_points` gives, sooner where the matrix only scales and moves."""
    (a, b, x), (c, d, y), (e, f, w) = matrix.tolist()
    if b or c or e or f:
        return transform_points(points, matrix)
    moved: NDArray[np.float64] = _scale_and_move(plain(points).reshape(-1, 2), a / w, x / w, d / w, y / w)
    return moved.reshape(points.shape)


@compiled
@no_type_check
def _scale_and_move(points, a, x, d, y):
    """Gives the points times (a, d), plus (x, y)."""
    moved = np.empty_like(points)
    for i in range(len(points)):
        moved[i, 0], moved[i, 1] = points[i, 0] * a + x, points[i, 1] * d + y
    return moved


__all__ = ["map_polylines", "map_segments"]
