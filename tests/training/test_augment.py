"""One matrix moves pixels and vertices alike; presets run on everything; a seed gives one image."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.config import Augmentation
from yolino.geometry import fit_matrix, transform_points
from yolino.inference.preprocess import Preprocess
from yolino.io import read_image
from yolino.training.augment import PRESETS, Augment, Geometric
from yolino.training.data import build_augment
from yolino.training.frames import warp
from yolino.types import Polylines, Sample

SIZE = (320, 640)
STRONG: dict[str, Any] = {
    "rotation_degrees": 30.0,
    "scale": (0.7, 1.3),
    "stretch": 1.3,
    "shear": 0.3,
    "horizon": 0.3,
    "perspective": 0.05,
    "shift": (0.1, 0.1),
    "crop": 0.18,
    "flip": 0.5,
    "flip_vertical": 0.5,
}


def dotted(points: np.ndarray, size: tuple[int, int], sigma: float) -> np.ndarray:
    """A black image with a Gaussian dot at each point, drawn from the definition: pixel centers at .5."""
    y, x = np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5
    columns = np.exp(-((x - points[:, :1]) ** 2) / (2 * sigma**2))
    rows = np.exp(-((y - points[:, 1:]) ** 2) / (2 * sigma**2))
    image = 250 * rows.T @ columns
    return np.repeat(image.clip(0, 255).astype(np.uint8)[..., None], 3, axis=2)


def centroid(image: np.ndarray, near: np.ndarray, radius: int) -> np.ndarray:
    """Center of gravity of the dot around `near`, in continuous pixels."""
    left, top = np.floor(near).astype(int) - radius
    weight = image[top : top + 2 * radius + 1, left : left + 2 * radius + 1, 0].astype(float)
    y, x = np.mgrid[: weight.shape[0], : weight.shape[1]] + 0.5
    return np.array([(x * weight).sum(), (y * weight).sum()]) / weight.sum() + (left, top)


def spread(size: tuple[int, int]) -> np.ndarray:
    """Points on a raster, off the pixel centers."""
    x, y = np.meshgrid(np.linspace(0.1, 0.9, 7), np.linspace(0.1, 0.9, 5))
    return np.stack([x.ravel() * size[1] + 0.37, y.ravel() * size[0] + 0.81], axis=1)


def sample(points: np.ndarray, image: np.ndarray | Path) -> Sample:
    return Sample("a", image, Polylines.from_list([points]))


@pytest.mark.parametrize("size", [(720, 1280), (360, 640), (1000, 2100), (611, 977)])
@pytest.mark.parametrize("suffix", ["", ".jpg", ".png"])
def test_a_dot_drawn_at_a_vertex_lands_on_the_moved_vertex(
    tmp_path: Path, size: tuple[int, int], suffix: str
) -> None:
    points = spread(size)
    image: np.ndarray | Path = dotted(points, size, 2.5 * size[1] / 640)
    if suffix:
        path = tmp_path / f"a{suffix}"
        assert cv2.imwrite(str(path), image, [cv2.IMWRITE_JPEG_QUALITY, 98])
        image = path
    augment = Augment(SIZE, geometric=STRONG, fill=0)
    seen = 0
    for seed in range(4):
        result = augment(sample(points, image), np.random.default_rng(seed))
        for vertex in result.polylines.vertices:
            if np.all(vertex > 16) and np.all(vertex < np.array(SIZE[::-1]) - 16):
                seen += 1
                assert np.hypot(*(centroid(result.image, vertex, 12) - vertex)) < 0.3
    assert seen > 30


@pytest.mark.parametrize("fit", ["bottom", "stretch", "letterbox"])
def test_none_is_the_plain_fit(fit: str) -> None:
    size = (720, 1280)
    points = spread(size)
    image = dotted(points, size, 5.0)
    result = Augment(SIZE, fit=fit, **PRESETS["none"])(sample(points, image), np.random.default_rng(0))
    matrix = fit_matrix(size, SIZE, fit)
    assert np.array_equal(result.polylines.vertices, transform_points(points, matrix))
    plain, _ = Preprocess(SIZE, fit)(image)
    assert np.abs(result.image.astype(int) - plain).mean() < 0.3


def test_none_equals_what_the_predictor_sees_exactly_where_pixels_align() -> None:
    image = np.random.default_rng(0).integers(0, 256, (720, 1280, 3), np.uint8)
    result = Augment(SIZE)(sample(spread((720, 1280)), image), np.random.default_rng(0))
    plain, _ = Preprocess(SIZE)(image)
    assert np.array_equal(result.image, plain)
    small = np.random.default_rng(0).integers(0, 256, (200, 640, 3), np.uint8)
    padded = Augment(SIZE)(sample(spread((200, 640)), small), np.random.default_rng(0))
    assert np.array_equal(padded.image, Preprocess(SIZE)(small)[0])
    assert np.all(padded.image[:120] == 114)


def test_a_mirror_image_keeps_the_direction() -> None:
    image = np.random.default_rng(0).integers(0, 256, (*SIZE, 3), np.uint8)
    lines = Polylines.from_list(
        [[(100, 300), (200, 50)], [(400, 310), (500, 60), (510, 40)]], [0.5, 1], [3, 7]
    )
    polygon = np.array([[0.0, 0.0], [10.0, 0.0], [0.0, 20.0]])
    augment = Augment(SIZE, geometric={"flip": 1})
    result = augment(Sample("a", image, lines, (polygon,)), np.random.default_rng(0))
    assert np.array_equal(result.image, image[:, ::-1])
    want = [(540, 300), (440, 50), (240, 310), (140, 60), (130, 40)]
    assert np.allclose(result.polylines.vertices, want)
    assert result.polylines.offsets.tolist() == [0, 2, 5]
    assert result.polylines.labels.tolist() == [3, 7]
    assert result.polylines.scores.tolist() == [0.5, 1.0]
    assert np.allclose(result.ignore[0], [[640, 0], [630, 0], [640, 20]])


def test_both_mirrors_are_half_a_turn() -> None:
    image = np.random.default_rng(0).integers(0, 256, (*SIZE, 3), np.uint8)
    augment = Augment(SIZE, geometric={"flip": 1, "flip_vertical": 1})
    result = augment(sample(spread(SIZE), image), np.random.default_rng(0))
    assert np.array_equal(result.image, image[::-1, ::-1])


def draw(seed: int = 0, **options: Any) -> np.ndarray:
    return Geometric(**options).sample(SIZE, np.random.default_rng(seed))


@settings(deadline=None)
@given(seed=st.integers(0, 1000))
def test_single_motions_stay_within_what_they_promise(seed: int) -> None:
    rotation = draw(seed, rotation_degrees=36.0)
    assert abs(np.rad2deg(np.arctan2(rotation[1, 0], rotation[0, 0]))) <= 36
    assert np.isclose(np.linalg.det(rotation), 1)
    center = np.array([[320.0, 160.0]])
    assert np.allclose(transform_points(center, rotation), center)
    zoom = draw(seed, scale=(0.8, 1.25))
    assert 0.8 <= zoom[0, 0] <= 1.25
    assert np.isclose(zoom[0, 0], zoom[1, 1])
    stretch = draw(seed, stretch=1.2)
    assert 1 / 1.2 <= stretch[0, 0] / stretch[1, 1] <= 1.2
    assert np.isclose(stretch[0, 0] * stretch[1, 1], 1)
    shift = draw(seed, shift=(0.1, 0.05))
    assert abs(shift[0, 2]) <= 64
    assert abs(shift[1, 2]) <= 16
    horizon = np.array([[5.0, 80.0], [600.0, 80.0]])
    shear = draw(seed, shear=0.3, horizon=0.25)
    assert np.allclose(transform_points(horizon, shear), horizon)
    assert abs(transform_points(horizon + np.array([0.0, 100.0]), shear)[0, 0] - 5) <= 30


@settings(deadline=None)
@given(seed=st.integers(0, 1000))
def test_a_crop_window_lies_inside_and_fills_the_image(seed: int) -> None:
    backward = np.linalg.inv(draw(seed, crop=0.18))
    window = transform_points(np.array([[0.0, 0.0], [640.0, 320.0]]), backward)
    assert np.all(window >= -1e-9)
    assert np.all(window <= np.array([640, 320]) + 1e-9)
    share = (window[1] - window[0]) / (640, 320)
    assert np.isclose(share[0], share[1])
    assert 0.82 - 1e-9 <= share[0] <= 1 + 1e-9


def test_perspective_is_bounded_at_the_corners() -> None:
    for seed in range(20):
        matrix = draw(seed, perspective=0.1)
        depth = np.array([[0, 0, 1], [640, 0, 1], [0, 320, 1], [640, 320, 1]]) @ matrix[2]
        assert np.all(depth > 0.75)


IMAGES = {
    "frame": np.random.default_rng(0).integers(0, 256, (72, 128, 3), np.uint8),
    "one pixel": np.full((1, 1, 3), 9, np.uint8),
    "row": np.full((1, 500, 3), 9, np.uint8),
    "column": np.full((500, 1, 3), 9, np.uint8),
    "odd": np.full((333, 517, 3), 200, np.uint8),
    "gray": np.full((33, 51), 200, np.uint8),
    "large": np.zeros((2000, 3001, 3), np.uint8),
    "black": np.zeros((64, 64, 3), np.uint8),
}


@pytest.mark.parametrize("name", IMAGES)
@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("fit", ["bottom", "stretch", "letterbox"])
def test_every_preset_runs_on_odd_images(preset: str, name: str, fit: str) -> None:
    image = IMAGES[name]
    height, width = image.shape[:2]
    lines = [[(x * width, height), (x * width, 0)] for x in (0.1, 0.5, 0.9)]
    augment = Augment((96, 160), fit=fit, **PRESETS[preset])
    for seed in range(3):
        item = Sample("a", image, Polylines.from_list(lines))
        result = augment(item, np.random.default_rng(seed))
        assert result.image.shape == (96, 160, 3)
        assert result.image.dtype == np.uint8
        assert np.isfinite(result.polylines.vertices).all()


@pytest.mark.parametrize("preset", PRESETS)
def test_without_labels(preset: str) -> None:
    item = Sample("a", IMAGES["frame"], Polylines.from_list([]))
    result = Augment(SIZE, **PRESETS[preset])(item, np.random.default_rng(0))
    assert len(result.polylines) == 0
    assert result.ignore == ()


@pytest.mark.parametrize("preset", PRESETS)
def test_the_same_seed_gives_the_same_image_and_no_input_changes(preset: str) -> None:
    image = IMAGES["frame"].copy()
    item = sample(spread((72, 128)), image)
    vertices = item.polylines.vertices.copy()
    augment = Augment(SIZE, **PRESETS[preset])
    first, second = (augment(item, np.random.default_rng(5)) for _ in range(2))
    assert np.array_equal(first.image, second.image)
    assert np.array_equal(first.polylines.vertices, second.polylines.vertices)
    assert np.array_equal(image, IMAGES["frame"])
    assert np.array_equal(item.polylines.vertices, vertices)
    if preset != "none":
        assert not np.array_equal(augment(item, np.random.default_rng(6)).image, first.image)


def test_vertices_outside_remain() -> None:
    lines = Polylines.from_list([[(-50, 900), (640, 300), (2000, -10)]])
    result = Augment(SIZE)(Sample("a", np.zeros((720, 1280, 3), np.uint8), lines), np.random.default_rng(0))
    assert np.allclose(result.polylines.vertices, [(-25, 410), (320, 110), (1000, -45)])


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_a_strong_reduction_does_not_alias(seed: int) -> None:
    image = np.random.default_rng(seed).integers(0, 256, (512, 1024, 3), np.uint8)
    small = warp(image, np.diag([0.125, 0.125, 1.0]), (64, 128))
    assert small.std() < 256 / np.sqrt(12) / 8 * 1.2
    blocks = image.reshape(64, 8, 128, 8, 3).mean(axis=(1, 3))
    assert np.abs(small - blocks).max() <= 1


def test_the_paper_preset_is_what_the_paper_prints() -> None:
    paper = PRESETS["paper"]
    assert paper["geometric"] == {"rotation_degrees": 36.0, "crop": 0.18}
    color = {"brightness": 0.5, "contrast": 0.5, "saturation": 0.5, "hue": 0.2}
    assert paper["photometric"].items() >= color.items()
    assert Augment(SIZE, **paper).photometric.erasing_area == (0.02, 0.15)


def test_values_of_an_experiment_file() -> None:
    augment = Augment(SIZE, geometric={"scale": [1, 2], "rotation_degrees": 3}, lines={"erase": 1})
    assert augment.geometric.scale == (1.0, 2.0)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"fit": "top"}, "fit is 'top'"),
        ({"geometric": {"scale": (0, 1)}}, "scale is"),
        ({"geometric": {"scale": (2, 1)}}, "scale is"),
        ({"geometric": {"stretch": 0.5}}, "stretch is 0.5"),
        ({"geometric": {"perspective": 0.5}}, "perspective is 0.5"),
        ({"geometric": {"crop": 1}}, "crop is 1.0"),
        ({"geometric": {"flip": 2}}, "flip is 2.0, but must be a probability"),
        ({"photometric": {"noise": -1}}, "noise is -1.0"),
        ({"photometric": {"gamma": 0.5}}, "gamma is 0.5"),
        ({"photometric": {"erasing_area": (0.5, 0.2)}}, "erasing_area is"),
        ({"lines": {"erase": 7}}, "erase is 7.0"),
    ],
)
def test_mistakes(options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        Augment(SIZE, **options)


def test_an_unreadable_image_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"gone\.jpg"):
        Augment(SIZE)(sample(spread(SIZE), tmp_path / "gone.jpg"), np.random.default_rng(0))


def test_half_decoded_frames_look_like_what_the_predictor_sees(tusimple_root: Path) -> None:
    path = next(tusimple_root.rglob("*.jpg"))
    result = Augment(SIZE)(sample(spread((720, 1280)), path), np.random.default_rng(0))
    plain, _ = Preprocess(SIZE)(read_image(path))
    assert np.abs(result.image.astype(int) - plain).mean() < 1.5


def test_road_is_gentle_with_other_paint_and_seams() -> None:
    off = {"repaint": 0, "seam": 0}
    image = np.random.default_rng(0).integers(80, 120, (*SIZE, 3), np.uint8)
    lines = Polylines.from_list([[(x, 310), (320 + (x - 320) / 8, 110)] for x in (20, 220, 420, 620)])
    item = Sample("a", image, lines)
    gentle, road, without = (
        build_augment(Augmentation(preset=preset, options=options), SIZE, "bottom")
        for preset, options in (("gentle", {}), ("road", {}), ("road", {"lines": off}))
    )
    changed = 0
    for seed in range(8):
        a, b, c = (one(item, np.random.default_rng(seed)) for one in (gentle, road, without))
        assert np.array_equal(a.image, c.image)
        assert np.array_equal(a.polylines.vertices, c.polylines.vertices)
        changed += not np.array_equal(a.image, b.image)
    assert changed >= 6


def test_mosaic_is_an_option_of_an_experiment() -> None:
    options: dict[str, Any] = {"mosaic": 0.25}
    assert build_augment(Augmentation(options=options), SIZE, "bottom").mosaic == 0.25
    assert build_augment(Augmentation(), SIZE, "bottom").mosaic == 0
    with pytest.raises(ValueError, match="did you mean 'mosaic'"):
        build_augment(Augmentation(options={"mosaik": 0.25}), SIZE, "bottom")
    with pytest.raises(ValueError, match="did you mean 'seam'"):
        build_augment(Augmentation(options={"lines": {"seams": 0.25}}), SIZE, "bottom")
