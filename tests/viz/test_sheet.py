from __future__ import annotations

import numpy as np
import pytest

from yolino.viz import (
    FALSE_ALARM,
    HIT,
    MISS,
    contact_sheet,
    draw_matches,
    draw_regions,
)


def plain(height: int, width: int, value: int) -> np.ndarray:
    return np.full((height, width, 3), value, np.uint8)


def test_images_stand_in_rows_in_their_proportions() -> None:
    images = [plain(50, 100, 200), plain(100, 50, 150), plain(5, 10, 100)]
    sheet = contact_sheet(images, columns=2, tile=(100, 200))
    assert sheet.shape == (2 * 104 + 4, 2 * 204 + 4, 3)
    assert (sheet[4:104, 4:204] == 200).all()
    assert (sheet[4:104, 208 + 75 : 208 + 125] == 150).all()
    assert (sheet[4:104, 208 : 208 + 75] != 150).all()
    assert (sheet[108:208, 4:204] == 100).all()
    assert (sheet[108:208, 208:408] == 32).all()


def test_titles_stand_above_their_images() -> None:
    images = [plain(20, 40, 200)] * 2
    untitled = contact_sheet(images, tile=(20, 40))
    titled = contact_sheet(images, ["a", "b" * 200], tile=(20, 40))
    assert titled.shape == (untitled.shape[0] + 28, untitled.shape[1], 3)
    assert titled.max() == 255
    assert (titled[32:52, 4:44] == 200).all()
    assert (titled[32:52, 48:88] == 200).all()


def test_one_image_is_a_sheet() -> None:
    assert contact_sheet([np.zeros((4, 4), np.uint8)], ["gray"], columns=5, tile=(8, 8)).shape == (44, 16, 3)


def test_impossible_sheets_are_refused() -> None:
    image = plain(4, 4, 0)
    with pytest.raises(ValueError, match="at least one image"):
        contact_sheet([])
    with pytest.raises(ValueError, match="one column"):
        contact_sheet([image], columns=0)
    with pytest.raises(ValueError, match="at least one pixel"):
        contact_sheet([image], tile=(0, 5))
    with pytest.raises(ValueError, match="2 titles are given for 1 images"):
        contact_sheet([image], ["a", "b"])


def test_hits_false_alarms_and_misses_have_their_colors() -> None:
    image = plain(400, 600, 90)
    drawn = draw_matches(
        image,
        hits=np.array([[100.5, 200.5]]),
        false_alarms=np.array([[300.5, 200.5]]),
        misses=np.array([[500.5, 200.5]]),
    )
    assert tuple(drawn[200, 100]) == HIT
    assert tuple(drawn[200, 300]) == FALSE_ALARM
    assert tuple(drawn[200, 500]) == MISS
    assert (image == 90).all()
    nothing = draw_matches(
        image, hits=np.zeros((0, 2)), false_alarms=np.zeros((0, 2)), misses=np.zeros((0, 2))
    )
    assert (nothing[100:] == 90).all()


def row(y: float, count: int = 300, step: float = 1.0) -> np.ndarray:
    return np.stack([100.5 + step * np.arange(count), np.full(count, y)], axis=1)


NONE = np.zeros((0, 2))


@pytest.mark.parametrize(("size", "most"), [((720, 1280), 6), ((2160, 3840), 11), ((4096, 4096), 11)])
def test_samples_of_lines_are_drawn_as_thin_lines(size: tuple[int, int], most: int) -> None:
    """Also the outline is no wider than a lane of 28 px on a tile of 4096 px is far from the next."""
    drawn = draw_matches(plain(*size, 90), hits=row(300.5), false_alarms=NONE, misses=NONE)
    seen = (drawn[250:350, 250] != 90).any(axis=1).sum()
    assert 3 <= seen <= most
    np.testing.assert_array_equal(drawn[300, 250], HIT)
    sparse = draw_matches(plain(*size, 90), hits=row(300.5, 10, 60.0), false_alarms=NONE, misses=NONE)
    assert (sparse[250:350, 160] != 90).any(axis=1).sum() > seen


def test_no_dot_is_wider_than_a_quarter_of_what_the_metric_looks_at() -> None:
    def seen(reach: float | None) -> int:
        points = row(300.5)
        drawn = draw_matches(plain(4096, 4096, 90), hits=points, false_alarms=NONE, misses=NONE, reach=reach)
        return int((drawn[250:350, 250] != 90).any(axis=1).sum())

    assert seen(8.0) < seen(1000.0) == seen(None)


def test_misses_and_false_alarms_lie_on_hits_and_no_outline_hides_a_color() -> None:
    image = plain(4096, 4096, 90)
    drawn = draw_matches(image, hits=row(300.5), false_alarms=row(300.5, 200), misses=row(300.5, 100))
    for x, color in ((150, MISS), (250, FALSE_ALARM), (350, HIT)):
        np.testing.assert_array_equal(drawn[300, x], color)
    beside = draw_matches(image, hits=row(300.5), false_alarms=row(307.5), misses=row(314.5))
    for y, color in ((300, HIT), (307, FALSE_ALARM), (314, MISS)):
        assert (beside[y - 1 : y + 2, 250] == color).all()


def test_the_counts_are_left_out_where_they_would_cover_a_quarter() -> None:
    image = plain(30, 60, 90)
    np.testing.assert_array_equal(draw_matches(image, hits=NONE, false_alarms=NONE, misses=NONE), image)


@pytest.mark.parametrize("size", [(1, 1), (8, 2000), (2000, 8)])
def test_the_key_fits_into_any_image(size: tuple[int, int]) -> None:
    points = np.array([[0.5, 0.5]])
    assert draw_matches(plain(*size, 0), hits=points, false_alarms=points, misses=points).shape == (*size, 3)


def test_regions_are_shaded_and_hatched_inside_only() -> None:
    image = np.full((60, 80, 3), 200, np.uint8)
    shown = draw_regions(image, [np.array([[20.0, 10.0], [60.0, 10.0], [60.0, 50.0], [20.0, 50.0]])])
    inside, outside = shown[14:46, 24:56], shown[:, 64:]
    assert (outside == 200).all()
    assert inside.max() < 160
    assert len(np.unique(inside)) > 1  # stripes
    assert (image == 200).all()
    np.testing.assert_array_equal(draw_regions(image, []), image)
