"""What a metric counts, where nothing is labelled, and many images on one sheet."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from numpy.typing import NDArray

from yolino.image import as_rgb
from yolino.viz.colors import FALSE_ALARM, HIT, MISS, Color
from yolino.viz.lines import draw_dots
from yolino.viz.strokes import Canvas, auto_thickness, check_finite, image_edge
from yolino.viz.text import covers_little, draw_text, row_height, text_width

_BACKGROUND = (32, 32, 32)
_TITLE: Color = (255, 255, 255)
_REGION: Color = (200, 200, 200)
_GAP, _BAR = 4, 28
_VERDICTS = ("hit", "false", "missed")
_THIN = 1 / 1400  # of the image's edge: radius of dots that make up a line
TILE = (360, 640)


def draw_matches(
    image: NDArray[np.generic],
    *,
    hits: Float[np.ndarray, "n 2"],
    false_alarms: Float[np.ndarray, "m 2"],
    misses: Float[np.ndarray, "k 2"],
    reach: float | None = None,
) -> Canvas:
    """Gives the image with a metric's verdict on points: hits green, false alarms blue, misses red.

    Misses lie on top of false alarms, and both on top of hits. Points that follow each other closely, as
    samples of lines do, give thin lines, other points larger dots.

    Args:
        image: RGB or gray pixels.
        hits: Predicted points that count as true, in pixels of the image.
        false_alarms: The other predicted points.
        misses: Labelled points that no prediction found.
        reach: Distance in pixels up to which the metric takes points for the same: no dot is wider than a
            quarter of it.

    Raises:
        ValueError: If the image is none, or a coordinate is not finite.
    """
    groups = [(hits, HIT), (false_alarms, FALSE_ALARM), (misses, MISS)]
    canvas = as_rgb(image).copy()
    for points, _ in groups:
        check_finite(points)
    radius = _dot_radius(canvas, [points for points, _ in groups])
    if reach is not None:
        radius = max(1, min(radius, int(reach / 8)))
    draw_dots(canvas, groups, radius)
    texts = [f"{name} {len(points)}" for name, (points, _) in zip(_VERDICTS, groups, strict=True)]
    height = row_height(canvas)
    width = sum(text_width(text, height) + 2 * (height // 4) for text in texts)
    if covers_little(canvas, (height, width)):
        left = 0
        for text, (_, color) in zip(texts, groups, strict=True):
            left += draw_text(canvas, text, (left, 0), color, height)
    return canvas


def _dot_radius(canvas: Canvas, groups: Sequence[Float[np.ndarray, "_ 2"]]) -> int:
    """Gives the radius in pixels: of a thin line where dots of the usual one would run into each other."""
    usual = auto_thickness(canvas, "auto")
    steps = np.concatenate([np.linalg.norm(np.diff(points, axis=0), axis=1) for points in groups])
    if len(steps) == 0 or np.median(steps) > 2 * usual:
        return usual
    return max(1, round(image_edge(canvas) * _THIN))


def draw_regions(image: NDArray[np.generic], regions: Sequence[Float[np.ndarray, "_ 2"]]) -> Canvas:
    """Gives the image with regions shaded and hatched: where nothing is labelled.

    Args:
        image: RGB or gray pixels.
        regions: Polygons in pixels of the image (even-odd rule).
    """
    canvas = as_rgb(image).copy()
    thickness = max(1, round(image_edge(canvas) / 500))
    rows, columns = np.arange(canvas.shape[0])[:, None], np.arange(canvas.shape[1])
    stripes = ((rows + columns) // (4 * thickness)) % 3 == 0
    for region in regions:
        corners = np.round((np.clip(region, -1e4, 1e5) - 0.5) * 16).astype(np.int32)
        inside = np.zeros(canvas.shape[:2], np.uint8)
        cv2.fillPoly(inside, [corners], 1, cv2.LINE_8, 4)
        inside = inside.astype(np.bool_)
        canvas[inside] = canvas[inside] // 2
        canvas[inside & stripes] = canvas[inside & stripes] // 2 + np.array(_REGION, np.uint8) // 2
        cv2.polylines(canvas, [corners], True, _REGION, thickness, cv2.LINE_AA, 4)
    return canvas


def contact_sheet(
    images: Sequence[NDArray[np.generic]],
    titles: Sequence[str] = (),
    *,
    columns: int = 3,
    tile: tuple[int, int] = TILE,
) -> Canvas:
    """Gives one image that shows all `images`, each shrunk or grown into its tile under its title.

    Args:
        images: At least one RGB or gray image, of any sizes.
        titles: A title per image, or none.
        columns: Tiles in a row.
        tile: Size (height, width) of a tile in pixels without its title.

    Raises:
        ValueError: If there is no image, titles and images differ in number, or a size is not positive.
    """
    if len(images) == 0 or columns < 1 or min(tile) < 1:
        raise ValueError(
            "A contact sheet needs at least one image, one column and a tile of at least one pixel."
        )
    if titles and len(titles) != len(images):
        raise ValueError(f"{len(titles)} titles are given for {len(images)} images; give one each, or none.")
    columns, bar = min(columns, len(images)), max(_BAR, min(tile) // 18) if titles else 0
    height, width = tile[0] + bar + _GAP, tile[1] + _GAP
    size = (ceil(len(images) / columns) * height + _GAP, columns * width + _GAP, 3)
    sheet = np.full(size, _BACKGROUND, np.uint8)
    for i, image in enumerate(images):
        top, left = _GAP + i // columns * height, _GAP + i % columns * width
        if titles:
            draw_text(sheet[top : top + bar, left : left + tile[1]], titles[i], (0, 0), _TITLE, bar)
        small = fit_tile(as_rgb(image), tile)
        y, x = top + bar + (tile[0] - small.shape[0]) // 2, left + (tile[1] - small.shape[1]) // 2
        sheet[y : y + small.shape[0], x : x + small.shape[1]] = small
    return sheet


def fit_tile(image: UInt8[np.ndarray, "h w 3"], tile: tuple[int, int] = TILE) -> UInt8[np.ndarray, "th tw 3"]:
    """Gives an RGB image shrunk or grown to the largest size that fits into a tile (height, width)."""
    scale = min(tile[0] / image.shape[0], tile[1] / image.shape[1])
    size = max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale))
    interpolation = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, size, interpolation=interpolation), np.uint8)
