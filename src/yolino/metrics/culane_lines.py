"""Lanes as the pixels that the official CULane tool paints: a spline through the vertices, drawn 30 px wide.

A set of pixels is the sorted array of its flat indices, `row * width + column`. The coordinates here are
OpenCV's: whole numbers are the centers of the pixels, half a pixel off the house's.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from yolino.geometry import cumulative_length

SAMPLES = 50  # points for each pair of vertices
_SAME = 1e-6  # pixels: vertices that are closer are one, or the spline divides by zero
_CAP = 3  # pixels by which rounding may widen a stroke beyond half its width


def spline_points(vertices: Float[np.ndarray, "v 2"]) -> Float[np.ndarray, "s 2"]:
    """Gives the points that the official tool joins by straight lines: 50 per pair of vertices, and the end.

    The curve is the natural cubic spline of x and y over the length of the chords. The tool keeps points in
    single precision, so vertices and points are rounded to it here. Its spline is not defined where a vertex
    repeats the one before; that vertex is left out. One or two vertices stay as they are.

    Args:
        vertices: Vertices of one lane.
    """
    from scipy.interpolate import CubicSpline  # takes a third of a second, which others need not wait

    points = vertices.astype(np.float32).astype(np.float64)
    steps = np.diff(cumulative_length(points))
    if len(points) > 2:
        points = points[np.append(True, steps > _SAME)]
    if len(points) < 3:
        return points
    at = cumulative_length(points)
    between = at[:-1, None] + np.diff(at)[:, None] * (np.arange(SAMPLES) / SAMPLES)
    curve = CubicSpline(at, points, bc_type="natural")(np.append(between, at[-1]))
    return np.asarray(curve.astype(np.float32).astype(np.float64))


def drawn_pixels(
    vertices: Float[np.ndarray, "v 2"], size: tuple[int, int], width: int
) -> Int[np.ndarray, " k"]:
    """Gives the pixels of the image that a lane covers; none if it has less than two vertices.

    They are OpenCV's `line` from point to point, coordinates rounded to whole pixels (halves to even). It
    paints an even width one pixel wider, an odd one above 1 two pixels.

    Args:
        vertices: Vertices of one lane; they may lie outside the image.
        size: `(height, width)` of the image.
        width: Width of the stroke in pixels.
    """
    if len(vertices) < 2:
        return np.zeros(0, np.int64)
    points = np.rint(spline_points(vertices)).astype(np.int32)
    moves = np.append(True, (points[1:] != points[:-1]).any(axis=1))
    points = points[moves]
    # Only the frame around the stroke is drawn on. Where it ends inside the image nothing is cut off, so the
    # pixels are those of the whole image.
    reach = width // 2 + _CAP
    left, top = np.maximum(points.min(axis=0) - reach, 0).tolist()
    right, bottom = np.minimum(points.max(axis=0) + reach + 1, (size[1], size[0])).tolist()
    if left >= right or top >= bottom:
        return np.zeros(0, np.int64)
    frame = np.zeros((bottom - top, right - left), np.uint8)
    points = points - np.array([left, top], np.int32)
    cv2.polylines(frame, [points if len(points) > 1 else points.repeat(2, axis=0)], False, 1, width)
    rows, cols = np.divmod(np.flatnonzero(frame.view(np.bool_)), right - left)
    return np.asarray((rows + top) * size[1] + cols + left)


def pixels_inside(
    polygons: Sequence[Float[np.ndarray, "_ 2"]], size: tuple[int, int]
) -> Bool[np.ndarray, " k"]:
    """Tells of each pixel of the image whether its center is inside a polygon (even-odd rule).

    Args:
        polygons: Corners of each polygon.
        size: `(height, width)` of the image.
    """
    inside = np.zeros(size, np.bool_)
    for polygon in polygons:
        inside |= _fill(polygon, size)
    return inside.ravel()


def _fill(polygon: Float[np.ndarray, "c 2"], size: tuple[int, int]) -> Bool[np.ndarray, "h w"]:
    """A pixel is inside if the ray from it to the right crosses the edges an odd number of times."""
    height, width = size
    crossings = np.zeros((height, width + 1), np.int64)
    rows = np.arange(height)
    for (ax, ay), (bx, by) in zip(np.roll(polygon, 1, axis=0), polygon, strict=True):
        crossed = np.flatnonzero((ay > rows) != (by > rows))
        if len(crossed):
            x = ax + (crossed - ay) / (by - ay) * (bx - ax)
            # The edge is crossed by the rays of all pixels left of x.
            crossings[crossed, np.clip(np.ceil(x), 0, width).astype(np.int64)] += 1
    right_of = crossings[:, :0:-1].cumsum(axis=1)[:, ::-1]
    return np.asarray(right_of % 2 == 1)


__all__ = ["SAMPLES", "drawn_pixels", "pixels_inside", "spline_points"]
