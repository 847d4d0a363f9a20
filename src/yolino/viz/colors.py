"""Which color says what: identity and class, direction, score."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

Color = tuple[int, int, int]

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


def palette(indices: Int[np.ndarray, " n"]) -> UInt8[np.ndarray, "n 3"]:
    """Gives a color per index: the palette, then the palette mixed with white, then with black, and again."""
    base = np.array(PALETTE, np.float64)
    rounds = np.stack([base, base * 0.45 + 255 * 0.55, base * 0.65]).reshape(-1, 3).round().astype(np.uint8)
    return np.asarray(rounds[indices % len(rounds)])


def direction_colors(delta: Float[np.ndarray, "n 2"], *, directed: bool = True) -> UInt8[np.ndarray, "n 3"]:
    """Gives the direction of each vector as a hue: right red, down yellow-green, left cyan, up violet.

    Args:
        delta: Vectors in pixels, y down.
        directed: False gives opposite directions the same hue.
    """
    turn = np.arctan2(delta[:, 1], delta[:, 0]) / (2 * np.pi) * (1 if directed else 2)
    ramp = (np.array([5.0, 3.0, 1.0]) + (turn[:, None] % 1.0) * 6) % 6
    level = 1 - 0.85 * np.clip(np.minimum(ramp, 4 - ramp), 0, 1)
    return np.asarray((255 * level).round().astype(np.uint8))


def score_colors(scores: Float[np.ndarray, " n"]) -> UInt8[np.ndarray, "n 3"]:
    """Gives scores 0..1 as colors from violet over green to yellow (viridis without its darkest part)."""
    if len(scores) == 0:
        return np.zeros((0, 3), np.uint8)
    steps = (64 + 191 * np.clip(scores, 0, 1)).round().astype(np.uint8)
    return np.asarray(cv2.applyColorMap(steps[:, None], cv2.COLORMAP_VIRIDIS)[:, 0, ::-1], np.uint8)


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
