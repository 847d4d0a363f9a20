"""The ground: pavement of lanes and shoulders, land beside them, slabs, oil, patches and grain."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from yolino.datasets.road.drawing import Canvas, Color
from yolino.datasets.road.layout import Layout, Pattern
from yolino.datasets.road.view import View
from yolino.datasets.texture import Reals, noise, sample
from yolino.types import Floats

REACH = 48.0
STEP = 0.025
LEVELS = 7
PLAN = 0.1
"""Meters per column of a plan: a map of gains across the road, with one row per image row."""

FINE = 60.0
"""Distance in meters up to which fine grain is seen."""

LANDS = ((128, 112, 84), (92, 98, 58), (52, 60, 36), (150, 140, 118), (100, 92, 80), (165, 140, 90))
Gains = NDArray[np.float32]


@dataclass(frozen=True)
class Ground:
    """What a scene's ground is made of.

    Attributes:
        pavement: Color of the lanes, RGB.
        shoulder: Color of the paved shoulders.
        land: Color of what lies beyond.
        concrete: Whether the lanes are slabs of concrete (or asphalt).
        roughness: Strength of the grain, 1 is usual.
        median: Distance in meters to an opposite roadway at the left, and its width; zero width is none.
    """

    pavement: Color
    shoulder: Color
    land: Color
    concrete: bool
    roughness: float
    median: tuple[float, float]


def sample_ground(rng: np.random.Generator) -> Ground:
    """Gives random materials: concrete or asphalt, shoulders of the same or another, dry or green land."""
    concrete = bool(rng.random() < 0.65)
    gray = rng.normal(138, 18) if concrete else rng.normal(95, 20)
    gray = float(np.clip(gray, 58, 185))
    warm = rng.normal(1, 3)
    pavement = (gray + warm, gray + rng.normal(0, 1.5), gray - warm)
    dark = rng.uniform(0.45, 0.85) if rng.random() < 0.6 else rng.uniform(0.85, 1.1)
    land = np.array(LANDS[rng.integers(len(LANDS))]) * rng.uniform(0.4, 1.05)
    median = (rng.uniform(0.5, 14), rng.uniform(7, 15)) if rng.random() < 0.55 else (0.0, 0.0)
    red, green, blue = (c * dark for c in pavement)
    return Ground(pavement, (red, green, blue), tuple(land), concrete, rng.uniform(0.5, 1.7), median)


def paint_ground(
    canvas: Canvas, view: View, layout: Layout, ground: Ground, rng: np.random.Generator
) -> None:
    """Paints land and pavement, without markings, into all rows that show the ground.

    Colors and blotches are computed for every second pixel of a large picture, fine grain for all.
    """
    first, edges = view.ground_rows
    h, w = len(edges) - 1, canvas.shape[1]
    if h < 1:
        return
    step = 2 if view.scale > 0.75 else 1
    if step == 2:
        edges = np.append(edges, edges[-1:])[: 2 * ((h + 1) // 2) + 1]
    x, z = _positions(view, edges[::step], np.arange(step / 2, w + step - 1, step))
    base = _base(view, layout, ground, x=x, edges=edges[::step], rng=rng)
    if step == 2:
        base = cv2.resize(base, None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR)[:h, :w]
        x, z = _positions(view, edges[: h + 1], np.arange(0.5, w))
    target = canvas[first:]
    near = int(np.searchsorted(-z[:, 0], -FINE))
    target[:near] = cv2.convertScaleAbs(base[:near]) if near else 0
    if near < h:
        grain = _fine_grain(view, layout, ground.roughness, x=x[near:], z=z[near:], rng=rng)
        cv2.multiply(base[near:], cv2.cvtColor(grain, cv2.COLOR_GRAY2RGB), dst=target[near:], dtype=cv2.CV_8U)


def _positions(view: View, edges: Floats, columns: Floats) -> tuple[Gains, Floats]:
    """Gives the lateral position `(h, w)` of pixels and the distance `(h, 1)` of their rows, in meters."""
    z = ((edges[1:] + edges[:-1]) / 2)[:, None]
    x = (columns - view.vanishing[0]) * (z / view.focal) - view.center(z)
    return x.astype(np.float32), z


def _base(
    view: View, layout: Layout, ground: Ground, *, x: Gains, edges: Floats, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Gives the color of the ground without its fine grain."""
    z = ((edges[1:] + edges[:-1]) / 2)[:, None]
    level = np.log2(np.maximum(z / view.focal / STEP, 1)).clip(0, LEVELS - 1)
    strip = _mipmap(_profile(rng, layout, ground))
    levels = np.tile(level.astype(np.float32), (1, x.shape[1]))
    replicate = cv2.BORDER_REPLICATE
    color = cv2.remap(strip, (x + REACH) / STEP - 0.5, levels, cv2.INTER_LINEAR, borderMode=replicate)
    rows = np.tile(np.arange(len(z), dtype=np.float32)[:, None], (1, x.shape[1]))
    plan = _plan(rng, layout, ground, edges)
    gain = cv2.remap(plan, (x + REACH) / PLAN - 0.5, rows, cv2.INTER_LINEAR, borderMode=replicate)
    gain *= _blotches(view, ground.roughness, x=x, z=z, rng=rng)
    return np.asarray(cv2.multiply(color, cv2.cvtColor(gain, cv2.COLOR_GRAY2RGB)), dtype=np.float32)


