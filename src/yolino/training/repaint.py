"""Augmentation that gives lines of a photograph other markings: dashes, a continuous line, or Botts' dots.

The old marking goes as in `yolino.training.erase`, and new paint follows the label. Its pattern is right in
perspective: the width of the lane in pixels tells how far away a row is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

from yolino.datasets.road.layout import Pattern
from yolino.datasets.texture import noise
from yolino.training.bands import pixels_of
from yolino.training.stripes import Cover, cover, mix
from yolino.training.tracks import Road, Track, build_road, ground_beside, track_of
from yolino.types import Polylines

Image = UInt8[np.ndarray, "h w 3"]

_LANE = 3.7  # meters
_FOCAL = (0.75, 1.4)  # widths of the image
_BAND, _LEAST_BAND = 0.08, 2.5  # half the width that is cleared, in lanes and in pixels
_REACH = 1.25  # half widths: from 1 to here the new pixels fade into the old ones
_LEAST_BARE = 0.5  # of a line, for a new marking
_FAINT = 0.01  # less is not painted
_BRIGHTER = 18.0  # gray values: what is so much brighter than the ground is paint
_DARK_STAYS = 0.6  # probability that what is darker than the ground is left below the new paint
_MOVED, _MOTION = 0.4, 0.035  # probability that a line is moved, and how far usually, in lanes
_CONTRAST = 45.0  # gray values that good paint is at least brighter than the ground
_LEAST_HALF = 0.4  # pixels
_LEAST_LANE = 3.0  # pixels: farther away no marking is seen
_LUMA = np.array([0.299, 0.587, 0.114], np.float32)


@dataclass(frozen=True)
class Marking:
    """A kind of marking that a line can get.

    Attributes:
        classes: Names that a dataset may have for it.
        inner: Share of it on lines between others.
        outer: Share of it on the leftmost and the rightmost line.
        color: Red, green and blue relative to white.
        width: Least and largest width in lanes.
    """

    classes: tuple[str, ...]
    inner: float
    outer: float
    color: tuple[float, float, float] = (1.0, 0.995, 0.97)
    width: tuple[float, float] = (0.026, 0.046)


MARKINGS: dict[str, Marking] = {
    "dashes": Marking(("dashed",), 0.8, 0.4),
    "white": Marking(("continuous white", "continuous"), 0.08, 0.35),
    "yellow": Marking(("continuous yellow", "continuous"), 0.02, 0.2, color=(0.98, 0.72, 0.24)),
    "dots": Marking(("Botts' dots",), 0.1, 0.05, width=(0.026, 0.036)),
}
"""What is painted: dashes where lanes may be changed, continuous lines rather at the sides."""

DASHES = ((12.19, 3.05), (14.63, 3.66), (9.0, 3.0), (18.0, 6.0), (6.0, 3.0))
"""Period and length of painted dashes in meters, in the order of how usual they are taken to be."""


class _Look(NamedTuple):
    """What the new markings of an image have in common.

    Attributes:
        dashes: Where along the road dashes lie, in meters.
        focal: Focal length in pixels.
        light: Gray value of white paint on the usual ground of the image.
        opacity: How much of the ground paint hides.
        wear: How patchy it is, from 0 to 1.
    """

    dashes: Pattern
    focal: float
    light: float
    opacity: float
    wear: float


class _Stroke(NamedTuple):
    """What is particular to one line, and what it has in common with the others."""

    pattern: Pattern
    look: _Look


def repaint_lines(
    image: Image,
    polylines: Polylines,
    rng: np.random.Generator,
    *,
    share: float | int,
    classes: Sequence[str] = (),
    corners: Float[np.ndarray, "k 2"] | None = None,
) -> tuple[Image, Polylines]:
    """Gives image and labels after some lines got a new marking.

    Some of these lines are also moved a little to a side, label and paint alike, so that not every seam or
    joint keeps its distance. What covers a line (a car) keeps its pixels. Labels follow the paint where
    `classes` have a name for it: then only what has a name is painted. A line stays as it is where most of it
    is covered, or where no two lines tell how wide a lane is.

    Args:
        image: The image; it is not changed.
        polylines: Lines that run up the image, in pixels of `image`.
        rng: Source of randomness.
        share: Probability that a line gets a new marking.
        classes: Names of the classes that the labels stand for.
        corners: The convex polygon of the image that holds a picture, if not all of it does.
    """
    chosen = np.flatnonzero(rng.random(len(polylines)) < share)
    if len(chosen) == 0 or len(polylines) < 2:
        return image, polylines
    road = build_road(polylines, (image.shape[0], image.shape[1]), corners)
    ground = ground_beside(image, road)
    look = _sample_look(image.shape[1], rng)
    result = image
    vertices, labels = polylines.vertices.copy(), polylines.labels.copy()
    for line in chosen.tolist():
        track = track_of(road, ground, line, half=_BAND, least=_LEAST_BAND)
        if track is None or track.bare.mean() < _LEAST_BARE:
            continue
        result = image.copy() if result is image else result
        name, label = _choose_marking(_is_outer(road, line), classes, rng)
        motion = rng.normal(0, _MOTION) if rng.random() < _MOVED else 0.0
        own = slice(polylines.offsets[line], polylines.offsets[line + 1])
        vertices[own, 0] += motion * road.lane(line, vertices[own, 1])
        labels[line] = labels[line] if label is None else label
        _clear(result, track, rng)
        center = track.band.center + motion * track.lane
        moved = track._replace(band=track.band._replace(center=center))
        _paint(result, moved, MARKINGS[name], _Stroke(_pattern(name, look, rng), look), rng)
    return result, Polylines(vertices, polylines.offsets, polylines.scores, labels, polylines.probabilities)


def _sample_look(width: int, rng: np.random.Generator) -> _Look:
    period, length = DASHES[int(rng.choice(len(DASHES), p=[0.45, 0.2, 0.15, 0.1, 0.1]))]
    scale = rng.uniform(0.9, 1.1)
    dashes = Pattern(period * scale, ((0.0, length * scale),), rng.uniform(0, period * scale))
    worn = rng.random() < 0.35
    opacity, wear = (
        (rng.uniform(0.35, 0.8), rng.uniform(0.2, 0.8))
        if worn
        else (rng.uniform(0.85, 1), rng.uniform(0, 0.25))
    )
    return _Look(dashes, width * rng.uniform(*_FOCAL), rng.uniform(185, 255), opacity, wear)


def _is_outer(road: Road, line: int) -> bool:
    """Tells whether a line has no other on one of its sides."""
    ahead = road.columns - road.columns[line]
    sides = [float(np.mean(row[~np.isnan(row)])) for row in ahead if not np.isnan(row).all()]
    return not (min(sides) < 0 < max(sides))


def _choose_marking(outer: bool, classes: Sequence[str], rng: np.random.Generator) -> tuple[str, int | None]:
    """Gives a kind of marking and its label; none where the classes are about something else."""
    named = {
        kind: next((list(classes).index(name) for name in marking.classes if name in classes), None)
        for kind, marking in MARKINGS.items()
    }
    allowed = [kind for kind, label in named.items() if label is not None] or list(MARKINGS)
    weights = np.array([MARKINGS[kind].outer if outer else MARKINGS[kind].inner for kind in allowed])
    kind = allowed[int(rng.choice(len(allowed), p=weights / weights.sum()))]
    return kind, named[kind]


def _clear(image: Image, track: Track, rng: np.random.Generator) -> None:
    """Removes the marking in a band, sometimes without the seam below it, in place.

    The pixels are those at both edges of the band, faded into one another, with the grain of the ground.
    """
    band, bare = track.band, track.bare
    pixels = pixels_of(band, _REACH)
    edges = np.stack([_edge(image, track, side) for side in (-1.0, 1.0)])
    at = np.clip(0.5 + 0.5 * pixels.at, 0, 1).astype(np.float32)
    share = bare[pixels.owners] * np.clip((_REACH - np.abs(pixels.at)) / (_REACH - 1), 0, 1)
    if rng.random() < _DARK_STAYS:
        gray = edges @ _LUMA
        expected = gray[0, pixels.owners] * (1 - at) + gray[1, pixels.owners] * at
        share *= np.clip((image[pixels.rows, pixels.columns] @ _LUMA - expected - 4) / 12, 0, 1)
    changed = share > _FAINT
    owners, rows, columns, at = (v[changed] for v in (pixels.owners, pixels.rows, pixels.columns, at))
    new = edges[0, owners] * (1 - at[:, None]) + edges[1, owners] * at[:, None]
    inwards = np.where(band.center < (band.first + band.stop) / 2, 1, -1)
    step = (2 * np.rint(band.half).astype(np.int64) + rng.integers(4)) * inwards
    beside = (columns + step[owners]).clip(0, image.shape[1] - 4)
    grain = image[rows, beside].astype(np.float32) - image[rows, beside + 3]
    # The difference of two pixels of the ground has sqrt(2) times its deviation.
    new += 0.7 * grain.clip(-20, 20)
    mix(image, Cover(owners, rows, columns, at, share[changed]), new)


def _edge(image: Image, track: Track, side: float) -> Float32[np.ndarray, "r 3"]:
    """Gives the color beside a band, smooth along it; where paint or no picture is, that of the ground."""
    band, color = track.band, track.color
    columns = np.floor(band.center[:, None] + side * band.half[:, None] * np.array([1.3, 1.5])).astype(
        np.int64
    )
    outside = (columns < band.first[:, None]) | (columns >= band.stop[:, None])
    values = image[band.rows[:, None], columns.clip(0, image.shape[1] - 1)].astype(np.float32)
    bright = (values - color[:, None]) @ _LUMA > _BRIGHTER
    values = np.where((outside | bright)[..., None], color[:, None], values)
    return np.asarray(cv2.blur((values[:, 0] + values[:, 1]) / 2, (1, 7), borderType=cv2.BORDER_REPLICATE))


def _paint(image: Image, track: Track, marking: Marking, stroke: _Stroke, rng: np.random.Generator) -> None:
    """Paints a marking along a cleared line, in place."""
    band, lane, look = track.band, track.lane, stroke.look
    seen = (lane > _LEAST_LANE) & (track.bare > 0)
    if not seen.any():
        return
    # Distances in meters of the upper and the lower edges of the rows.
    far, near = (look.focal * _LANE / np.maximum(lane + side * track.growth / 2, 1.0) for side in (-1, 1))
    pattern = stroke.pattern
    strength = (pattern.painted(far) - pattern.painted(near)) / np.maximum(far - near, 1e-9)
    half = np.maximum(rng.uniform(*marking.width) * lane / 2, _LEAST_HALF)
    stripe = cover(band._replace(half=half), strength * track.bare * seen)
    gray = track.color @ _LUMA
    usual = float(np.median(gray[seen]))
    paint = max(look.light, min(usual + _CONTRAST, 255.0)) * np.array(marking.color, np.float32)
    # In a shadow the paint gets darker with the ground.
    light = np.clip(gray / max(usual, 1.0), 0.2, 1.15)[stripe.owners, None] * paint
    grain = image[stripe.rows, stripe.columns] - track.color[stripe.owners]
    meters = _LANE / np.maximum(lane, 1.0)[stripe.owners]
    left = _left_by_wear(look.wear, stripe.across * meters, far[stripe.owners], rng)
    mix(image, stripe._replace(share=stripe.share * look.opacity * left), light + 0.4 * grain)


def _pattern(name: str, look: _Look, rng: np.random.Generator) -> Pattern:
    """Gives where along the road a marking is painted: dashes of an image often begin at the same place."""
    if name == "dashes":
        phase = look.dashes.phase if rng.random() < 0.6 else rng.uniform(0, look.dashes.period)
        return replace(look.dashes, phase=phase)
    if name == "dots":
        count, apart = int(rng.integers(1, 6)), rng.uniform(0.8, 1.3)
        pieces = tuple((i * apart, i * apart + 0.15) for i in range(count))
        return Pattern(float(rng.choice([7.3, 12.2, 14.6])), pieces, rng.uniform(0, 14))
    return Pattern()


def _left_by_wear(
    wear: float, x: Float[np.ndarray, " p"], z: Float[np.ndarray, " p"], rng: np.random.Generator
) -> Float[np.ndarray, " p"]:
    """Gives the share of the paint left at `x` meters from its middle, `z` meters ahead: worn in patches."""
    shift = int(rng.integers(512))
    rows, columns = (z * 13).astype(np.int64) % 512, (x * 40 + shift).astype(np.int64) % 512
    patches = noise(1.2)[rows, columns]
    stretches = noise(1.6)[(z * 4).astype(np.int64) % 512, shift]
    return np.asarray(np.clip(1.3 - wear * (1 + 0.5 * patches + 0.5 * stretches), 0, 1))


__all__ = ["DASHES", "MARKINGS", "Marking", "repaint_lines"]
