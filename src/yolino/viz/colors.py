"""Which color says what: identity and class, direction, score; all stand out from the dark outline."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

Color = tuple[int, int, int]
Colors = UInt8[np.ndarray, "n 3"]

# Seven hues that color-blind people tell apart (after Okabe and Ito, brightened for dark outlines).
PALETTE: tuple[Color, ...] = (
    (86, 180, 233),
    (230, 110, 30),
    (0, 190, 140),
    (240, 228, 66),
    (230, 130, 190),
    (255, 176, 20),
    (60, 110, 255),
)
# The paper's colors of true positives, false positives and false negatives (its figure of the metric).
HIT: Color = (0, 200, 120)
FALSE_ALARM: Color = (70, 130, 255)
MISS: Color = (240, 60, 50)
OUTLINE: Color = (16, 16, 16)

# No line has a lower relative luminance (WCAG 2): its contrast to the outline is 4.2 or more, so that on any
# background one of the two has a contrast of 2.
DARKEST = 0.18
COLORS = 256  # that are not repeated
_CHROMA = 25.0  # in CIELAB; less looks gray, like the blend of a line and its outline
_HUES = 1440
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def palette(indices: Int[np.ndarray, " n"]) -> UInt8[np.ndarray, "n 3"]:
    """Gives a color per index, the same one every time: 256 different ones, and then again.

    The first seven are `PALETTE`, each further one is as far as can be from all before it (CIELAB): any two
    of the first 64 are at least 20 apart.
    """
    colors = _extended_palette()
    return np.asarray(colors[indices % len(colors)])


def direction_colors(delta: Float[np.ndarray, "n 2"], *, directed: bool = True) -> UInt8[np.ndarray, "n 3"]:
    """Gives the direction of each vector as a hue: right red, down yellow-green, left cyan, up violet.

    Args:
        delta: Vectors in pixels, y down.
        directed: False gives opposite directions the same hue.
    """
    turn = np.arctan2(delta[:, 1], delta[:, 0]) / (2 * np.pi) * (1 if directed else 2)
    return np.asarray(_hues()[np.rint(turn * _HUES).astype(np.int64) % _HUES])


def score_colors(scores: Float[np.ndarray, " n"]) -> UInt8[np.ndarray, "n 3"]:
    """Gives scores 0..1 as colors from violet over green to yellow (viridis without its darkest part)."""
    steps = (255 * np.clip(scores, 0, 1)).round().astype(np.int64)
    return np.asarray(_score_ramp()[steps])


def item_colors(
    color_by: str, labels: Int[np.ndarray, " n"], scores: Float[np.ndarray, " n"]
) -> UInt8[np.ndarray, "n 3"]:
    """Gives a color per item by its place in the list ("identity"), its "label" or its "score".

    Raises:
        ValueError: If `color_by` is none of these (nor "direction", which has no color per item).
    """
    if color_by == "identity":
        return palette(np.arange(len(labels)))
    if color_by == "label":
        return palette(labels)
    if color_by == "score":
        return score_colors(scores)
    raise ValueError(f"color_by is {color_by!r}, but must be 'identity', 'label', 'direction' or 'score'.")


def luminance(colors: UInt8[np.ndarray, "*shape 3"]) -> Float[np.ndarray, "*shape"]:
    """Gives the relative luminance of RGB colors, 0 (black) to 1 (white), as WCAG 2 defines it."""
    shares = np.arange(256) / 255
    linear = np.where(shares <= 0.03928, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)
    return np.asarray(linear[colors] @ _LUMINANCE)


def lab(colors: UInt8[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Gives RGB colors in CIELAB, where distances are about those that people see."""
    shares = (colors[None] / 255).astype(np.float32)
    return np.asarray(cv2.cvtColor(shares, cv2.COLOR_RGB2LAB)[0], np.float64)


@cache
def _extended_palette() -> UInt8[np.ndarray, "n 3"]:
    """Gives the palette, and colors of a lattice, each the farthest from all before it."""
    levels = np.linspace(0, 255, 16).round().astype(np.uint8)
    lattice = np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), axis=-1).reshape(-1, 3)
    places = lab(lattice)
    fit = (luminance(lattice) >= DARKEST) & (np.hypot(places[:, 1], places[:, 2]) >= _CHROMA)
    lattice, places = lattice[fit], places[fit]
    chosen = [np.array(color, np.uint8) for color in PALETTE]
    distances = np.linalg.norm(places[:, None] - lab(np.stack(chosen)), axis=2).min(axis=1)
    while len(chosen) < COLORS:
        farthest = int(distances.argmax())
        chosen.append(lattice[farthest])
        distances = np.minimum(distances, np.linalg.norm(places - places[farthest], axis=1))
    return np.stack(chosen)


@cache
def _hues() -> UInt8[np.ndarray, "n 3"]:
    turn = np.arange(_HUES)[:, None] / _HUES
    ramp = (np.array([5.0, 3.0, 1.0]) + turn * 6) % 6
    level = 1 - 0.85 * np.clip(np.minimum(ramp, 4 - ramp), 0, 1)
    return _lighten(255 * level)


@cache
def _score_ramp() -> UInt8[np.ndarray, "n 3"]:
    steps = (64 + 191 * np.linspace(0, 1, 256)).round().astype(np.uint8)
    return _lighten(cv2.applyColorMap(steps[:, None], cv2.COLORMAP_VIRIDIS)[:, 0, ::-1].astype(np.float64))


def _lighten(colors: Float[np.ndarray, "n 3"]) -> UInt8[np.ndarray, "n 3"]:
    """Gives colors mixed with as much white as they need not to be too dark; the hue stays."""
    shares = np.linspace(0, 1, 256)[:, None, None]
    mixed = np.rint(colors + shares * (255 - colors)).astype(np.uint8)
    least = (luminance(mixed) >= DARKEST).argmax(axis=0)
    return np.asarray(mixed[least, np.arange(len(colors))])
