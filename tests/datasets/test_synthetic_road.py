from __future__ import annotations

import numpy as np
import pytest

from yolino.datasets.synthetic_road import CLASSES, road_scene
from yolino.types import Sample

SIZE = (360, 640)


@pytest.fixture(scope="module")
def scenes() -> list[Sample]:
    return [road_scene(np.random.default_rng(seed), SIZE) for seed in range(16)]


def across(image: np.ndarray, line: np.ndarray, reach: int = 12) -> np.ndarray:
    """Gives the pixels `reach` columns left and right of a polyline in its lower rows."""
    rows = np.arange(max(int(line[:, 1].min()) + 40, 200), int(line[:, 1].max()) - 20)
    columns = np.interp(rows + 0.5, line[::-1, 1], line[::-1, 0])
    kept = (columns > reach + 1) & (columns < image.shape[1] - reach - 1)
    rows, columns = rows[kept], columns[kept]
    shifts = np.arange(-reach, reach + 1)
    return image[rows[:, None], (np.floor(columns)[:, None] + shifts).astype(int)].astype(float)


def test_labels_run_through_the_middle_of_the_markings(scenes: list[Sample]) -> None:
    profiles = []
    for scene in scenes:
        assert isinstance(scene.image, np.ndarray)
        for line, label in zip(scene.polylines, scene.polylines.labels, strict=True):
            if CLASSES[label] == "continuous yellow":
                pixels = across(scene.image, line)
                if len(pixels) > 20:
                    profile = (pixels[..., 0] - pixels[..., 2]).mean(axis=0)
                    profiles.append(profile - np.median(profile))
    total = np.clip(np.mean(profiles, axis=0), 0, None)
    assert len(profiles) > 3
    assert total.max() > 8
    middle = (total * np.arange(-12, 13)).sum() / total.sum()
    assert abs(middle) < 1.0


def test_polylines_run_from_the_bottom_to_the_top(scenes: list[Sample]) -> None:
    for scene in scenes:
        for line in scene.polylines:
            assert (np.diff(line[:, 1]) < 1e-9).all()
            assert line[0, 1] > line[-1, 1]


def test_polylines_begin_at_the_border(scenes: list[Sample]) -> None:
    starts = np.array([line[0] for scene in scenes for line in scene.polylines])
    x, y = starts.T
    at_border = (np.abs(y - SIZE[0]) < 0.01) | (x < 0.01) | (x > SIZE[1] - 0.01)
    assert at_border.mean() > 0.98


def test_three_to_five_boundaries_are_labelled_and_in_order(scenes: list[Sample]) -> None:
    counts = [len(scene.polylines) for scene in scenes]
    assert max(counts) <= 5
    assert np.mean(np.array(counts) >= 3) > 0.7
    assert min(counts) >= 1
    for scene in scenes:
        slants = [(line[-1, 0] - line[0, 0]) / (line[0, 1] - line[-1, 1]) for line in scene.polylines]
        assert slants == sorted(slants, reverse=True)


def test_a_smaller_size_shows_the_same_view() -> None:
    large = road_scene(np.random.default_rng(1), (720, 1280)).polylines
    small = road_scene(np.random.default_rng(1), (360, 640)).polylines
    cropped = road_scene(np.random.default_rng(1), (320, 640)).polylines
    assert len(large) == len(small) == len(cropped)
    for a, b, c in zip(large, small, cropped, strict=True):
        assert np.allclose(a[0] / 2, b[0], atol=0.6)
        assert np.allclose(b[0] - (0, 40), c[0], atol=0.6)


def test_pictures_have_contrast_and_differ(scenes: list[Sample]) -> None:
    means = [np.asarray(scene.image).mean() for scene in scenes]
    assert np.std(means) > 8
    assert all(np.asarray(scene.image).std() > 12 for scene in scenes)


def test_a_size_without_pixels_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 1 pixel"):
        road_scene(np.random.default_rng(0), (10, 0))
