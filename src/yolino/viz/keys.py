"""Keys to the colors: the names of classes, the wheel of directions, the scale of scores.

A key that would cover more than a quarter of the image is left out.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Int
from numpy.typing import NDArray

from yolino.image import as_rgb
from yolino.viz.colors import OUTLINE, Color, direction_colors, palette, score_colors
from yolino.viz.strokes import Canvas, as_color, image_edge
from yolino.viz.text import covers_little, draw_text, row_height, text_width

_PLAIN: Color = (235, 235, 235)
_SMALLEST = 11  # pixels; lower text cannot be read


def draw_legend(
    image: NDArray[np.generic], names: Sequence[str], *, labels: Int[np.ndarray, " n"] | None = None
) -> Canvas:
    """Gives the image with the names of the classes in its lower left corner, each in its color.

    Many names are written smaller and in several columns; how many find no place is told. Where not even one
    column leaves three quarters of the image to be seen, there is none.

    Args:
        image: RGB or gray pixels.
        names: Names of the classes, in the order of the labels. A label beyond them is "class 7".
        labels: Labels of what is drawn: only their classes are named. None names all.
    """
    canvas = as_rgb(image).copy()
    shown = np.arange(len(names)) if labels is None else np.unique(labels)
    texts = [names[i] if 0 <= i < len(names) else f"class {i}" for i in shown.tolist()]
    colors = [as_color(color) for color in palette(shown)]
    height = row_height(canvas)
    while height > _SMALLEST and not _fits(canvas, texts, height):
        height -= 1
    rows = max(1, canvas.shape[0] // height)
    columns = [texts[i : i + rows] for i in range(0, len(texts), rows)]
    if columns and not covers_little(canvas, _column_size(columns[0], height)):
        return canvas
    left = 0
    for i, column in enumerate(columns):
        right = left + _column_width(column, height)
        if i and not covers_little(canvas, (rows * height, right)):
            draw_text(canvas, f"+ {len(texts) - i * rows} more", (0, 0), _PLAIN, height)
            break
        top = canvas.shape[0] - len(column) * height
        cv2.rectangle(canvas, (left, top), (right - 1, canvas.shape[0] - 1), OUTLINE, cv2.FILLED)
        for j, text in enumerate(column):
            draw_text(canvas, text, (left, top + j * height), colors[i * rows + j], height)
        left = right
    return canvas


def draw_wheel(image: NDArray[np.generic], *, directed: bool = True) -> Canvas:
    """Gives the image with a ring at its upper right: lines in a color head from its middle to that color.

    Args:
        image: RGB or gray pixels.
        directed: False gives opposite directions the same hue, as in the other functions.
    """
    canvas = as_rgb(image).copy()
    edge = max(24, round(image_edge(canvas) / 10))
    edge = min(edge, *canvas.shape[:2])
    if not covers_little(canvas, (edge, edge)):
        return canvas
    x, y = np.meshgrid(*[np.arange(edge) + 0.5 - edge / 2] * 2)
    radius = np.hypot(x, y) / (edge / 2)
    hues = direction_colors(np.stack([x, y], axis=-1).reshape(-1, 2), directed=directed)
    # One pixel from no color to full color: smooth edges.
    soft = edge / 2
    share = np.clip(np.minimum(0.88 - radius, radius - 0.45) * soft + 0.5, 0, 1)[..., None]
    box = np.clip((1 - radius) * soft + 0.5, 0, 1)[..., None]
    ring = share * hues.reshape(edge, edge, 3) + (1 - share) * np.array(OUTLINE)
    gap = min(edge // 12, *(n - edge for n in canvas.shape[:2]))
    place = canvas[gap : gap + edge, canvas.shape[1] - gap - edge : canvas.shape[1] - gap]
    place[:] = np.rint(box * ring + (1 - box) * place).astype(np.uint8)
    return canvas


def draw_scale(image: NDArray[np.generic], *, title: str = "score") -> Canvas:
    """Gives the image with the colors of scores from 0 to 1 in its upper right corner."""
    canvas = as_rgb(image).copy()
    height = min(row_height(canvas), canvas.shape[0])
    ends = [text_width(text, height) + 2 * (height // 4) for text in (f"{title} 0", "1")]
    width = min(6 * height, max(canvas.shape[1] - sum(ends), 1))
    if not covers_little(canvas, (height, width + sum(ends))):
        return canvas
    left = max(canvas.shape[1] - width - sum(ends), 0)
    left += draw_text(canvas, f"{title} 0", (left, 0), _PLAIN, height)
    place = canvas[:height, left : left + width]
    place[:] = OUTLINE
    rows = slice(height // 4, height - height // 4)
    place[rows] = score_colors(np.linspace(0, 1, place.shape[1]))
    draw_text(canvas, "1", (min(left + width, canvas.shape[1] - 1), 0), _PLAIN, height)
    return canvas


def _column_width(texts: Sequence[str], height: int) -> int:
    return max((text_width(text, height) for text in texts), default=0) + 2 * (height // 4)


def _column_size(texts: Sequence[str], height: int) -> tuple[int, int]:
    return len(texts) * height, _column_width(texts, height)


def _fits(canvas: Canvas, texts: Sequence[str], height: int) -> bool:
    """Tells whether the names fill no more than a quarter of the image, and a third of its width."""
    rows = max(1, canvas.shape[0] // height)
    columns = [texts[i : i + rows] for i in range(0, len(texts), rows)]
    sizes = [_column_size(column, height) for column in columns]
    width = sum(size[1] for size in sizes)
    narrow = len(columns) < 2 or 3 * width <= canvas.shape[1]
    return narrow and covers_little(canvas, (max((size[0] for size in sizes), default=0), width))


__all__ = ["draw_legend", "draw_scale", "draw_wheel"]
