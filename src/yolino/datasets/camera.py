"""Lines in space to lines in an image: poses, a pinhole camera, clipping. Lengths are in meters.

The camera's frame has x to the right, y down and z ahead. A pinhole maps straight lines to straight lines, so
that lines are cut exactly in space and then projected vertex by vertex.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from yolino.geometry import clip_polylines
from yolino.types import Polylines

# Closer vertices, in meters, are equal.
_EQUAL = 1e-9
# Shorter lines, in pixels, are points: they lie in the direction of sight.
_POINT = 1e-6


@dataclass(frozen=True, eq=False)
class Pose:
    """Where a frame lies in an outer one: `outer = rotation @ inner + translation`.

    Attributes:
        rotation: Rotation matrix.
        translation: Origin of the inner frame, in meters.
    """

    rotation: Float[np.ndarray, "3 3"]
    translation: Float[np.ndarray, " 3"]

    def __matmul__(self, inner: Pose) -> Pose:
        """Gives the pose of a frame that lies at `inner` in this frame."""
        return Pose(self.rotation @ inner.rotation, self.rotation @ inner.translation + self.translation)

    def to_inner(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Gives points of the outer frame in the inner one; equal points stay equal, to the last bit."""
        x, y, z = (points - self.translation).T
        # Written out: a matrix product may round the same point differently in different rows.
        return np.stack([x * a + y * b + z * c for a, b, c in self.rotation.T], axis=1)


def quaternion_to_matrix(w: float, x: float, y: float, z: float) -> Float[np.ndarray, "3 3"]:
    """Gives the rotation matrix of a quaternion of any length.

    Raises:
        ValueError: It is zero or not finite.
    """
    length = float(np.sqrt(w * w + x * x + y * y + z * z))
    if not 0 < length < np.inf:
        raise ValueError(f"The quaternion ({w}, {x}, {y}, {z}) is no rotation: it is zero or not finite.")
    w, x, y, z = w / length, x / length, y / length, z / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


@dataclass(frozen=True)
class Camera:
    """A pinhole camera without skew and distortion.

    Attributes:
        focal: Focal lengths in pixels, x and y.
        center: Principal point in pixels, `(x, y)`, where the center of the top-left pixel is (0.5, 0.5).
        size: `(height, width)` of the image in pixels.
    """

    focal: tuple[float, float]
    center: tuple[float, float]
    size: tuple[int, int]

    def project(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
        """Gives where points of the camera's frame are in the image, in pixels; they must be in front."""
        return np.asarray(points[:, :2] / points[:, 2:] * np.array(self.focal) + np.array(self.center))

    def project_lines(
        self,
        vertices: Float[np.ndarray, "v 3"],
        offsets: Int[np.ndarray, " n_plus_1"],
        *,
        near: float = 0.1,
        max_distance: float | None = None,
    ) -> Polylines:
        """Gives the visible parts of lines in the image; the label of each is the index of its line.

        A line that leaves the image and returns becomes several. Directions stay, and lines that share a
        vertex share it afterwards, where it is visible.

        Args:
            vertices: The vertices of all lines, in the camera's frame, one line after the other.
            offsets: Where each line begins in `vertices`, and the end of the last.
            near: Distance of the plane in front of the camera behind which nothing is seen.
            max_distance: Distance from the camera beyond which nothing is seen; None: without end.
        """
        owners = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
        # Of two equal vertices one is left out: a segment without length cannot be cut.
        long = (np.abs(vertices[1:] - vertices[:-1]) > _EQUAL).any(axis=1)
        linked = (owners[1:] == owners[:-1]) & long
        start, end, owner = vertices[:-1][linked], vertices[1:][linked], owners[:-1][linked]
        enter, leave = _in_front(start[:, 2], end[:, 2], near)
        if max_distance is not None:
            first, last = _in_ball(start, end - start, max_distance)
            enter, leave = np.maximum(enter, first), np.minimum(leave, last)
        seen = enter < leave
        if not seen.any():
            return Polylines.from_list([])
        start, end, enter, leave = start[seen], end[seen], enter[seen, None], leave[seen, None]
        delta = end - start
        pieces = np.stack(
            [
                self.project(np.where(enter > 0, start + enter * delta, start)),
                self.project(np.where(leave < 1, start + leave * delta, end)),
            ],
            axis=1,
        )
        whole = (leave[:-1, 0] >= 1) & (enter[1:, 0] <= 0)
        follows = np.append(False, np.diff(np.flatnonzero(seen)) == 1)
        follows[1:] &= whole & (owner[seen][1:] == owner[seen][:-1])
        lines = clip_polylines(_chain(pieces, follows, owner[seen]), self.size)
        return lines[lines.lengths > _POINT]


def _in_front(
    start: Float[np.ndarray, " n"], end: Float[np.ndarray, " n"], near: float
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Gives the share of each segment where it enters the space in front of a plane, and where it leaves it.

    Args:
        start: Depth of the start points.
        end: Depth of the end points.
        near: Depth of the plane.
    """
    first, last = start >= near, end >= near
    cut = (near - start) / np.where(first == last, 1.0, end - start)
    return np.where(first, 0.0, np.where(last, cut, np.inf)), np.where(
        last, 1.0, np.where(first, cut, -np.inf)
    )


def _in_ball(
    start: Float[np.ndarray, "n 3"], delta: Float[np.ndarray, "n 3"], radius: float
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Gives the share of each segment where it enters a ball around the origin, and where it leaves it."""
    squared = (delta**2).sum(axis=1)
    middle = -(start * delta).sum(axis=1) / squared
    rest = middle**2 - ((start**2).sum(axis=1) - radius**2) / squared
    half = np.sqrt(np.maximum(rest, 0.0))
    return np.where(rest > 0, middle - half, np.inf), np.where(rest > 0, middle + half, -np.inf)


def _chain(
    pieces: Float[np.ndarray, "m 2 2"], follows: Bool[np.ndarray, " m"], labels: Int[np.ndarray, " m"]
) -> Polylines:
    """Gives the polylines that pieces form of which some go on where the one before ends."""
    first = np.flatnonzero(~follows)
    lines = [
        np.concatenate([part[:1, 0], part[:, 1]]) for part in np.split(pieces, first[1:]) if len(part) > 0
    ]
    return Polylines.from_list(lines, labels=labels[first])


__all__ = ["Camera", "Pose", "quaternion_to_matrix"]
