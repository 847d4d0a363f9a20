"""The ground changes beside lines: below paint and cars, evenly, and labels stay."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.training import surfaces
from yolino.training.augment import Augment
from yolino.training.surfaces import OFFSETS, add_surfaces
from yolino.types import Polylines, Sample

HEIGHT, WIDTH, HORIZON = 160, 320, 30.0
BOTTOMS = (-40.0, 160.0, 360.0)
LANE = 200.0  # pixels at the lower edge


def road(paint: int = 0) -> tuple[np.ndarray, Polylines]:
    """Gray ground, labels up to 20 rows below the horizon, and paint of a width at the lower edge."""
    image = np.full((HEIGHT, WIDTH, 3), 100, np.uint8)
    for bottom in BOTTOMS if paint else ():
        corners = np.array([(160.0, HORIZON), (bottom - paint / 2, HEIGHT), (bottom + paint / 2, HEIGHT)])
        cv2.fillPoly(image, [np.rint(corners).astype(np.int32)], (230, 230, 230))
    y = np.arange(150.0, 40.0, -10.0)
    share = (y - HORIZON) / (HEIGHT - HORIZON)
    lines = [np.stack([160.0 + share * (bottom - 160.0), y], axis=1) for bottom in BOTTOMS]
    return image, Polylines.from_list(lines, labels=[2, 0, 1])


def lanes_from_the_middle() -> np.ndarray:
    """The distance of each pixel to the line in the middle, in lanes."""
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    depth = np.maximum(y - HORIZON, 1e-9) / (HEIGHT - HORIZON)
    return np.where(y > HORIZON, (x - 160.0) / (depth * LANE), np.inf)


def only_the_middle(count: int) -> list[int]:
    """Gives seeds with which a share of .3 of three lines is the one in the middle alone."""
    chosen = [np.flatnonzero(np.random.default_rng(seed).random(3) < 0.3).tolist() for seed in range(1000)]
    return [seed for seed, lines in enumerate(chosen) if lines == [1]][:count]


def change(seed: int, image: np.ndarray, lines: Polylines) -> np.ndarray:
    return add_surfaces(image, lines, np.random.default_rng(seed), share=0.3)


@pytest.mark.parametrize("seed", only_the_middle(10))
def test_a_surface_lies_on_one_side_at_its_offset(seed: int) -> None:
    image, lines = road()
    before = image.copy()
    found = change(seed, image, lines)
    changed = np.any(found != 100, axis=2)
    beside = lanes_from_the_middle()
    assert changed.sum() > 300
    assert not changed[:50].any()  # above the labels
    near, pixel = OFFSETS[0], 1.5 / LANE * (HEIGHT - HORIZON) / 20  # of the row farthest away
    at = beside[changed]
    assert (at > near - pixel).all() or (at < -near + pixel).all()
    lower = np.abs(beside[-5:][changed[-5:]])
    assert near - 0.02 <= lower.min() <= OFFSETS[1] + 0.02
    assert np.array_equal(image, before)


def test_it_is_of_one_color_darker_or_lighter() -> None:
    image, lines = road()
    shades = []
    for seed in only_the_middle(30):
        lower = change(seed, image, lines)[-3:].reshape(-1, 3).astype(int)
        values, counts = np.unique(lower, axis=0, return_counts=True)
        new = values[np.argsort(counts)][-2:]
        shades.append(new[np.abs(new - 100).sum(axis=1).argmax()].mean() / 100)
    assert min(shades) < 0.75
    assert max(shades) > 1.3
    assert min(abs(np.log(shades))) > 0.03


def test_its_edge_runs_to_the_vanishing_point(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(surfaces, "OFFSETS", (0.2, 0.2))
    monkeypatch.setattr(surfaces, "WIDTHS", (0.3, 0.3))
    image, lines = road()
    changed = np.abs(change(only_the_middle(1)[0], image, lines).astype(int) - 100).max(axis=2)
    beside = np.abs(lanes_from_the_middle())
    inner = (changed > 0) & np.isfinite(beside)
    for row in (80, 110, 140):
        edge = 1.0 / ((row + 0.5 - HORIZON) / (HEIGHT - HORIZON) * LANE)
        assert beside[row][inner[row]].min() == pytest.approx(0.2, abs=1.5 * edge)
        assert beside[row][inner[row]].max() == pytest.approx(0.5, abs=1.5 * edge)


@pytest.mark.parametrize("seed", range(4))
def test_paint_and_cars_stay(seed: int) -> None:
    image, lines = road(paint=24)
    image[100:112, 90:230] = (200, 20, 20)
    found = add_surfaces(image, lines, np.random.default_rng(seed), share=1.0)
    stays = (image[..., 0] == 230) | (image[..., 0] == 200)
    assert np.array_equal(found[stays], image[stays])
    assert not np.array_equal(found, image)


def test_fill_beside_the_picture_is_not_touched() -> None:
    image, lines = road()
    image[:, :120] = 110  # nearly the color of the ground
    corners = np.array([[120, 0.0], [WIDTH, 0.0], [WIDTH, HEIGHT], [120, HEIGHT]])
    for seed in range(4):
        found = add_surfaces(image, lines, np.random.default_rng(seed), share=1.0, corners=corners)
        assert np.all(found[:, :120] == 110)
        assert np.any(found[:, 120:] != 100)


def test_both_sides_get_surfaces() -> None:
    image, lines = road()
    right = [np.any(change(seed, image, lines)[:, 170:] != 100) for seed in only_the_middle(12)]
    assert 2 <= sum(right) <= 10


def test_without_surfaces_or_lanes_the_image_comes_back() -> None:
    image, lines = road()
    outside = lines.with_vertices(lines.vertices + np.array([5000, 0]))
    for labels, share in ((lines, 0.0), (lines[:0], 1.0), (lines[:1], 1.0), (outside, 1.0)):
        assert add_surfaces(image, labels, np.random.default_rng(0), share=share) is image


@settings(deadline=None, max_examples=60)
@given(
    lane=st.floats(20, 400),
    vanish=st.tuples(st.floats(-50, 400), st.floats(-40, 150)),
    tops=st.lists(st.floats(0.02, 0.9), min_size=2, max_size=5),
    size=st.sampled_from([(HEIGHT, WIDTH), (1, 1), (13, 40), (200, 3)]),
    light=st.sampled_from([(0, 4), (90, 110), (250, 256)]),
    seed=st.integers(0, 99),
)
def test_any_road_runs_and_a_seed_gives_one_image(
    lane: float,
    vanish: tuple[float, float],
    tops: list[float],
    size: tuple[int, int],
    light: tuple[int, int],
    seed: int,
) -> None:
    share = np.array([[1.0], [0.7], [0.4]])
    ground = [np.array([(i - len(tops) / 2) * lane, size[0] + 20.0]) for i in range(len(tops))]
    lines = [np.array(vanish) + (top + share * (1 - top)) * at for at, top in zip(ground, tops, strict=True)]
    image = np.random.default_rng(seed).integers(*light, (*size, 3), np.uint8)
    first, again = (
        add_surfaces(image, Polylines.from_list(lines), np.random.default_rng(seed), share=0.7)
        for _ in range(2)
    )
    assert first.shape == image.shape
    assert np.array_equal(first, again)


@settings(deadline=None, max_examples=20)
@given(
    points=st.lists(st.lists(st.tuples(st.floats(-400, 700), st.floats(-200, 400)), max_size=5), max_size=5),
    seed=st.integers(0, 99),
)
def test_any_labels_run(points: list[list[tuple[float, float]]], seed: int) -> None:
    image = np.random.default_rng(seed).integers(90, 110, (HEIGHT, WIDTH, 3), np.uint8)
    found = add_surfaces(image, Polylines.from_list(points), np.random.default_rng(seed), share=0.7)
    assert found.shape == image.shape


def test_augment_changes_surfaces_and_keeps_the_labels() -> None:
    image, lines = road()
    item = Sample("a", image, lines)
    result = Augment((HEIGHT, WIDTH), lines={"surface": 1})(item, np.random.default_rng(0))
    assert np.array_equal(result.polylines.vertices, lines.vertices)
    assert np.array_equal(result.polylines.labels, lines.labels)
    assert np.any(result.image != image)
    with pytest.raises(ValueError, match=r"surface is 1\.5, but must be a probability"):
        Augment((HEIGHT, WIDTH), lines={"surface": 1.5})
