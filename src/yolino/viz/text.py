"""Text on dark boxes, of a size that follows the image."""

from __future__ import annotations

import unicodedata

import cv2

from yolino.viz.colors import OUTLINE, Color
from yolino.viz.strokes import Canvas, image_edge

_FONT = cv2.FONT_HERSHEY_SIMPLEX


def row_height(image: Canvas) -> int:
    """Gives the height in pixels of a line of text that suits the size of the image."""
    return max(16, round(image_edge(image) / 30))


def draw_text(canvas: Canvas, text: str, corner: tuple[int, int], color: Color, height: int) -> int:
    """Writes a line on a dark box on the canvas.

    The font knows ASCII only: accents are dropped, other letters become question marks.

    Args:
        canvas: Is drawn on.
        text: What to write; where the room to the right does not do, its beginning is left out.
        corner: Top left corner of the box, (x, y).
        color: Of the letters.
        height: Of the box in pixels.

    Returns:
        Width of the box in pixels.
    """
    margin = height // 4
    room = canvas.shape[1] - corner[0] - 2 * margin
    text = _as_ascii(text)
    shown = text
    while shown and text_width(shown, height) > room:
        text = text[1:]
        shown = f"...{text}" if text else ""
    width = text_width(shown, height) + 2 * margin
    cv2.rectangle(canvas, corner, (corner[0] + width - 1, corner[1] + height - 1), OUTLINE, cv2.FILLED)
    place = (corner[0] + margin, corner[1] + round(height * 0.7))
    cv2.putText(canvas, shown, place, _FONT, height / 44, color, _weight(height), cv2.LINE_AA)
    return width


def covers_little(canvas: Canvas, size: tuple[int, int]) -> bool:
    """Tells whether a box (height, width) covers no more than a quarter of the canvas."""
    return bool(4 * size[0] * size[1] <= canvas.shape[0] * canvas.shape[1])


def text_width(text: str, height: int) -> int:
    """Gives the width in pixels of the letters on a box of `height`."""
    return int(cv2.getTextSize(_as_ascii(text), _FONT, height / 44, _weight(height))[0][0])


def _weight(height: int) -> int:
    return max(1, round(height / 28))


def _as_ascii(text: str) -> str:
    plain = (letter for letter in unicodedata.normalize("NFKD", text) if not unicodedata.combining(letter))
    return "".join(letter if " " <= letter <= "~" else "?" for letter in plain)


__all__ = ["covers_little", "draw_text", "row_height", "text_width"]
