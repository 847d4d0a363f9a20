from __future__ import annotations

import numpy as np
import pytest

from yolino.types import Polylines, Segments
from yolino.viz import contact_sheet, draw_stages, draw_wheel

NOTHING = Segments(np.zeros((0, 2, 2)))
NO_LINES = Polylines.from_list([])
BAR = 28


def plain(height: int = 480, width: int = 640) -> np.ndarray:
    return np.full((height, width, 3), 90, np.uint8)


def tiles(picture: np.ndarray, height: int, width: int) -> list[np.ndarray]:
    return [
        picture[top : top + height, left : left + width]
        for top in (4 + BAR, 2 * (4 + BAR) + height)
        for left in (4, 8 + width)
    ]


def test_each_stage_has_its_tile() -> None:
    way = np.array([[100.5, 400.5], [100.5, 300.5]])
    kept = Segments([way, way + np.array([100, 0])])
    candidates = Segments([way + np.array([x, 0]) for x in (0, 100, 200)], [0.9, 0.8, 0.1])
    line = Polylines.from_list([way + np.array([300, 0])])
    picture = draw_stages(plain(), candidates, kept, kept[:1], line)
    assert picture.shape == (2 * (480 + BAR + 4) + 4, 2 * 644 + 4, 3)
    parts = [(tile[120:] != 90).any(axis=2) for tile in tiles(picture, 480, 640)]
    columns = [[x for x in (100, 200, 300, 400) if part[:, x - 5 : x + 5].any()] for part in parts]
    assert columns == [[100, 200, 300], [100, 200], [100], [400]]


def test_without_candidates_the_image_is_shown() -> None:
    picture = draw_stages(plain(), None, NOTHING, NOTHING, NO_LINES)
    image, kept, merged, lines = tiles(picture, 480, 640)
    for tile in (image, lines):
        np.testing.assert_array_equal(tile, plain())
    for tile in (kept, merged):
        np.testing.assert_array_equal(tile, draw_wheel(plain()))


def test_candidates_below_the_threshold_are_pale() -> None:
    way = np.array([[100.5, 400.5], [100.5, 300.5]])
    both = Segments([way, way + np.array([200, 0])], [0.4, 0.4])
    candidates = tiles(draw_stages(plain(), both, NOTHING, NOTHING, NO_LINES), 480, 640)[0]
    strong = tiles(draw_stages(plain(), both, both, NOTHING, NO_LINES), 480, 640)[0]
    difference = [int(np.abs(tile[350, 100].astype(int) - 90).sum()) for tile in (candidates, strong)]
    assert 0 < difference[0] < 0.5 * difference[1]


@pytest.mark.parametrize(
    ("size", "edge", "tile"),
    [((60, 120), None, (240, 480)), ((2000, 4000), None, (640, 1280)), ((50, 100), 50, (25, 50))],
)
def test_tiles_have_a_size_to_look_at_and_lines_their_place(
    size: tuple[int, int], edge: int | None, tile: tuple[int, int]
) -> None:
    height, width = size
    line = Polylines.from_list([[[0.0, height / 2], [float(width), height / 2]]])
    picture = draw_stages(plain(*size), None, NOTHING, NOTHING, line, edge=edge)
    bar = max(28, min(tile) // 18)
    last = picture[-4 - tile[0] : -4, -4 - tile[1] : -4]
    assert picture.shape == (2 * (tile[0] + bar + 4) + 4, 2 * (tile[1] + 4) + 4, 3)
    rows = np.flatnonzero((last != 90).any(axis=(1, 2)))
    assert abs(rows.mean() + 0.5 - tile[0] / 2) <= 0.5


def test_the_four_stages_stand_in_one_row_if_asked() -> None:
    picture = draw_stages(plain(), None, NOTHING, NOTHING, NO_LINES, columns=4)
    assert picture.shape == contact_sheet([plain()] * 4, ["a"] * 4, columns=4, tile=(480, 640)).shape


def test_the_image_stays_and_bad_input_is_refused() -> None:
    image = np.full((480, 640), 90, np.uint8)
    draw_stages(image, Segments([[[5.0, 5.0], [90.0, 90.0]]]), NOTHING, NOTHING, NO_LINES)
    assert (image == 90).all()
    with pytest.raises(ValueError, match="3 titles are given, but there are 4 stages"):
        draw_stages(image, None, NOTHING, NOTHING, NO_LINES, titles=("a", "b", "c"))
    broken = Segments([[[0.0, 1.0], [np.inf, 2.0]]])
    with pytest.raises(ValueError, match="NaN or infinite"):
        draw_stages(image, broken, NOTHING, NOTHING, NO_LINES)
