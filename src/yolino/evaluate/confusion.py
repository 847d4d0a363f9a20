"""Confusion matrices as a picture (SVG, which needs no font and no library)."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence

Matrix = Sequence[Sequence[int]]
Color = tuple[int, int, int]

_CELL, _GAP, _FONT = (84, 52), 48, 14  # pixels: width and height of a cell, between matrices, of letters
_LETTER = 0.56  # of the font's size: typical width of a letter
_TITLE, _SIDE = 34, 24  # pixels: height of the title, width of what is written along the side
_RIGHT: Color = (0, 125, 84)
_WRONG: Color = (204, 66, 32)
_NONE: Color = (240, 240, 240)
_DARK = 0.55  # share of the color from which on letters on it are white


def draw_confusion(classes: Sequence[str], matrices: Mapping[str, Matrix]) -> str:
    """Gives confusion matrices side by side as SVG: a row for each true class, a column for each prediction.

    Cells show the number and its share of the row, which is also how dark they are: green where the class is
    right, red where it is wrong. Rows of classes of which nothing was found are gray.

    Args:
        classes: Names of the classes.
        matrices: By title, of as many rows and columns as there are classes.
    """
    longest = max((len(name) for name in classes), default=0) * _FONT * _LETTER
    n = len(classes)
    left, top = _SIDE + round(longest) + 12, _TITLE + _SIDE + round(0.6 * longest) + 16
    # The names of the columns are slanted, and lean over the right edge.
    width = left + n * _CELL[0] + max(round(0.8 * longest) - _CELL[0] // 2, 0) + 12
    height = top + n * _CELL[1] + 12
    parts = [
        f'<g transform="translate({i * (width + _GAP)} 0)">{_matrix(title, classes, matrix, (left, top))}</g>'
        for i, (title, matrix) in enumerate(matrices.items())
    ]
    total = len(matrices) * (width + _GAP) - _GAP
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {total} {height}" width="{total}" '
        f'height="{height}" font-family="system-ui, Helvetica, Arial, sans-serif" font-size="{_FONT}">'
        f'<rect width="100%" height="100%" fill="white"/>{"".join(parts)}</svg>\n'
    )


def _matrix(title: str, classes: Sequence[str], matrix: Matrix, corner: tuple[int, int]) -> str:
    left, top = corner
    right, bottom = left + len(classes) * _CELL[0], top + len(classes) * _CELL[1]
    parts = [
        _text(title, (left, _FONT + 6), 'font-weight="bold"'),
        _text("predicted as", (left, _TITLE + _FONT), 'fill="#555"'),
        _text("labelled as", (_FONT, (top + bottom) // 2), 'fill="#555" text-anchor="middle"', turn=-90),
    ]
    for i, name in enumerate(classes):
        middle = left + i * _CELL[0] + _CELL[0] // 2
        parts.append(_text(name, (middle, top - 8), turn=-35))
        place = left - 8, top + i * _CELL[1] + _CELL[1] // 2 + _FONT // 3
        parts.append(_text(name, place, 'text-anchor="end"'))
    for i, row in enumerate(matrix):
        for k, count in enumerate(row):
            place = left + k * _CELL[0], top + i * _CELL[1]
            parts.append(_cell(count, sum(row), _RIGHT if i == k else _WRONG, place))
    size = f'width="{right - left}" height="{bottom - top}"'
    return "".join([*parts, f'<rect x="{left}" y="{top}" {size} fill="none" stroke="#888"/>'])


def _cell(count: int, total: int, color: Color, place: tuple[int, int]) -> str:
    """Gives a cell with its number and share."""
    x, y = place
    share = count / total if total else 0.0
    fill = tuple(round(255 + share * (part - 255)) for part in color) if total else _NONE
    box = f'<rect x="{x}" y="{y}" width="{_CELL[0]}" height="{_CELL[1]}" fill="rgb{fill}" stroke="white"/>'
    if not count:
        return box
    ink = 'fill="white"' if share > _DARK else 'fill="#222"'
    middle = x + _CELL[0] // 2
    number = _text(f"{count:,}", (middle, y + 23), f'{ink} text-anchor="middle" font-weight="bold"')
    percent = "<1 %" if 0 < share < 0.005 else f"{100 * share:.0f} %"
    small = f'{ink} text-anchor="middle" font-size="{_FONT - 2}"'
    return box + number + _text(percent, (middle, y + 41), small)


def _text(text: str, place: tuple[int, int], style: str = "", *, turn: int = 0) -> str:
    x, y = place
    turned = f' transform="rotate({turn} {x} {y})"' if turn else ""
    return f'<text x="{x}" y="{y}" {style}{turned}>{html.escape(text)}</text>'


__all__ = ["draw_confusion"]