def _profile(rng: np.random.Generator, layout: Layout, ground: Ground) -> NDArray[np.float32]:
    """Gives the color across the road, one entry per `STEP` meters from `-REACH` to `REACH`."""
    x = np.arange(-REACH, REACH, STEP, dtype=np.float32)
    color = np.empty((len(x), 3), np.float32)
    color[:] = ground.land
    left, right = layout.edges
    lands = np.interp(x, np.arange(-REACH, REACH + 2, 2.0), rng.normal(1, 0.12, int(REACH) + 1))
    color *= lands[:, None].astype(np.float32)
    gap, width = ground.median
    if width > 0:
        color[(x > left - gap - width) & (x < left - gap)] = np.array(ground.pavement) * rng.uniform(0.8, 1.1)
    color[(x > left) & (x < right)] = ground.shoulder
    offsets = np.array([b.offset for b in layout.boundaries]) + rng.uniform(-0.3, 0.3, len(layout.boundaries))
    offsets[[0, -1]] += (-rng.uniform(0.0, 0.4), rng.uniform(0.0, 0.4))
    odd = int(rng.integers(-6, len(offsets)))
    for i, (a, b) in enumerate(pairwise(offsets)):
        tone = rng.normal(1, 0.03) * (rng.uniform(0.65, 1.15) if i == odd else 1.0)
        color[(x > a) & (x < b)] = np.array(ground.pavement) * tone
    waves = np.interp(x, np.arange(-REACH, REACH + 0.5, 0.4), rng.normal(1, 0.015, int(REACH * 5) + 2))
    return np.asarray(color * waves[:, None], dtype=np.float32)


def _mipmap(profile: NDArray[np.float32]) -> NDArray[np.float32]:
    """Gives the profile blurred over 1, 2, 4 ... entries, one level per row."""
    return np.stack([cv2.blur(profile[None], (2**level, 1))[0] for level in range(LEVELS)])


def _columns(a: float, b: float) -> slice:
    """Gives the plan's columns between `a` and `b` meters."""
    low, high = np.clip(np.round((np.array([a, b]) + REACH) / PLAN), 0, 2 * REACH / PLAN).astype(int)
    return slice(int(low), int(high))


def _plan(rng: np.random.Generator, layout: Layout, ground: Ground, edges: Floats) -> Gains:
    """Gives the gain of slabs, joints, oil, patches and rumble strips."""
    plan = np.ones((len(edges) - 1, round(2 * REACH / PLAN)), np.float32)
    z = (edges[1:] + edges[:-1]) / 2
    joint = _joint(rng) if ground.concrete and rng.random() < 0.85 else None
    depth, contrast = rng.uniform(0.05, 0.7), rng.uniform(0, 0.06)
    oil = rng.uniform(0.0, 0.35) if rng.random() < 0.75 else 0.0
    offsets = [b.offset for b in layout.boundaries]
    for a, b in pairwise(offsets):
        lane = _columns(a, b)
        if joint is not None:
            _slabs(plan[:, lane], edges, joint, (depth, contrast), rng)
        x = (np.arange(lane.start, lane.stop) + 0.5) * PLAN - REACH - (a + b) / 2
        plan[:, lane] *= _wear(x, z, oil * rng.uniform(0.3, 1.3), rng)
    for _ in range(rng.poisson(0.8)):
        _patch(plan, layout, z, rng)
    if rng.random() < 0.12:
        start = rng.uniform(10, 90)
        plan[z > start, _columns(*layout.edges)] *= rng.uniform(0.5, 1.3)
    _rumble(plan, layout, edges, rng)
    return plan


def _joint(rng: np.random.Generator) -> Pattern:
    """Gives where the joints across a slab lane lie."""
    period, width = rng.uniform(3.4, 6), rng.uniform(0.01, 0.04)
    second = period * rng.uniform(0.8, 1.2)
    return Pattern(2 * period, ((0.0, width), (second, second + width)), rng.uniform(0, period))


