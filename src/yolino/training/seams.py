"""Augmentation that paints beside lines what is mistaken for them: seams, tar, tire marks, scratches."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, UInt8

from yolino.training.stripes import Cover, cover, mix
from yolino.training.tracks import Track, chosen_tracks
from yolino.types import Polylines

Image = UInt8[np.ndarray, "h w 3"]

OFFSETS = (0.025, 0.3)
"""How far a seam runs beside its line, in lanes: from the edge of the paint to near the wheels."""

_DRIFT = 0.1  # of a lane, from the near to the far end: usual deviation
_LEAST_HALF = 0.35  # pixels
_BRIGHT = (14.0, 34.0)  # gray values above the ground from which, and from which fully, a pixel is paint


_GRAY = np.full(3, 1 / 3, np.float32)


class Look(NamedTuple):
    """A kind of seam: ranges that its properties are drawn from.

    Attributes:
        chance: Share of the seams.
        width: Its width in lanes.
        depth: How much of the light it takes; negative gives light.
        sway: Usual sideways motion, in lanes.
        softness: How much of its width fades.
        broken: Probability that it has gaps.
    """

    chance: float
    width: tuple[float, float]
    depth: tuple[float, float]
    sway: float
    softness: float
    broken: float


LOOKS: dict[str, Look] = {
    "joint": Look(0.5, (0.004, 0.014), (0.3, 0.8), 0.002, 0.0, 0.3),
    "tar": Look(0.25, (0.008, 0.024), (0.3, 0.7), 0.012, 0.2, 0.6),
    "tire": Look(0.15, (0.04, 0.08), (0.1, 0.35), 0.004, 0.9, 0.5),
    "scratch": Look(0.1, (0.006, 0.02), (-0.2, -0.08), 0.003, 0.3, 0.5),
}
"""Joints of the concrete, tar that fills cracks, marks of tires, and what is left of older markings."""


def add_seams(
    image: Image,
    polylines: Polylines,
    rng: np.random.Generator,
    *,
    share: float | int,
    corners: Float[np.ndarray, "k 2"] | None = None,
) -> Image:
    """Gives the image with a seam painted beside some of its lines.

    A seam runs along its line at `OFFSETS` to one side, drifts and sways a little, gets as thin with the
    distance as the lane does, and lies below bright paint and below what covers the ground (cars). The image
    comes back as it is where no seam is drawn, or where no two lines tell how wide a lane is.

    Args:
        image: The image; it is not changed.
        polylines: Lines that run up the image, in pixels of `image`.
        rng: Source of randomness.
        share: Probability that a line gets a seam.
        corners: The convex polygon of the image that holds a picture, if not all of it does.
    """
    tracks = chosen_tracks(image, polylines, rng, share=share, corners=corners)
    result = image.copy() if tracks else image
    for track in tracks:
        _add_seam(result, track, rng)
    return result


def _add_seam(image: Image, track: Track, rng: np.random.Generator) -> None:
    """Paints one seam beside a line, in place."""
    band, lane = track.band, track.lane
    names = list(LOOKS)
    look = LOOKS[names[int(rng.choice(len(names), p=[LOOKS[name].chance for name in names]))]]
    # The depth of a place on the ground is the reciprocal of the lane's width there.
    depth = max(lane.max(), 1.0) / np.maximum(lane, 1.0)
    course = _course(depth, look, rng)
    half = np.maximum(rng.uniform(*look.width) * lane / 2, _LEAST_HALF)
    strength = track.bare * _presence(depth, look, rng)
    stripe = cover(band._replace(center=band.center + course * lane, half=half), strength, look.softness)
    light = 1.0 - rng.uniform(*look.depth)
    old = image[stripe.rows, stripe.columns].astype(np.float32)
    mix(image, _below_paint(stripe, old, track.color), old * np.float32(light))


def _course(depth: Float[np.ndarray, " r"], look: Look, rng: np.random.Generator) -> Float[np.ndarray, " r"]:
    """Gives how far right of its line a seam runs, in lanes, for depths from 1 on."""
    side = -1.0 if rng.random() < 0.5 else 1.0
    away = np.log(depth) / np.log(max(depth.max(), 2.0))  # as a driver sees it: half of the picture is near
    drift, sway = rng.normal(0, _DRIFT), abs(rng.normal(0, look.sway))
    waves = np.sin(rng.uniform(1.5, 4.0) * depth + rng.uniform(0, 6)) + 0.6 * np.sin(
        rng.uniform(5.0, 11.0) * depth + rng.uniform(0, 6)
    )
    near, far = OFFSETS
    # More of them close to the line, where they are mistaken for it.
    offset = np.clip(near + (far - near) * rng.random() ** 1.5 + drift * away, near, far)
    return np.asarray(side * offset + sway * waves)


def _presence(
    depth: Float[np.ndarray, " r"], look: Look, rng: np.random.Generator
) -> Float[np.ndarray, " r"]:
    """Gives where a seam is seen, from 0 to 1: in pieces, if it is broken, and never evenly."""
    uneven = 0.85 + 0.15 * np.sin(rng.uniform(2, 8) * depth + rng.uniform(0, 6))
    if rng.random() >= look.broken:
        return np.asarray(uneven)
    turns = rng.uniform(0.3, 2.0) * depth + rng.uniform(0, 1)
    kept = rng.uniform(0.4, 0.9)
    # The ends fade over a twentieth of the turn.
    edge = np.clip((kept / 2 - np.abs(turns % 1.0 - 0.5)) / 0.05 + 0.5, 0, 1)
    return np.asarray(uneven * edge)


def _below_paint(stripe: Cover, old: Float32[np.ndarray, "p 3"], ground: Float32[np.ndarray, "r 3"]) -> Cover:
    """Gives the stripe without the pixels that are brighter than the ground in their row."""
    above = old @ _GRAY - (ground @ _GRAY)[stripe.owners]
    low, high = _BRIGHT
    return stripe._replace(share=stripe.share * np.clip((high - above) / (high - low), 0, 1))


__all__ = ["LOOKS", "OFFSETS", "Look", "add_seams"]
