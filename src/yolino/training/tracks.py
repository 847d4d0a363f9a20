"""Lines that run up the image side by side: the width of a lane in each row, and the ground beside them."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from yolino.training.bands import LEAST_ROWS, MARGIN, Band, columns_of, continued, extent_of
from yolino.types import Polylines

_ALIKE = 0.25  # of the distance to the neighbour: rows that fit a straight road
_LEAST_GROWTH = 0.05  # pixels per row by which a lane gets wider towards the camera
_BESIDE = 0.25  # of a lane: where the ground beside a line is looked at
_SPOTS = np.array([[-0.6, -1.0, -1.4], [0.6, 1.0, 1.4]])  # of that distance; the second is the middle
_TOLERANCE = 0.35  # of the ground's gray value: what differs more is something else
_LEAST_TOLERANCE = 20.0  # gray values
_AROUND = 9  # rows over which the color of the ground is averaged


class Road(NamedTuple):
    """The lines of an image at the centers of its rows, and how wide a lane is there.

    Attributes:
        columns: The x of each line in pixels, NaN above and below it.
        centers: The same, continued straight down to the lower edge of the image.
        growth: By how many pixels the lane beside each line gets wider from row to row; NaN where unknown.
        offset: Its width in pixels at the upper edge of the image.
        extent: In each row the first column of the picture, and the one behind its last.
    """

    columns: Float[np.ndarray, "n h"]
    centers: Float[np.ndarray, "n h"]
    growth: Float[np.ndarray, " n"]
    offset: Float[np.ndarray, " n"]
    extent: Int[np.ndarray, "2 h"]

    def lane(self, line: int, y: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
        """Gives the width of the lane beside a line at height `y`, in pixels; 0 above the horizon."""
        return np.asarray(np.maximum(self.growth[line] * y + self.offset[line], 0.0))


class Ground(NamedTuple):
    """What lies on both sides of each line, in each row of the image.

    Attributes:
        color: The color of the ground, smooth along the line.
        bare: 1 where the ground is seen, 0 where something covers it (a car) or nothing is known.
    """

    color: Float32[np.ndarray, "n h 3"]
    bare: Float32[np.ndarray, "n h"]


class Track(NamedTuple):
    """One line where it is seen, with what surrounds it, row by row.

    Attributes:
        band: Rows and columns.
        lane: Width of the lane in pixels.
        growth: By how many pixels it gets wider from row to row.
        color: The color of the ground.
        bare: From 1, where the ground is seen, to 0.
    """

    band: Band
    lane: Float[np.ndarray, " r"]
    growth: float
    color: Float32[np.ndarray, "r 3"]
    bare: Float32[np.ndarray, " r"]


def build_road(
    polylines: Polylines, size: tuple[int, int], corners: Float[np.ndarray, "k 2"] | None = None
) -> Road:
    """Gives the lines of an image of `size` row by row.

    A lane gets wider linearly from the horizon down, so its width is a line fitted to the distances from each
    line to its nearest neighbour. Where they fit none, the others' median stands in.

    Args:
        polylines: Lines that run up the image, in pixels.
        size: `(height, width)`.
        corners: The convex polygon of the image that holds a picture, if not all of it does.
    """
    height, width = size
    if corners is None:
        corners = np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
    columns = np.full((len(polylines), height), np.nan)
    centers = columns.copy()
    for own, center, line in zip(columns, centers, polylines, strict=True):
        own[:] = columns_of(line, height)
        if np.count_nonzero(~np.isnan(own)) >= LEAST_ROWS:
            rows, x = continued(own)
            center[rows] = x
    fits = np.array([_lane_fit(columns, i) for i in range(len(columns))]).reshape(-1, 2)
    known = np.isfinite(fits[:, 0])
    if known.any():
        fits[~known] = np.median(fits[known], axis=0)
    return Road(columns, centers, fits[:, 0], fits[:, 1], extent_of(corners, height, width))


def _lane_fit(columns: Float[np.ndarray, "n h"], line: int) -> tuple[float, float]:
    """Gives growth and offset of the lane beside a line, NaN where its neighbours do not tell."""
    unknown = (np.nan, np.nan)
    distance = np.abs(columns - columns[line])
    distance[line] = np.nan
    gap = np.where(np.isnan(distance), np.inf, distance).min(axis=0)
    known = np.flatnonzero(np.isfinite(gap))
    if len(known) < LEAST_ROWS:
        return unknown
    for _ in range(2):
        growth, offset = _straight(known, gap[known])
        fitted = growth * (known + 0.5) + offset
        fits = np.abs(gap[known] - fitted) < _ALIKE * np.maximum(fitted, 4.0)
        if np.count_nonzero(fits) < max(LEAST_ROWS, 0.6 * len(known)):
            return unknown
        known = known[fits]
    return (growth, offset) if growth > _LEAST_GROWTH else unknown


def _straight(rows: Int[np.ndarray, " k"], values: Float[np.ndarray, " k"]) -> tuple[float, float]:
    """Gives slope and value at y = 0 of the line of least squares through the centers of rows."""
    y = rows + 0.5
    middle = y.mean()
    slope = float(((y - middle) @ values) / ((y - middle) @ (y - middle)))
    return slope, float(values.mean() - slope * middle)


def ground_beside(image: UInt8[np.ndarray, "h w 3"], road: Road) -> Ground:
    """Gives the ground on both sides of each line, about a quarter of a lane away.

    The ground has the color that this side of the line usually has, or that most places of the row have: a
    shadow falls on the whole road, a car stands on a part of it.

    Args:
        image: The image.
        road: Its lines.
    """
    count, height = road.centers.shape
    y = np.arange(height) + 0.5
    step = np.maximum(_BESIDE * (road.growth[:, None] * y + road.offset[:, None]), 4.0)
    # Lines, sides, places and rows.
    x = road.centers[:, None, None] + step[:, None, None] * _SPOTS[:, :, None]
    inside = ((x >= road.extent[0]) & (x < road.extent[1])).all(axis=2)
    columns = np.where(np.isnan(x), 0, x.clip(0, image.shape[1] - 1)).astype(np.int64)
    values = image[np.arange(height), columns].astype(np.float32)
    color = np.zeros((count, height, 3), np.float32)
    bare = np.zeros((count, height), np.float32)
    if not inside.any():
        return Ground(color, bare)
    middle = values[:, :, 1]
    usual = np.zeros((count, 2, 1, 3), np.float32)
    for line, side in np.argwhere(inside.any(axis=2)).tolist():
        usual[line, side] = np.median(middle[line, side, inside[line, side]], axis=0)
    filled = np.where(inside[..., None], middle, usual).reshape(-1, height, 3)
    row = np.median(filled[inside.any(axis=2).ravel()], axis=0)
    tolerance = np.maximum(_TOLERANCE * usual.mean(axis=-1), _LEAST_TOLERANCE)[:, :, None]
    near = np.minimum(_largest(np.abs(values - usual[:, :, None])), _largest(np.abs(values - row)))
    fits = (near < tolerance).all(axis=2) & inside
    # What is not seen covers nothing, so that a line begins where its label begins.
    bare = (fits == inside).all(axis=1).astype(np.float32)
    bare = cv2.erode(bare, np.ones((1, _AROUND), np.uint8), borderType=cv2.BORDER_REPLICATE)
    shown = (fits * bare[:, None])[..., None]
    total = _smooth((middle * shown).sum(axis=1))
    weight = _smooth(shown.sum(axis=1))
    seen = inside.any(axis=1) & (bare > 0)
    return Ground(total / np.maximum(weight, 1e-3), _smooth(bare[..., None])[..., 0] * seen)


def track_of(road: Road, ground: Ground, line: int, *, half: float = 0.0, least: float = 1.0) -> Track | None:
    """Gives a line where it is seen, or None if that is too short or nothing tells the width of its lane.

    Args:
        road: The lines.
        ground: What lies beside them.
        line: Which of them.
        half: Half the width of the band, as a share of the lane.
        least: Least half width in pixels.
    """
    rows = np.flatnonzero(~np.isnan(road.centers[line]))
    if not np.isfinite(road.growth[line]):
        return None
    lane = road.lane(line, rows + 0.5)
    width = np.maximum(half * lane, least)
    center, (first, stop) = road.centers[line, rows], road.extent[:, rows]
    near = (center > first - MARGIN - width) & (center < stop + MARGIN + width)
    if np.count_nonzero(near) < LEAST_ROWS:
        return None
    band = Band(rows, center, width, first, stop).where(near)
    color, bare = ground.color[line, band.rows], ground.bare[line, band.rows]
    return Track(band, lane[near], float(road.growth[line]), color, bare)


def chosen_tracks(
    image: UInt8[np.ndarray, "h w 3"],
    polylines: Polylines,
    rng: np.random.Generator,
    *,
    share: float | int,
    corners: Float[np.ndarray, "k 2"] | None = None,
    least: float = 1.0,
) -> list[Track]:
    """Gives the tracks of a random share of the lines; none where no two lines tell how wide a lane is.

    Args:
        image: The image.
        polylines: Lines that run up the image, in its pixels.
        rng: Source of randomness, which draws one number for each line.
        share: Probability that a line is chosen.
        corners: The convex polygon of the image that holds a picture, if not all of it does.
        least: Least half width of their bands in pixels.
    """
    chosen = np.flatnonzero(rng.random(len(polylines)) < share)
    if len(chosen) == 0 or len(polylines) < 2:
        return []
    road = build_road(polylines, (image.shape[0], image.shape[1]), corners)
    ground = ground_beside(image, road)
    found = (track_of(road, ground, line, least=least) for line in chosen.tolist())
    return [track for track in found if track is not None]


def _largest(values: Float32[np.ndarray, "*shape 3"]) -> Float32[np.ndarray, "*shape"]:
    """Gives the maximum of three channels; a reduction over so short an axis is slow."""
    return np.asarray(np.maximum(np.maximum(values[..., 0], values[..., 1]), values[..., 2]))


def _smooth(values: Float[np.ndarray, "n h c"]) -> Float[np.ndarray, "n h c"]:
    """Gives averages over neighboring rows."""
    flat = np.ascontiguousarray(values.transpose(0, 2, 1)).reshape(-1, values.shape[1])
    smooth = cv2.blur(flat, (_AROUND, 1), borderType=cv2.BORDER_REPLICATE)
    smooth = np.asarray(smooth).reshape(len(values), values.shape[2], -1)
    return smooth.transpose(0, 2, 1)


__all__ = ["Ground", "Road", "Track", "build_road", "chosen_tracks", "ground_beside", "track_of"]
