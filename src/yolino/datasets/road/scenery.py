"""What stands behind and over the road: sky, hills, trees, bridges and signs."""

from __future__ import annotations

import cv2
import numpy as np

from yolino.datasets.road.drawing import Canvas, Color, Number, fill, shade, stroke
from yolino.datasets.road.layout import Layout
from yolino.datasets.road.sides import COLUMNS, strip
from yolino.datasets.road.view import View
from yolino.datasets.texture import crop, noise
from yolino.types import Floats


def paint_sky(canvas: Canvas, view: View, rng: np.random.Generator) -> None:
    """Paints a sky that brightens to the horizon, with or without clouds."""
    h, w = canvas.shape[:2]
    stop = int(np.clip(view.top + 2, 1, h))
    overcast = rng.random() < 0.2
    blue = np.array((0.62, 0.92, 1.25)) * rng.uniform(75, 135) + rng.uniform(0, 25)
    high = np.full(3, rng.uniform(130, 200)) if overcast else blue
    low = high * 0.6 + np.array((175, 185, 190)) * rng.uniform(0.25, 0.5)
    t = np.linspace(0, 1, stop)[:, None] ** rng.uniform(0.8, 2)
    column = np.clip(high * (1 - t) + low * t, 0, 255).astype(np.uint8)
    column = np.concatenate([column, np.broadcast_to(column[-1], (h - stop, 3))])
    cv2.resize(column[:, None], (w, h), dst=canvas, interpolation=cv2.INTER_NEAREST)
    if rng.random() < 0.5:
        _paint_clouds(canvas[:stop], rng)


def _paint_clouds(sky: Canvas, rng: np.random.Generator) -> None:
    row, left = (int(v) for v in rng.integers(0, 400, 2))
    part = noise(1.5)[row : row + 64, left : left + 96]
    cover = np.clip((part - rng.uniform(0, 1.3)) * 110, 0, 255 * rng.uniform(0.15, 0.8)).astype(np.uint8)
    cover = cv2.resize(cover, (sky.shape[1], sky.shape[0]), interpolation=cv2.INTER_LINEAR)
    veil = cv2.multiply(255 - sky, cv2.cvtColor(cover, cv2.COLOR_GRAY2RGB), scale=0.8 / 255)
    cv2.add(sky, veil, dst=sky)


def _ridge(rng: np.random.Generator, width: int, jag: float) -> Floats:
    """Gives a random skyline in [0, 1] for each column."""
    row, start = (int(v) for v in rng.integers(0, 512, 2))
    coarse = np.roll(noise(1.8)[row], start)[: int(rng.integers(100, 400))]
    line = np.interp(np.linspace(0, len(coarse) - 1, width), np.arange(len(coarse)), coarse)
    line = line + jag * crop(0.7, (1, width), rng)[0]
    return np.asarray((line - line.min()) / max(float(np.ptp(line)), 1e-6))


