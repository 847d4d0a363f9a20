"""Pure functions of points `(x, y)`: matrices, resampling, clipping, distances. No files, no drawing."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from yolino.types import Polylines

# Pairs of point and segment that are looked at at once: small enough to stay in the processor's cache.
_PAIRS = 1 << 15
# Shorter runs along an axis are none: division by them would overflow.
_LEVEL = 1e-290


def transform_points(
    points: Float[np.ndarray, "*shape 2"], matrix: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "*shape 2"]:
    """Gives `points` in the frame that the homography `matrix` maps to (column vectors: `p' ~ M p`)."""
    if not (matrix[0, 1] or matrix[1, 0] or matrix[2, 0] or matrix[2, 1]):  # scaled and moved, the usual case
        return np.asarray(points * (matrix[[0, 1], [0, 1]] / matrix[2, 2]) + matrix[:2, 2] / matrix[2, 2])
    xy = points @ matrix[:2, :2].T + matrix[:2, 2]
    w = points @ matrix[2, :2] + matrix[2, 2]
    return np.asarray(xy / w[..., None])


def cumulative_length(vertices: Float[np.ndarray, "v 2"]) -> Float[np.ndarray, " v"]:
    """Gives the arc length from the first vertex to each vertex, in the unit of the vertices."""
    delta = np.diff(vertices, axis=0)
    lengths = np.zeros(len(vertices))
    np.cumsum(np.hypot(delta[:, 0], delta[:, 1]), out=lengths[1:])
    return lengths


def resample(vertices: Float[np.ndarray, "v 2"], spacing: float) -> Float[np.ndarray, "s 2"]:
    """Gives points at most `spacing` apart along the polyline, evenly, both ends included.

    Args:
        vertices: Vertices of one polyline; one vertex, or a polyline without length, gives its place once.
        spacing: Largest arc length between neighbours, in the unit of the vertices.

    Raises:
        ValueError: There is no vertex, or `spacing` is not positive.
    """
    if len(vertices) == 0:
        raise ValueError("a polyline without vertices cannot be resampled: give at least one vertex.")
    if not spacing > 0:
        raise ValueError(f"spacing must be positive, got {spacing}.")
    t = cumulative_length(vertices)
    if t[-1] == 0:
        return vertices[:1].copy()
    count = max(int(np.ceil(t[-1] / spacing - 1e-9)), 1) + 1
    at = np.linspace(0.0, t[-1], count)
    return np.stack([np.interp(at, t, vertices[:, 0]), np.interp(at, t, vertices[:, 1])], axis=1)


def clip_segments(
    endpoints: Float[np.ndarray, "n 2 2"], size: tuple[int, int]
) -> tuple[Float[np.ndarray, "m 2 2"], Int[np.ndarray, " m"]]:
    """Gives the parts of the segments inside `[0, width] x [0, height]`, exactly cut at its border.

    Segments that lie outside or touch the border in one point only are dropped; order and direction stay. A
    segment without length stays where it lies inside.

    Args:
        endpoints: Start and end points.
        size: `(height, width)` of the image, in the unit of the points.

    Returns:
        The parts, and the index of the segment that each part was cut from.
    """
    limit = np.array([size[1], size[0]], np.float64)
    if not ((endpoints < 0) | (endpoints > limit)).any():
        return endpoints, np.arange(len(endpoints))
    start, delta = endpoints[:, 0], endpoints[:, 1] - endpoints[:, 0]
    level = np.abs(delta) < _LEVEL
    step = np.where(level, 1.0, delta)
    low, high = -start / step, (limit - start) / step
    inside = (start >= 0) & (start <= limit)
    enter = np.where(level, np.where(inside, -np.inf, np.inf), np.minimum(low, high))
    leave = np.where(level, np.inf, np.maximum(low, high))
    # Both axes by name: reductions over an axis of two are slow.
    enter = np.maximum(np.maximum(enter[:, 0], enter[:, 1]), 0.0)
    leave = np.minimum(np.minimum(leave[:, 0], leave[:, 1]), 1.0)
    kept = np.flatnonzero(enter < leave)
    enter, leave = enter[kept, None], leave[kept, None]
    first = np.where(enter > 0, start[kept] + enter * delta[kept], endpoints[kept, 0])
    last = np.where(leave < 1, start[kept] + leave * delta[kept], endpoints[kept, 1])
    return np.clip(np.stack([first, last], axis=1), 0.0, limit), kept


def clip_polylines(polylines: Polylines, size: tuple[int, int]) -> Polylines:
    """Gives the parts of the polylines inside `[0, width] x [0, height]`, exactly cut at its border.

    A polyline that leaves and returns becomes several, all with its score, label and class probabilities.
    What has no length inside (single vertices, points that touch the border) is dropped.

    Args:
        polylines: Polylines in pixels.
        size: `(height, width)` of the image in pixels.
    """
    pieces, kept = clip_segments(polylines.endpoints, size)
    owners = polylines.owners[kept]
    long = (pieces[:, 0] != pieces[:, 1]).any(axis=1)
    pieces, owners = pieces[long], owners[long]
    if len(pieces) == 0:
        return polylines[:0]
    first = np.flatnonzero(np.append(True, ~follows(pieces, owners, 0.0)))
    sizes = np.diff(np.append(first, len(pieces))) + 1
    offsets = np.concatenate([[0], np.cumsum(sizes)])
    vertices = np.empty((offsets[-1], 2))
    vertices[offsets[:-1]] = pieces[first, 0]
    rest = np.ones(offsets[-1], np.bool_)
    rest[offsets[:-1]] = False
    vertices[rest] = pieces[:, 1]
    source = owners[first]
    shares = polylines.probabilities
    return Polylines(
        vertices,
        offsets,
        polylines.scores[source],
        polylines.labels[source],
        None if shares is None else shares[source],
    )


def follows(
    pieces: Float[np.ndarray, "n 2 2"], owners: Int[np.ndarray, " n"], tolerance: float
) -> Bool[np.ndarray, " n_minus_1"]:
    """Tells of each piece but the first whether it starts where its forerunner, of the same owner, ends."""
    near = np.abs(pieces[1:, 0] - pieces[:-1, 1]) <= tolerance
    return np.asarray((owners[1:] == owners[:-1]) & near[:, 0] & near[:, 1])


def sample_segments(
    endpoints: Float[np.ndarray, "n 2 2"], spacing: float
) -> tuple[Float[np.ndarray, "s 2"], Float[np.ndarray, " s"]]:
    """Gives points in the middle of stretches of at most `spacing` of each segment: for sums along lines.

    Args:
        endpoints: Start and end points.
        spacing: Largest length of a stretch, in the unit of the points.

    Returns:
        The points, segment by segment from start to end, and the length of the stretch that each stands for.
    """
    delta = endpoints[:, 1] - endpoints[:, 0]
    lengths = np.hypot(delta[:, 0], delta[:, 1])
    counts = np.maximum(np.ceil(lengths / spacing - 1e-9), 1).astype(np.int64)
    source = np.repeat(np.arange(len(endpoints)), counts)
    within = np.arange(len(source)) - np.repeat(np.cumsum(counts) - counts, counts)
    at = (within + 0.5) / counts[source]
    return endpoints[source, 0] + at[:, None] * delta[source], (lengths / counts)[source]


def distance_to_segments(
    points: Float[np.ndarray, "n 2"], endpoints: Float[np.ndarray, "m 2 2"]
) -> Float[np.ndarray, " n"]:
    """Gives the exact distance of each point to the nearest segment; infinite where there is none."""
    nearest = np.full(len(points), np.inf)
    if len(endpoints) == 0:
        return nearest
    start, delta = endpoints[:, 0], endpoints[:, 1] - endpoints[:, 0]
    squared = np.maximum((delta**2).sum(axis=1), np.finfo(np.float64).tiny)
    along, rows = delta / squared[:, None], max(_PAIRS // len(endpoints), 1)
    for i in range(0, len(points), rows):
        dx = points[i : i + rows, None, 0] - start[:, 0]
        dy = points[i : i + rows, None, 1] - start[:, 1]
        t = dx * along[:, 0] + dy * along[:, 1]
        np.minimum(np.maximum(t, 0.0, out=t), 1.0, out=t)
        dx -= t * delta[:, 0]
        dy -= t * delta[:, 1]
        nearest[i : i + rows] = (dx * dx + dy * dy).min(axis=1)
    return np.asarray(np.sqrt(nearest))


def fit_matrix(
    image_size: tuple[int, int], network_size: tuple[int, int], fit: str
) -> Float[np.ndarray, "3 3"]:
    """Gives the matrix from the image frame to the network frame.

    Args:
        image_size: `(height, width)` of the image.
        network_size: `(height, width)` of the network's input.
        fit: `"bottom"`: scaled to the network's width and aligned at the bottom edge, cropped or padded at
            the top (from 1280x720 to 320x640: the top 80 rows go, the rest is halved). `"letterbox"`: scaled
            to lie inside, centered, padded on both sides. `"stretch"`: both axes scaled on their own.
            `"window"`: not scaled, centered: the image is a window of a larger one.

    Raises:
        ValueError: `fit` is none of these, or a size is not positive.
    """
    (h, w), (rows, cols) = image_size, network_size
    if min(h, w, rows, cols) < 1:
        raise ValueError(
            f"Sizes must be positive (height, width), got image {image_size} and network {network_size}."
        )
    if fit == "stretch":
        return np.diag([cols / w, rows / h, 1.0])
    scales = {"bottom": cols / w, "letterbox": min(cols / w, rows / h), "window": 1.0}
    if fit not in scales:
        raise ValueError(f"fit is {fit!r}, but must be 'bottom', 'letterbox', 'stretch' or 'window'.")
    scale = scales[fit]
    rest = np.array([cols - scale * w, rows - scale * h])
    shift = rest if fit == "bottom" else rest / 2
    return np.array([[scale, 0.0, shift[0]], [0.0, scale, shift[1]], [0.0, 0.0, 1.0]])