def _slabs(
    plan: Gains, edges: Floats, joint: Pattern, strength: tuple[float, float], rng: np.random.Generator
) -> None:
    """Darkens the joints of a lane and gives each slab a tone of its own."""
    depth, contrast = strength
    shift = rng.uniform(0, 3) if rng.random() < 0.3 else 0.0
    share = joint.share(edges + shift)
    tones = rng.normal(0, contrast, 256)
    slab = ((edges[1:] + shift) / (joint.period / 2)).astype(np.int64) % 256
    tone = tones[slab] * np.minimum(1, joint.period / 2 / np.maximum(edges[:-1] - edges[1:], 1e-9))
    plan *= ((1 - depth * share) * (1 + tone))[:, None].astype(np.float32)


def _wear(x: Reals, z: Reals, oil: float, rng: np.random.Generator) -> Gains:
    """Gives the gain of a lane: oil in its middle, unevenly along the road, and two wheel paths."""
    along = np.interp(z, np.linspace(0, 150, 40), rng.normal(1, 0.3, 40))
    width, blur = rng.uniform(0.3, 0.75), rng.uniform(0.05, 0.2)
    stain = np.exp(-((np.abs(x + rng.normal(0, 0.15)) / width) ** (2 + 2 * blur)))
    wheels = sum(np.exp(-(((x - side) / 0.3) ** 2)) for side in (-0.85, 0.85))
    gain = 1 - oil * np.clip(along, 0.1, 2)[:, None] * stain + rng.normal(0, 0.05) * wheels
    return np.asarray(np.clip(gain, 0.3, 1.5), dtype=np.float32)


def _patch(plan: Gains, layout: Layout, z: Reals, rng: np.random.Generator) -> None:
    """Puts new pavement on a stretch of one lane."""
    lane = int(rng.integers(len(layout.boundaries) - 1))
    a, b = layout.boundaries[lane].offset, layout.boundaries[lane + 1].offset
    if rng.random() < 0.3:
        a, b = sorted(rng.uniform(a, b, 2))
    start = rng.uniform(2, 60)
    rows = (z > start) & (z < start + rng.uniform(1.5, 25))
    plan[rows, _columns(a, b)] *= rng.uniform(0.7, 1.35)


def _rumble(plan: Gains, layout: Layout, edges: Floats, rng: np.random.Generator) -> None:
    """Cuts grooves into the shoulder, beside the outermost boundaries."""
    for side in (0, 1):
        if rng.random() > 0.25 or layout.shoulders[side] < 1.2:
            continue
        sign = (-1, 1)[side]
        x = layout.boundaries[-side].offset + sign * rng.uniform(0.25, 0.6)
        groove = Pattern(0.32, ((0.0, 0.17),))
        share = groove.share(edges)
        plan[:, _columns(*sorted((x, x + sign * 0.4)))] *= (1 - rng.uniform(0.2, 0.6) * share)[
            :, None
        ].astype(np.float32)


@lru_cache(maxsize=1)
def _specks() -> Gains:
    """Gives a tile of fine grain with dark specks: the look of worn concrete."""
    tile = 0.8 * noise(0.3) + 0.3 * noise(0.9) - 1.6 * np.maximum(noise(0.8) - 1.8, 0)
    return np.asarray(cv2.GaussianBlur(tile, (0, 0), 0.6), dtype=np.float32)


def _blotches(view: View, roughness: float, *, x: Gains, z: Reals, rng: np.random.Generator) -> Gains:
    """Gives the gain of soft streaks along the road."""
    h, w = x.shape
    shift = rng.uniform(0, 512, 2)
    coarse = sample(noise(1.1), x[::2, ::2] * np.float32(11) + np.float32(shift[0]), z[::2] * 0.7 + shift[1])
    coarse = 1 + coarse * (0.028 * roughness * rng.uniform(0.6, 1.4) * _fade(view, z[::2], 11.0))
    return np.asarray(cv2.resize(coarse.astype(np.float32), (w, h), interpolation=cv2.INTER_LINEAR))


def _fine_grain(
    view: View, layout: Layout, roughness: float, *, x: Gains, z: Reals, rng: np.random.Generator
) -> Gains:
    """Gives the gain of fine grain, stronger beside the pavement, which averages out with the distance."""
    left, right = layout.edges
    shift = rng.uniform(0, 512, 2)
    fine = sample(_specks(), x * np.float32(110) + np.float32(shift[0]), z * 42 + shift[1])
    fine *= (0.075 * roughness * rng.uniform(0.6, 1.4) * _fade(view, z, 75.0)).astype(np.float32)
    land = (x < left) | (x > right)
    fine[land] *= 2.5
    fine += 1
    return np.asarray(np.maximum(fine, np.float32(0.15), out=fine))


def _fade(view: View, z: Reals, across: float) -> Reals:
    """Gives how much of a grain of `across` entries per meter is left in a pixel at distance `z`."""
    return np.asarray(np.minimum(1, view.focal / (z * across)) ** 0.6)


__all__ = ["Ground", "paint_ground", "sample_ground"]