def paint_background(canvas: Canvas, view: View, rng: np.random.Generator) -> None:
    """Paints hills and rows of trees, the nearer the darker, in front of the sky."""
    h, w = canvas.shape[:2]
    ground = float(view.row(np.array([view.farthest]))[0])
    bottom = min(ground + 10 * view.scale, float(h))
    haze = canvas[int(np.clip(ground - 2, 0, h - 1)), w // 2].astype(np.float64)
    for _ in range(rng.poisson(1.0)):
        clear = rng.uniform(0.2, 1)
        base = np.array((1.0, rng.uniform(0.92, 1.08), rng.uniform(0.6, 0.9))) * rng.uniform(18, 65)
        rise = view.scale * rng.uniform(20, 130) * _ridge(rng, w, 0.03)
        _paint_hill(canvas, bottom - rise, bottom, base * clear + haze * 0.8 * (1 - clear), rng)
    for near in range(int(rng.integers(1, 4))):
        tall = view.scale * rng.uniform(12, 60) * (1 + near)
        _paint_trees(canvas, bottom, tall, rng.uniform(0.3, 1.1), rng)


def _paint_hill(canvas: Canvas, line: Floats, bottom: float, color: Floats, rng: np.random.Generator) -> None:
    h = canvas.shape[0]
    top, stop = int(np.clip(line.min(), 0, h)), int(np.clip(np.ceil(bottom), 0, h))
    if stop <= top:
        return
    rows = np.arange(top, stop)[:, None] + 0.5
    cover = np.clip(rows - line + 0.5, 0, 1).astype(np.float32)[..., None]
    size = (stop - top, canvas.shape[1])
    grain = crop(0.8, size, rng) * rng.uniform(0.06, 0.22) + np.maximum(
        crop(0.4, size, rng) - 2, 0
    ) * rng.uniform(0, 0.8)
    shaded = cv2.multiply(
        cv2.cvtColor(1 + grain.astype(np.float32), cv2.COLOR_GRAY2RGB), (*color.tolist(), 0.0)
    )
    part = canvas[top:stop]
    part[:] = np.clip(part * (1 - cover) + shaded * cover, 0, 255)


def _paint_trees(canvas: Canvas, bottom: float, tall: float, gain: float, rng: np.random.Generator) -> None:
    """Paints a row of trees across the picture, higher towards one or both sides."""
    w = canvas.shape[1]
    sprite = strip(str(rng.choice(["trees", "trees", "hedge"])), int(rng.integers(4)))
    x = np.arange(w)
    sides = np.abs(x / w - rng.uniform(0.3, 0.7)) * rng.uniform(0, 2.5)
    high = np.maximum(tall * (0.3 + sides), 1)
    top = int(np.clip(bottom - high.max(), 0, canvas.shape[0]))
    stop = int(np.clip(np.ceil(bottom), 0, canvas.shape[0]))
    if stop <= top:
        return
    rows = np.arange(top, stop)[:, None] + 0.5
    my = ((rows - (bottom - high)) / high * sprite.shape[0]).astype(np.float32)
    ratio = 1.6 * sprite.shape[0] / max(tall, 8) * rng.uniform(0.6, 1.3)
    mx = np.broadcast_to(((x * ratio + rng.uniform(0, COLUMNS)) % COLUMNS).astype(np.float32), my.shape)
    piece = cv2.remap(sprite, mx.copy(), my, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    target = canvas[top:stop]
    rest = cv2.multiply(target, cv2.cvtColor(255 - piece[..., 3], cv2.COLOR_GRAY2RGB), scale=1 / 255)
    target[:] = cv2.addWeighted(np.ascontiguousarray(piece[..., :3]), gain, rest, 1, 0)


def _board(view: View, x: tuple[Number, Number], y: tuple[Number, Number], z: Number) -> Floats:
    """Gives the image of an upright rectangle across the road."""
    return view.project(np.array([(x[0], y[0], z), (x[1], y[0], z), (x[1], y[1], z), (x[0], y[1], z)]))


def paint_bridge(canvas: Canvas, view: View, layout: Layout, rng: np.random.Generator) -> None:
    """Paints a bridge over the road: its dark underside, its face, piers, banks and the shadow below."""
    z = rng.uniform(12, 150) if rng.random() < 0.8 else rng.uniform(3, 12)
    depth, low = rng.uniform(8, 30), rng.uniform(4.9, 6.5)
    high, gray = low + rng.uniform(1.2, 2.4), rng.uniform(25, 110)
    left, right = layout.edges
    near = max(z + rng.uniform(-6, 6), 2.0)
    floor = np.array([(-90, 0, near), (90, 0, near), (90, 0, near + depth), (-90, 0, near + depth)])
    shade(canvas, view.project(floor), rng.uniform(0.12, 0.5), blur=0.8 * max(1.0, view.scale * 2))
    for side, x in ((-1, left - 1.5), (1, right + 1.5)):
        if rng.random() < 0.6:
            bank = np.array(
                [(x, 0, z), (x + side * 60, 0, z), (x + side * 60, low + 3, z), (x + side * 8, low, z)]
            )
            fill(canvas, view.project(bank), tuple(np.array((40, 46, 24)) * rng.uniform(0.4, 1.3)))
        piers = [z, z + depth / 2] if rng.random() < 0.6 else []
        for at in piers[::-1]:
            fill(
                canvas, _board(view, (x - 0.7, x + 0.7), (0, low), at), (gray * 0.9, gray * 0.9, gray * 0.85)
            )
            fill(canvas, _board(view, (x + 0.1, x + 0.7), (0, low), at), (gray * 0.5, gray * 0.5, gray * 0.5))
    under = np.array([(-120, low, z), (120, low, z), (120, low, z + depth), (-120, low, z + depth)])
    dark = gray * rng.uniform(0.15, 0.45)
    fill(canvas, view.project(under), (dark, dark, dark))
    fill(canvas, _board(view, (-120, 120), (low, high), z), (gray, gray, gray * 0.95))
    fill(canvas, _board(view, (-120, 120), (low, low + 0.3), z), (gray * 0.6, gray * 0.6, gray * 0.6))
    if rng.random() < 0.6:
        rail = view.project(np.array([(-120, high + 0.9, z), (120, high + 0.9, z)]))
        stroke(canvas, rail, (gray * 0.8, gray * 0.8, gray * 0.8), 0.12 * view.focal / z)


def paint_signs(canvas: Canvas, view: View, layout: Layout, rng: np.random.Generator) -> None:
    """Paints a gantry with sign boards over the road, or boards at its side."""
    left, right = layout.edges
    if rng.random() < 0.25:
        z, low = rng.uniform(30, 180), rng.uniform(5.2, 6.5)
        gray = rng.uniform(30, 150)
        for y in (low + 0.6, low + 2.0):
            fill(canvas, _board(view, (left - 2, right + 2), (y, y + 0.25), z), (gray, gray, gray))
        for x in (left - 2, right + 2):
            fill(canvas, _board(view, (x - 0.2, x + 0.2), (0, low + 2.4), z), (gray, gray, gray))
        for x in rng.uniform(left, right, rng.integers(0, 4)):
            _sign(canvas, view, (x, low, z), rng.uniform(1.5, 3.2), rng)
    for _ in range(rng.poisson(0.6)):
        side = rng.choice([-1, 1])
        x = (right if side > 0 else left) + side * rng.uniform(1, 6)
        _sign(canvas, view, (x, rng.uniform(1.5, 3.5), rng.uniform(15, 120)), rng.uniform(0.3, 1.8), rng)


def _sign(
    canvas: Canvas, view: View, at: tuple[Number, Number, Number], half: float, rng: np.random.Generator
) -> None:
    """Paints a board with a bright border and lines of something like text."""
    x, y, z = at
    colors: tuple[Color, ...] = (
        (10, 58, 44),
        (10, 58, 44),
        (12, 40, 90),
        (170, 120, 30),
        (190, 190, 188),
        (40, 40, 42),
    )
    color = np.array(colors[rng.integers(len(colors))]) * rng.uniform(0.5, 1.3)
    tall = half * rng.uniform(0.7, 1.5)
    if y < 4:
        fill(canvas, _board(view, (x - 0.06, x + 0.06), (0, y), z), (70, 70, 70))
    fill(
        canvas, _board(view, (x - half, x + half), (y, y + tall), z), tuple(np.clip(color * 1.6 + 40, 0, 230))
    )
    fill(
        canvas,
        _board(view, (x - half * 0.95, x + half * 0.95), (y + 0.05 * tall, y + 0.95 * tall), z),
        tuple(color),
    )
    for line in (0.25, 0.6):
        wide = half * rng.uniform(0.3, 0.8)
        text = _board(view, (x - wide, x + wide), (y + line * tall, y + (line + 0.14) * tall), z)
        fill(canvas, text, tuple(np.clip(color + 110, 0, 235)))


__all__ = ["paint_background", "paint_bridge", "paint_signs", "paint_sky"]
