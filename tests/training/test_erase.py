"""Erasing an outer line: the paint is gone, the label is gone, everything else stays."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.training.augment import Augment
from yolino.training.erase import erase_outer_line
from yolino.types import Polylines, Sample

HEIGHT, WIDTH = 160, 320
VANISH = np.array([160.0, 30.0])
BOTTOMS = (-140.0, 60.0, 250.0, 460.0)
LABEL_TOP, LABEL_BOTTOM = 40, 150


def line(bottom: float) -> np.ndarray:
    """A lane line from below to the vanishing point, labelled short of both."""
    y = np.arange(LABEL_BOTTOM, LABEL_TOP, -5.0)
    share = (y - VANISH[1]) / (HEIGHT - VANISH[1])
    x = VANISH[0] + share * (bottom - VANISH[0])
    inside = (x >= 0) & (x <= WIDTH)
    return np.stack([x, y], axis=1)[inside]


def road(bottoms: tuple[float, ...] = BOTTOMS, shoulder: int = 100) -> tuple[np.ndarray, Polylines]:
    """Gray road with white lines; left of the first line the ground has the value `shoulder`."""
    image = np.full((HEIGHT, WIDTH, 3), 100, np.uint8)
    image[:30] = (120, 160, 220)
    edge = np.array([VANISH, (bottoms[0], HEIGHT), (-900, HEIGHT), (-900, 30)])
    cv2.fillPoly(image, [np.rint(edge).astype(np.int32)], (shoulder, shoulder, shoulder))
    for bottom in bottoms:
        paint = np.array([VANISH, (bottom - 6, HEIGHT), (bottom + 6, HEIGHT)])
        cv2.fillPoly(image, [np.rint(paint).astype(np.int32)], (255, 255, 255))
    return image, Polylines.from_list([line(b) for b in bottoms], labels=list(range(len(bottoms))))


def paint(image: np.ndarray, rows: slice = slice(55, None)) -> tuple[int, int]:
    """Bright pixels left and right of the middle."""
    bright = image[rows].min(axis=2) > 180
    return int(bright[:, : WIDTH // 2].sum()), int(bright[:, WIDTH // 2 :].sum())


@pytest.mark.parametrize("seed", range(6))
def test_paint_and_label_of_one_outer_line_are_gone(seed: int) -> None:
    image, lines = road()
    before = image.copy()
    erased, rest = erase_outer_line(image, lines, np.random.default_rng(seed))
    assert rest.labels.tolist() in ([1, 2, 3], [0, 1, 2])
    left_gone = rest.labels[0] == 1
    alone, _ = road(BOTTOMS[1:] if left_gone else BOTTOMS[:-1])
    assert paint(erased) == paint(alone)
    assert np.abs(erased[55:].astype(int) - alone[55:]).max() <= 3
    assert np.array_equal(image, before)


def test_both_sides_are_chosen() -> None:
    image, lines = road()
    gone = {erase_outer_line(image, lines, np.random.default_rng(s))[1].labels[0] for s in range(12)}
    assert gone == {0, 1}


def test_the_end_behind_the_label_is_erased_too() -> None:
    image, lines = road((40.0, 160.0, 280.0))
    erased, rest = erase_outer_line(image, lines, np.random.default_rng(0))
    assert len(rest) == 2
    assert sum(paint(erased, slice(LABEL_BOTTOM, HEIGHT))) < sum(paint(image, slice(LABEL_BOTTOM, HEIGHT)))
    alone, _ = road((160.0, 280.0) if rest.labels[0] == 1 else (40.0, 160.0))
    assert paint(erased, slice(LABEL_BOTTOM, HEIGHT)) == paint(alone, slice(LABEL_BOTTOM, HEIGHT))


def test_two_surfaces_keep_a_sharp_border() -> None:
    image, lines = road((30.0, 140.0, 250.0), shoulder=40)
    results = [erase_outer_line(image, lines, np.random.default_rng(s)) for s in range(12)]
    erased = next(picture for picture, rest in results if rest.labels[0] == 1)
    row = erased[120, :70, 0].astype(int)
    assert row.max() <= 101
    assert row.min() >= 39
    assert ((row > 50) & (row < 90)).sum() <= 4


def test_a_car_on_the_line_stays() -> None:
    image, lines = road()
    x, y = line(BOTTOMS[0])[3].astype(int)
    cv2.rectangle(image, (x - 30, y - 12), (x + 30, y + 6), (200, 20, 20), -1)
    for seed in range(6):
        erased, rest = erase_outer_line(image, lines, np.random.default_rng(seed))
        if rest.labels[0] == 1:
            assert np.abs(erased[y - 4, x].astype(int) - (200, 20, 20)).max() <= 1


def test_lines_that_are_mostly_covered_keep_their_labels() -> None:
    _, lines = road()
    blocks = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH // 8, 3), np.uint8)
    image = np.repeat(blocks, 8, axis=1)
    erased, rest = erase_outer_line(image, lines, np.random.default_rng(0))
    assert rest is lines
    assert erased is image


def test_few_or_crossing_or_short_lines_stay() -> None:
    image, lines = road()
    crossing = Polylines.from_list([[(10, 150), (300, 40)], [(300, 150), (10, 40)], [(150, 150), (160, 40)]])
    short = Polylines.from_list([[(x, 100), (x, 95)] for x in (50, 150, 250)])
    apart = Polylines.from_list([[(50, 150), (60, 120)], [(150, 100), (160, 80)], [(250, 70), (260, 40)]])
    for labels in (lines[:2], lines[:0], crossing, short, apart):
        erased, rest = erase_outer_line(image, labels, np.random.default_rng(0))
        assert rest is labels
        assert erased is image


def test_fill_beside_the_picture_is_not_touched() -> None:
    image, lines = road()
    left = 40
    image[:, :left] = 7
    corners = np.array([[left, 0.0], [WIDTH, 0.0], [WIDTH, HEIGHT], [left, HEIGHT]])
    for seed in range(6):
        erased, rest = erase_outer_line(image, lines, np.random.default_rng(seed), corners=corners)
        assert len(rest) == 3
        assert np.all(erased[:, :left] == 7)
        assert erased[55:, left:].min() > 90


@settings(deadline=None)
@given(
    points=st.lists(
        st.lists(st.tuples(st.floats(-400, 700), st.floats(-200, 400)), max_size=5), min_size=3, max_size=5
    ),
    seed=st.integers(0, 99),
)
def test_any_labels_run(points: list[list[tuple[float, float]]], seed: int) -> None:
    image, _ = road()
    lines = Polylines.from_list(points)
    erased, rest = erase_outer_line(image, lines, np.random.default_rng(seed))
    assert len(lines) - len(rest) in (0, 1)
    assert erased.shape == image.shape


def test_augment_erases_with_the_probability_given() -> None:
    image, lines = road()
    item = Sample("a", image, lines)
    for share, least, most in ((0.0, 0, 0), (1.0, 30, 30), (0.5, 6, 24)):
        augment = Augment((HEIGHT, WIDTH), lines={"erase": share})
        count = sum(len(augment(item, np.random.default_rng(s)).polylines) == 3 for s in range(30))
        assert least <= count <= most
