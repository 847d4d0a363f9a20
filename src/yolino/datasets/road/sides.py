"""What stands along the road: barriers, rails, fences, walls and trees, as upright painted strips."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from yolino.datasets.road.drawing import Canvas, blend, fill, shade, stroke
from yolino.datasets.road.layout import Layout
from yolino.datasets.road.surface import Ground
from yolino.datasets.road.view import View
from yolino.datasets.texture import Reals, noise

Sprite = NDArray[np.uint8]
"""Red, green, blue (times alpha) and alpha."""

ROWS, LENGTH, COLUMNS = 96, 64.0, 1024
"""Rows of a strip's picture, meters of road after which it repeats, and its columns."""

KINDS = ("barrier", "rail", "fence", "wall", "bank", "hedge", "trees")


@lru_cache(maxsize=32)
def strip(kind: str, variant: int) -> Sprite:
    """Gives the fixed picture of a strip beside the road: one of `KINDS`, in one of several variants."""
    rng = np.random.default_rng([KINDS.index(kind), variant])
    y = 1 - (np.arange(ROWS)[:, None] + 0.5) / ROWS
    grain = cv2.resize(np.tile(noise(1.0)[:ROWS], (1, 2)), (COLUMNS, ROWS))
    build = _leaves if kind in ("bank", "hedge", "trees") else _metal if kind in ("rail", "fence") else _stone
    color, alpha = build(kind, y, grain, rng)
    sprite = np.concatenate([color * alpha[..., None], alpha[..., None] * 255], axis=2)
    picture: Sprite = np.clip(sprite, 0, 255).astype(np.uint8)
    picture.flags.writeable = False
    return picture


def _stone(kind: str, y: Reals, grain: Reals, rng: np.random.Generator) -> tuple[Reals, Reals]:
    """Gives a concrete barrier (foot, slope, top) or a wall of blocks."""
    gray = rng.uniform(35, 175)
    light = (
        1
        + rng.uniform(0.0, 0.3) * (y > 0.9)
        - rng.uniform(0.05, 0.4) * (y < rng.uniform(0.15, 0.4))
        + 0.1 * grain
    )
    every = int(rng.integers(48, 128))
    light[:, ::every] *= 0.6
    if kind == "wall":
        light[:: int(rng.integers(6, 14))] *= 0.85
    light *= 1 - 0.3 * np.clip(noise(1.4)[:1, :512].repeat(2, axis=1) * (1 - y), 0, 1)
    tint = gray * (1 + rng.normal(0, 0.04, 3))
    return light[..., None] * tint, np.ones_like(light)


def _metal(kind: str, y: Reals, grain: Reals, rng: np.random.Generator) -> tuple[Reals, Reals]:
    """Gives a W-beam on posts, or a fence of wires between posts."""
    gray = rng.uniform(70, 190)
    post = (np.arange(COLUMNS) % int(rng.integers(28, 44)) < 3)[None] * np.ones_like(y)
    if kind == "rail":
        beam = (y > 0.52).astype(np.float64)
        wave = 0.85 + 0.25 * np.cos((y - 0.52) / 0.48 * 4 * np.pi)
        light = np.where(beam > 0, wave, 0.45) + 0.05 * grain
        return light[..., None] * (gray * np.ones(3)), np.maximum(beam * np.ones_like(grain), post)
    light = 0.6 + 0.1 * grain
    return light[..., None] * (gray * np.ones(3)), np.maximum(post, rng.uniform(0.1, 0.35))


def _leaves(kind: str, y: Reals, grain: Reals, rng: np.random.Generator) -> tuple[Reals, Reals]:
    """Gives a ragged row of plants: the outline is a crowd of blobs, frayed by noise."""
    alpha = np.zeros((ROWS, COLUMNS), np.uint8)
    low = {"bank": 0.75, "hedge": 0.5, "trees": 0.12}[kind]
    cv2.rectangle(alpha, (0, int(ROWS * (1 - low))), (COLUMNS, ROWS), 255, -1)
    for _ in range({"bank": 40, "hedge": 90, "trees": 110}[kind]):
        x, tall = int(rng.integers(COLUMNS)), rng.uniform(low, 1) ** 1.3
        radius = int(rng.uniform(4, 16))
        middle, wide = int(ROWS * (1 - tall)) + radius, int(radius * rng.uniform(1.2, 3.0))
        for shift in (-COLUMNS, 0, COLUMNS):
            cv2.ellipse(alpha, (x + shift, middle), (wide, radius), 0, 0, 360, 255, -1)
        if kind == "trees":
            cv2.line(alpha, (x, middle), (x, ROWS), 255, 4)
    soft = cv2.GaussianBlur(alpha, (0, 0), 2.5).astype(np.float64) / 255
    fray = noise(0.7)[:ROWS].repeat(2, axis=1)
    alpha = np.clip((soft * (1 + 0.3 * fray) - 0.4) * 4, 0, 1)
    base = np.array(
        ((34, 44, 22), (52, 56, 30), (24, 30, 20), (110, 92, 58), (70, 76, 34))[rng.integers(5)], float
    )
    light = 0.75 + 0.35 * y + 0.25 * grain + 0.35 * noise(0.5)[200 : 200 + ROWS].repeat(2, axis=1)
    return np.clip(light, 0.15, 2)[..., None] * base, alpha


