"""Seams run beside lines: darker than the ground, below paint and cars, and nowhere else."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.training import seams
from yolino.training.augment import Augment
from yolino.training.seams import LOOKS, OFFSETS, add_seams
from yolino.types import Polylines, Sample

HEIGHT, WIDTH, VANISH = 160, 320, np.array([160.0, 30.0])
BOTTOMS = (-40.0, 160.0, 360.0)
LANE = 200.0  # pixels at the lower edge


def line(bottom: float) -> np.ndarray:
    y = np.arange(150.0, 40.0, -10.0)
    share = (y - VANISH[1]) / (HEIGHT - VANISH[1])
    return np.stack([VANISH[0] + share * (bottom - VANISH[0]), y], axis=1)


def road(paint: int = 0) -> tuple[np.ndarray, Polylines]:
    """Gray ground with labels, and white paint of a width in pixels at the lower edge."""
    image = np.full((HEIGHT, WIDTH, 3), 100, np.uint8)
    for bottom in BOTTOMS if paint else ():
        corners = np.array([VANISH, (bottom - paint / 2, HEIGHT), (bottom + paint / 2, HEIGHT)])
        cv2.fillPoly(image, [np.rint(corners).astype(np.int32)], (230, 230, 230))
    return image, Polylines.from_list([line(b) for b in BOTTOMS], labels=[2, 0, 1])


def distance_in_lanes() -> np.ndarray:
    """The distance of each pixel to the nearest line, in lanes."""
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    depth = np.maximum(y - VANISH[1], 1e-9) / (HEIGHT - VANISH[1])
    lines = [np.abs(x - (VANISH[0] + depth * (b - VANISH[0]))) for b in BOTTOMS]
    return np.where(y > VANISH[1], np.min(lines, axis=0) / (depth * LANE), np.inf)


@pytest.mark.parametrize("seed", range(8))
def test_seams_change_the_ground_beside_lines_only(seed: int) -> None:
    image, lines = road()
    before = image.copy()
    found = add_seams(image, lines, np.random.default_rng(seed), share=1.0)
    changed = np.any(found != before, axis=2)
    assert changed.sum() > 100
    y = np.mgrid[:HEIGHT, :WIDTH][0]
    reach = OFFSETS[1] + 0.1 + 3 / np.maximum((y - 30) / 130 * LANE, 1)  # sway, width, edges of pixels
    assert not changed[distance_in_lanes() > reach].any()
    assert not changed[:40].any()  # above the labels
    assert np.array_equal(image, before)


def test_most_are_dark_and_some_are_light() -> None:
    image, lines = road()
    change = [
        add_seams(image, lines[1:], np.random.default_rng(s), share=1.0).astype(int).mean() - 100
        for s in range(40)
    ]
    assert np.mean(np.array(change) < 0) > 0.8
    assert any(LOOKS[name].depth[1] < 0 for name in LOOKS)


def test_a_seam_gets_wider_towards_the_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(seams, "LOOKS", {"joint": seams.Look(1.0, (0.03, 0.03), (0.8, 0.8), 0.0, 0.0, 0.0)})
    image, lines = road()
    dark = 100.0 - add_seams(image, lines, np.random.default_rng(0), share=1.0)[:, 100:220, 0]
    upper, lower = dark[60:70, 30:90].sum(), dark[140:150].sum()
    assert lower / upper == pytest.approx(115 / 35, rel=0.3)  # rows below the horizon


@pytest.mark.parametrize("seed", range(4))
def test_paint_is_not_covered(seed: int) -> None:
    image, lines = road(paint=24)
    found = add_seams(image, lines, np.random.default_rng(seed), share=1.0)
    white = image[..., 0] == 230
    assert np.array_equal(found[white], image[white])
    assert not np.array_equal(found, image)


def test_a_car_stays() -> None:
    image, lines = road()
    image[100:120, 90:230] = (20, 20, 120)
    for seed in range(6):
        found = add_seams(image, lines, np.random.default_rng(seed), share=1.0)
        assert np.array_equal(found[100:120, 90:230], image[100:120, 90:230])


def test_fill_beside_the_picture_is_not_touched() -> None:
    image, lines = road()
    left = 120
    image[:, :left] = 7
    corners = np.array([[left, 0.0], [WIDTH, 0.0], [WIDTH, HEIGHT], [left, HEIGHT]])
    found = add_seams(image, lines, np.random.default_rng(1), share=1.0, corners=corners)
    assert np.all(found[:, :left] == 7)
    assert np.any(found[:, left:] != 100)


def test_without_seams_or_lanes_the_image_comes_back() -> None:
    image, lines = road()
    outside = lines.with_vertices(lines.vertices + np.array([5000, 0]))
    for labels, share in ((lines, 0.0), (lines[:0], 1.0), (lines[:1], 1.0), (outside, 1.0)):
        assert add_seams(image, labels, np.random.default_rng(0), share=share) is image


def test_the_share_is_the_share_of_lines() -> None:
    image, lines = road()
    count = 0
    for seed in range(60):
        found = add_seams(image, lines, np.random.default_rng(seed), share=0.5)
        near = np.any(found != 100, axis=2)[75:85]
        count += sum(bool(part.any()) for part in (near[:, :120], near[:, 120:200], near[:, 200:]))
    assert 70 < count < 110  # 90 expected


@settings(deadline=None, max_examples=40)
@given(
    points=st.lists(st.lists(st.tuples(st.floats(-400, 700), st.floats(-200, 400)), max_size=5), max_size=5),
    size=st.sampled_from([(HEIGHT, WIDTH), (1, 1), (13, 40), (200, 3)]),
    seed=st.integers(0, 99),
)
def test_any_labels_run_and_a_seed_gives_one_image(
    points: list[list[tuple[float, float]]], size: tuple[int, int], seed: int
) -> None:
    lines = Polylines.from_list(points)
    image = np.random.default_rng(seed).integers(90, 110, (*size, 3), np.uint8)
    first, again = (add_seams(image, lines, np.random.default_rng(seed), share=0.7) for _ in range(2))
    assert first.shape == image.shape
    assert np.array_equal(first, again)


def test_augment_adds_seams_and_keeps_the_labels() -> None:
    image, lines = road()
    item = Sample("a", image, lines)
    result = Augment((HEIGHT, WIDTH), lines={"seam": 1})(item, np.random.default_rng(0))
    assert np.array_equal(result.polylines.vertices, lines.vertices)
    assert np.array_equal(result.polylines.labels, lines.labels)
    assert np.any(result.image != image)
    with pytest.raises(ValueError, match=r"seam is 1\.5, but must be a probability"):
        Augment((HEIGHT, WIDTH), lines={"seam": 1.5})
