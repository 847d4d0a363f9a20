"""Windows of large images."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.config import load_experiment
from yolino.training.cache import PixelCache
from yolino.training.loaders import build_loaders
from yolino.training.windows import ScaledImages, Windows
from yolino.types import Polylines, Sample

UNUSED = PixelCache(Path("unused"))


class Tiles:
    """Two images of 100 x 160 px, whose red is the column and green the row of each pixel."""

    classes = ("way", "link")
    directed = True

    def __init__(self, image: Path | None = None) -> None:
        rows, columns = np.mgrid[:100, :160]
        self.pixels = np.stack([columns, rows, np.zeros_like(rows)], axis=-1).astype(np.uint8)
        self.image = image

    def __len__(self) -> int:
        return 2

    def __getitem__(self, index: int) -> Sample:
        lines = Polylines.from_list(
            [np.array([[10.0, 90.0], [150.0, 90.0]]), np.array([[20.0, 10.0], [30.0, 20.0]])]
        )
        ignore = (np.array([[100.0, 0.0], [160.0, 0.0], [160.0, 50.0]]),)
        return Sample(f"tile_{index}", self.pixels if self.image is None else self.image, lines, ignore)


def test_the_grid_covers_every_pixel_once_and_ends_with_the_image(tmp_path: Path) -> None:
    windows = Windows(Tiles(), (64, 64), scale=1.0, cache=PixelCache(tmp_path))
    corners = [tuple(windows[i].image[0, 0, :2].tolist()) for i in range(len(windows))]
    assert corners == 2 * [(0, 0), (64, 0), (96, 0), (0, 36), (64, 36), (96, 36)]


def test_a_window_shows_the_pixels_and_the_lines_at_its_place(tmp_path: Path) -> None:
    sample = Windows(Tiles(), (64, 64), scale=1.0, cache=PixelCache(tmp_path))[3]  # left 0, top 36
    assert sample.name == "tile_0, window 0,36"
    assert sample.image[5, 7].tolist() == [7, 41, 0]
    assert [line.tolist() for line in sample.polylines] == [[[10.0, 54.0], [150.0, 54.0]]]
    assert sample.ignore == []


def test_regions_to_ignore_move_with_the_window(tmp_path: Path) -> None:
    sample = Windows(Tiles(), (64, 64), scale=1.0, cache=PixelCache(tmp_path))[2]  # left 96, top 0
    assert np.array_equal(sample.ignore[0], [[4.0, 0.0], [64.0, 0.0], [64.0, 50.0]])


def test_the_scale_shrinks_pixels_and_lines(tmp_path: Path) -> None:
    sample = Windows(Tiles(), (50, 80), scale=0.5, cache=PixelCache(tmp_path))[0]
    assert sample.image.shape == (50, 80, 3)
    # The mean of columns 20 and 21, and of rows 10 and 11.
    assert np.allclose(sample.image[5, 10, :2], [20.5, 10.5], atol=1)
    assert sample.polylines.vertices[0].tolist() == [5.0, 45.0]


def test_an_image_smaller_than_the_window_is_surrounded_by_what_nobody_knows(tmp_path: Path) -> None:
    (sample,) = [Windows(Tiles(), (128, 192), scale=1.0, cache=PixelCache(tmp_path))[0]]
    assert sample.image.shape == (128, 192, 3)
    assert (sample.image[100:] == 114).all()
    assert (sample.image[:, 160:] == 114).all()
    right, below = sample.ignore[1:]
    assert right.tolist() == [[160.0, 0.0], [192.0, 0.0], [192.0, 128.0], [160.0, 128.0]]
    assert below.tolist() == [[0.0, 100.0], [192.0, 100.0], [192.0, 128.0], [0.0, 128.0]]


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000), near=st.sampled_from([0.0, 1.0]))
def test_a_drawn_window_shows_its_place_and_its_middle_lies_in_the_image(seed: int, near: float) -> None:
    windows = Windows(Tiles(), (32, 32), scale=1.0, cache=UNUSED, margin=2.0, near_lines=near)
    sample = windows.draw(np.random.default_rng(seed))
    assert sample.image.shape == (64, 64, 3)
    left, top = map(int, sample.name.split()[-1].split(","))
    middle = sample.image[16:48, 16:48]  # what a network sees that is not turned
    assert middle[0, 0].tolist() == [left + 16, top + 16, 0]
    assert middle[-1, -1].tolist() == [left + 47, top + 47, 0]
    for line in sample.polylines:
        assert (line + np.array([left, top])).tolist() in (
            [[10.0, 90.0], [150.0, 90.0]],
            [[20.0, 10.0], [30.0, 20.0]],
        )


def test_the_same_generator_draws_the_same_window() -> None:
    windows = Windows(Tiles(), (32, 32), scale=1.0, cache=UNUSED)
    first, second = (windows.draw(np.random.default_rng(3)) for _ in range(2))
    assert first.name == second.name
    assert np.array_equal(first.image, second.image)


def test_windows_near_lines_show_lines() -> None:
    windows = Windows(Tiles(), (32, 32), scale=1.0, cache=UNUSED, margin=1.0, near_lines=1.0)
    rng = np.random.default_rng(0)
    assert all(len(windows.draw(rng).polylines) for _ in range(50))


def test_an_image_is_decoded_once(tmp_path: Path) -> None:
    file = tmp_path / "tile.png"
    cv2.imwrite(str(file), Tiles().pixels[..., ::-1])
    cache = ScaledImages(PixelCache(tmp_path / "decoded"), 0.5)
    first = np.array(cache(file))
    (kept,) = (tmp_path / "decoded").iterdir()
    kept.write_bytes(kept.read_bytes()[:-3] + b"\x07\x08\x09")
    assert np.asarray(cache(file))[-1, -1].tolist() == [7, 8, 9]
    assert first.shape == (50, 80, 3)


def test_a_changed_image_is_decoded_anew(tmp_path: Path) -> None:
    file = tmp_path / "tile.png"
    cv2.imwrite(str(file), np.zeros((8, 8, 3), np.uint8))
    cache = ScaledImages(PixelCache(tmp_path / "decoded"), 1.0)
    assert (cache(file) == 0).all()
    cv2.imwrite(str(file), np.full((8, 10, 3), 200, np.uint8))
    assert (cache(file) == 200).all()


def test_a_missing_image_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"no\.png"):
        ScaledImages(PixelCache(tmp_path), 1.0)(tmp_path / "no.png")


def test_an_experiment_with_windows_gives_batches_of_them(tmp_path: Path) -> None:
    config = tmp_path / "windows.yaml"
    config.write_text(
        "name: w\n"
        "data:\n  size: [64, 64]\n  fit: window\n  scale: 0.5\n"
        "  train: [{dataset: synthetic, options: {kind: shapes, length: 3, size: [256, 256]}}]\n"
        "  val: [{dataset: synthetic, options: {kind: shapes, length: 2, size: [256, 256]}}]\n"
        "model: {backbone: residual, neck_width: 8}\n"
        "augment: {preset: aerial}\n"
        "training: {batch_size: 2, validate_every: 2}\n"
    )
    experiment = load_experiment(config, [f"out={tmp_path}"])
    train, val = build_loaders(experiment, border=False)
    batch = next(iter(train))
    assert batch.images.shape == (2, 3, 64, 64)
    assert len(val.dataset) == 2 * 4  # type: ignore[arg-type]