def paint_strip(
    canvas: Canvas, view: View, sprite: Sprite, *, x: float, tall: float, gain: float = 1.0, near: float = 2.0
) -> None:
    """Paints a strip along the road: upright, `x` meters right of the axis, `tall` meters high.

    Args:
        canvas: Changed in place.
        view: Camera and road.
        sprite: A picture of `strip`.
        x: Lateral position in meters.
        tall: Height in meters.
        gain: Factor of its brightness.
        near: Distance in meters at which it begins.
    """
    z = 1 / np.linspace(1 / near, 1 / view.farthest, 240)
    u = view.column(np.full_like(z, x), z)
    step = np.sign(u[1] - u[0])
    turn = np.flatnonzero(np.diff(u) * step <= 0)
    stop = int(turn[0]) + 1 if len(turn) else len(u)
    u, z = (u[:stop], z[:stop]) if step > 0 else (u[:stop][::-1], z[:stop][::-1])
    c0, c1 = (int(v) for v in np.clip((np.floor(u[0]), np.ceil(u[-1])), 0, canvas.shape[1]))
    if stop < 3 or c1 <= c0:
        return
    at = 1 / np.interp(np.arange(c0, c1) + 0.5, u, 1 / z)
    base, top = view.row(at), view.row(at, tall)
    r0, r1 = (int(v) for v in np.clip((np.floor(top.min()), np.ceil(base.max()) + 1), 0, canvas.shape[0]))
    if r1 <= r0:
        return
    rows = np.arange(r0, r1, dtype=np.float32)[:, None] + np.float32(0.5)
    mx = np.tile((at * (COLUMNS / LENGTH)).astype(np.float32), (r1 - r0, 1))
    depth = rows - top.astype(np.float32)
    high = (base - top).astype(np.float32)
    inside = cv2.min(depth, high - depth) * np.float32(255) + np.float32(127)
    weight = cv2.convertScaleAbs(np.maximum(inside, 0, out=inside))
    my = np.clip(depth * (ROWS / np.maximum(high, np.float32(1e-6))) - np.float32(0.5), 0, ROWS - 1)
    piece = cv2.remap(sprite, mx, my, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    piece = cv2.multiply(piece, cv2.merge([weight] * 4), scale=1 / 255)
    blend(canvas[r0:r1, c0:c1], piece[..., :3], piece[..., 3], gain)


HEIGHTS = {
    "barrier": (0.8, 1.2),
    "rail": (0.7, 0.85),
    "fence": (1.5, 2.5),
    "wall": (2.0, 5.0),
    "bank": (2.0, 9.0),
    "hedge": (1.0, 4.0),
    "trees": (5.0, 16.0),
}


def paint_sides(canvas: Canvas, view: View, layout: Layout, ground: Ground, rng: np.random.Generator) -> None:
    """Paints what runs along both sides of the road, the far things first."""
    gain = rng.uniform(0.45, 1.15)
    for side, edge in zip((-1, 1), layout.edges, strict=True):
        gap = sum(ground.median) if side < 0 and ground.median[1] > 0 else 0.0
        if rng.random() < 0.75:
            kind = str(rng.choice(["bank", "hedge", "trees", "trees"]))
            far = edge + side * (gap + rng.uniform(3, 14))
            _paint(canvas, view, kind, x=far, gain=gain, rng=rng)
        if rng.random() < 0.7:
            kind = str(
                rng.choice(["barrier", "rail", "wall", "fence", "hedge"], p=[0.45, 0.25, 0.1, 0.1, 0.1])
            )
            kind = "barrier" if side < 0 and kind == "wall" and gap > 0 else kind
            x = edge + side * rng.uniform(0.0, 2.5)
            if rng.random() < 0.4:
                _shadow(canvas, view, x, -side * rng.uniform(0.3, 1.5))
            _paint(canvas, view, kind, x=x, gain=gain * rng.uniform(0.8, 1.2), rng=rng)
        if rng.random() < 0.5:
            _poles(canvas, view, edge + side * rng.uniform(0.5, 6), side, rng)


def _paint(canvas: Canvas, view: View, kind: str, *, x: float, gain: float, rng: np.random.Generator) -> None:
    near = 2.0 if rng.random() < 0.8 else rng.uniform(10, 60)
    sprite, tall = strip(kind, int(rng.integers(4))), rng.uniform(*HEIGHTS[kind])
    paint_strip(canvas, view, sprite, x=x, tall=tall, gain=gain, near=near)


def _shadow(canvas: Canvas, view: View, x: float, width: float) -> None:
    """Darkens the foot of a wall: an edge that runs along the road."""
    z = 1 / np.linspace(1 / 1.5, 1 / view.farthest, 40)
    sides = [view.project(np.stack([np.full(40, at), np.zeros(40), z], axis=1)) for at in (x, x + width)]
    shade(canvas, np.concatenate([sides[0], sides[1][::-1]]), 0.5, blur=0.6)


def _poles(canvas: Canvas, view: View, x: float, side: int, rng: np.random.Generator) -> None:
    """Paints lamp posts, some with an arm over the road, or reflector posts."""
    lamp = rng.random() < 0.7
    tall, gray = (rng.uniform(8, 13), rng.uniform(30, 160)) if lamp else (1.1, rng.uniform(120, 220))
    arm = rng.uniform(1, 3) if lamp and rng.random() < 0.7 else 0.0
    for z in np.arange(rng.uniform(12, 70), min(view.farthest, 220), rng.uniform(35, 70))[::-1]:
        half = 0.1
        width = 2 * half * view.focal / z
        corners = np.array([(x, 0, z), (x, tall, z), (x - side * arm, tall + 0.4 * (arm > 0), z)])
        points = view.project(corners)
        if width > 1.5:
            post = np.array(
                [(x - half, 0, z), (x + half, 0, z), (x + half * 0.6, tall, z), (x - half * 0.6, tall, z)]
            )
            fill(canvas, view.project(post), (gray, gray, gray))
            stroke(canvas, points[1:], (gray, gray, gray), width * 0.6)
        else:
            stroke(canvas, points, (gray, gray, gray), 1)


__all__ = ["paint_sides", "paint_strip", "strip"]
