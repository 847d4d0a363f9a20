"""Augmentation that changes the ground beside lines: where another surface begins, no line need be."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from yolino.training.bands import Band
from yolino.training.tracks import Track, chosen_tracks
from yolino.types import Polylines

Image = UInt8[np.ndarray, "h w 3"]

OFFSETS = (0.03, 0.6)
"""How far beside its line a surface begins, in lanes: from the edge of the paint to mid lane."""

WIDTHS = (0.4, 4.0)
"""How wide it is, in lanes: a strip along the road, or all that is beside it."""

_DRIFT = 0.08  # of a lane, from the near to the far end: usual deviation
_LIGHT = (0.5, 1.6)  # darkest and lightest, times the light of the old ground
_LEAST_CHANGE = 0.08  # of its logarithm
_TINT = 0.03  # usual deviation of a color from gray, relative
# Gray values from the ground's up to which a pixel is ground, and from which it is paint or a car.
_ALIKE = (45.0, 80.0)
_LEAST_BARE = 0.3  # of the rows, to know the ground


def add_surfaces(
    image: Image,
    polylines: Polylines,
    rng: np.random.Generator,
    *,
    share: float | int,
    corners: Float[np.ndarray, "k 2"] | None = None,
) -> Image:
    """Gives the image with darker or lighter ground beside some lines, as where asphalt meets concrete.

    The new surface runs along its line, begins at `OFFSETS` to one side of it and is `WIDTHS` wide; both its
    edges look like lines and are none. What differs clearly from the ground in color stays: most paint, most
    cars. The image comes back as it is where nothing is drawn, or where no two lines tell how wide a lane is.

    Args:
        image: The image; it is not changed.
        polylines: Lines that run up the image, in pixels of `image`.
        rng: Source of randomness.
        share: Probability that a line gets another surface beside it.
        corners: The convex polygon of the image that holds a picture, if not all of it does.
    """
    # Also where a line itself has left the image.
    least = float(image.shape[1])
    tracks = chosen_tracks(image, polylines, rng, share=share, corners=corners, least=least)
    tracks = [track for track in tracks if track.bare.mean() >= _LEAST_BARE]
    result = image.copy() if tracks else image
    for track in tracks:
        _add_surface(result, track, rng)
    return result


def _add_surface(image: Image, track: Track, rng: np.random.Generator) -> None:
    """Changes the ground on one side of a line, in place."""
    band, lane = track.band, track.lane
    side = -1.0 if rng.random() < 0.5 else 1.0
    near, far = OFFSETS
    # The depth of a place on the ground is the reciprocal of the lane's width there.
    depth = max(lane.max(), 1.0) / np.maximum(lane, 1.0)
    away = np.log(depth) / np.log(max(depth.max(), 2.0))
    # More of them close to the line, where their edge is mistaken for it.
    first = np.clip(near + (far - near) * rng.random() ** 1.5 + rng.normal(0, _DRIFT) * away, near, far)
    width = np.exp(rng.uniform(*np.log(WIDTHS)))
    edges = band.center + side * np.stack([first, first + width]) * lane
    change = rng.uniform(*np.log(_LIGHT))
    change = np.copysign(max(abs(change), _LEAST_CHANGE), change)
    color = np.exp(change) * (1 + rng.normal(0, _TINT, 3))
    # Whole rectangles: the surface may be half of the image, and lists of its pixels are slow.
    low, high = edges.min(axis=0), edges.max(axis=0)
    left = int(np.clip(low.min() - 1, 0, image.shape[1]))
    right = int(np.clip(high.max() + 2, left, image.shape[1]))
    old = image[band.rows, left:right]
    if old.size == 0:
        return
    share = _covered(np.arange(left, right), band, low, high) * _ground_share(old, _known_ground(track))
    table = np.rint(np.arange(256)[:, None] * color).clip(0, 255).astype(np.uint8)[None]
    change_of = cv2.subtract(cv2.LUT(old, table), old, dtype=cv2.CV_32F)
    image[band.rows, left:right] = np.rint(old + share[..., None] * change_of).clip(0, 255).astype(np.uint8)


def _covered(
    columns: Int[np.ndarray, " w"], band: Band, low: Float[np.ndarray, " r"], high: Float[np.ndarray, " r"]
) -> Float32[np.ndarray, "r w"]:
    """Gives the share of each pixel that lies between two edges, averaged over their slant within a row."""
    x, share = (columns + 0.5).astype(np.float32), np.float32(-1)
    for edge, inwards in ((low, 1), (high, -1)):
        steepness = (inwards / np.maximum(1.0, np.abs(np.gradient(edge)))).astype(np.float32)
        share = share + np.clip((x - edge[:, None].astype(np.float32)) * steepness[:, None] + 0.5, 0, 1)
    inside = (columns >= band.first[:, None]) & (columns < band.stop[:, None])
    return np.asarray(np.maximum(share, 0) * inside)


def _ground_share(
    old: UInt8[np.ndarray, "r w 3"], ground: Float32[np.ndarray, "r 3"]
) -> Float32[np.ndarray, "r w"]:
    """Gives 1 for pixels of the color that the ground has in their row, 0 for paint, cars or grass."""
    usual = np.repeat(np.rint(ground).astype(np.uint8)[:, None], old.shape[1], axis=1)
    red, green, blue = cv2.split(cv2.absdiff(old, usual))
    low, high = _ALIKE
    table = np.clip((high - np.arange(256)) / (high - low), 0, 1).astype(np.float32)
    return np.asarray(table[cv2.max(cv2.max(red, green), blue)])


def _known_ground(track: Track) -> Float32[np.ndarray, "r 3"]:
    """Gives the color of the ground in each row; where it is covered, that of the rows above and below."""
    rows = np.arange(len(track.bare))
    known = track.bare > _LEAST_BARE
    colors = [np.interp(rows, rows[known], channel[known]) for channel in track.color.T]
    return np.stack(colors, axis=1).astype(np.float32)


__all__ = ["OFFSETS", "WIDTHS", "add_surfaces"]
