"""An image of two: each side has the pixels, lines and regions of its own image."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.datasets import Synthetic
from yolino.grid import Grid
from yolino.training.augment import PRESETS, Augment, Augmented
from yolino.training.cache import PixelCache
from yolino.training.data import Examples
from yolino.training.mosaic import join_images
from yolino.training.windows import Windows
from yolino.types import Polylines, Sample

SIZE = (80, 160)


def one(value: int, *lines: list[tuple[float, float]], label: int = 0) -> Augmented:
    labels = [label] * len(lines)
    corners = np.array([[0.0, 10.0], [160.0, 10.0], [160.0, 30.0], [0.0, 30.0]])
    image = np.full((*SIZE, 3), value, np.uint8)
    return Augmented(image, Polylines.from_list(lines, labels=labels), (corners,))


def area(polygon: np.ndarray) -> float:
    x, y = polygon.T
    return float(abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2)


def border_of(image: np.ndarray, row: int) -> float:
    """Columns of the left image in a row."""
    return float((image[row, :, 0] == 10).sum())


@pytest.mark.parametrize("seed", range(6))
def test_lines_end_where_the_pixels_change(seed: int) -> None:
    left = one(10, [(0, 40.5), (160, 40.5)], label=1)
    right = one(20, [(160, 60.5), (0, 60.5)], label=2)
    found = join_images(left, right, np.random.default_rng(seed))
    assert set(np.unique(found.image)) == {10, 20}
    assert np.all(np.diff(found.image[..., 0].astype(int), axis=1) >= 0)  # left of right
    first, second = found.polylines
    assert found.polylines.labels.tolist() == [1, 2]
    assert first[0].tolist() == pytest.approx([0, 40.5])
    assert abs(first[-1, 0] - border_of(found.image, 40)) <= 0.5
    assert second[0].tolist() == pytest.approx([160, 60.5])  # directions stay
    assert abs(second[-1, 0] - border_of(found.image, 60)) <= 0.5


def test_borders_vary_in_place_and_slant() -> None:
    found = [join_images(one(10), one(20), np.random.default_rng(s)).image for s in range(30)]
    middle = np.array([border_of(image, 40) for image in found])
    slant = np.array([border_of(image, 79) - border_of(image, 0) for image in found])
    assert 40 <= middle.min() < 60
    assert 100 < middle.max() <= 120
    assert slant.min() < -10
    assert slant.max() > 10


@settings(deadline=None, max_examples=60)
@given(
    points=st.lists(st.lists(st.tuples(st.floats(-200, 400), st.floats(-100, 200)), max_size=5), max_size=4),
    seed=st.integers(0, 99),
)
def test_an_image_joined_with_itself_is_itself(points: list[list[tuple[float, float]]], seed: int) -> None:
    pixels = np.random.default_rng(seed).integers(0, 256, (*SIZE, 3), np.uint8)
    item = one(0)._replace(image=pixels, polylines=Polylines.from_list(points))
    found = join_images(item, item, np.random.default_rng(seed))
    assert np.array_equal(found.image, pixels)
    assert found.polylines.lengths.sum() == pytest.approx(item.polylines.lengths.sum(), abs=1e-5)
    assert sum(area(polygon) for polygon in found.ignore) == pytest.approx(area(item.ignore[0]))


def test_what_lies_on_the_other_side_is_gone() -> None:
    item = one(10, [(150, 5), (155, 75)])._replace(
        ignore=(np.array([[150.0, 0.0], [160.0, 0.0], [155.0, 20.0]]),)
    )
    empty = one(20)._replace(ignore=())
    found = join_images(item, empty, np.random.default_rng(0))
    assert len(found.polylines) == 0
    assert found.ignore == ()
    found = join_images(empty, item, np.random.default_rng(0))
    assert np.allclose(found.polylines.vertices, [(150, 5), (155, 75)])
    assert np.allclose(found.ignore[0], item.ignore[0])


def test_images_of_two_sizes_are_refused() -> None:
    other = one(20)._replace(image=np.zeros((40, 40, 3), np.uint8))
    with pytest.raises(ValueError, match=r"\(80, 160, 3\) and \(40, 40, 3\) cannot be joined"):
        join_images(one(10), other, np.random.default_rng(0))


class Plain(list[Sample]):
    """Images of one gray value each, with one line each."""

    directed = True

    def __init__(self, first: int, count: int, name: str) -> None:
        self.classes = (name,)
        line = Polylines.from_list([[(5.0, 75.0), (155.0, 5.0)]])
        super().__init__(
            Sample(f"{v}", np.full((*SIZE, 3), v, np.uint8), line) for v in range(first, first + count)
        )


def examples(mosaic: float, weights: list[float] | None = None) -> Examples:
    augment = Augment(SIZE, mosaic=mosaic)
    datasets = [Plain(0, 100, "a"), Plain(100, 100, "b")]
    return Examples(datasets, weights, augment, Grid(SIZE, 16), border=False, classes=["b", "a"], seed=5)


def test_examples_join_samples_of_all_sources_with_their_own_labels() -> None:
    found = [examples(1.0, [1.0, 1.0])[i] for i in range(20)]
    values = [sorted(np.unique(e.image).tolist()) for e in found]
    assert sum(len(v) == 2 for v in values) >= 18  # the same sample may be drawn twice
    assert any(v[0] < 100 <= v[-1] for v in values)
    for example in found:
        left, right = example.image[40, 0, 0], example.image[40, -1, 0]
        assert example.polylines.labels.tolist() == [int(left < 100), int(right < 100)]


def test_an_example_depends_on_its_number_alone() -> None:
    data = examples(0.5, [1.0, 3.0])
    forward = [data[i] for i in range(8)]
    for i in (5, 1, 7, 0):
        again = examples(0.5, [1.0, 3.0])[i]
        assert np.array_equal(again.image, forward[i].image)
        assert np.array_equal(again.polylines.vertices, forward[i].polylines.vertices)
    joined = sum(len(np.unique(data[i].image)) == 2 for i in range(60))
    assert 15 < joined < 45


def test_without_mosaics_examples_are_what_they_were() -> None:
    plain = examples(0.0)
    assert [int(plain[i].image[0, 0, 0]) for i in (0, 99, 100, 199)] == [0, 99, 100, 199]
    assert len(np.unique(examples(1.0)[3].image)) <= 2


def test_windows_are_joined_too(tmp_path: Path) -> None:
    drawn = Synthetic("shapes", 2, size=(128, 256))
    windows = Windows(drawn, (64, 64), scale=1.0, cache=PixelCache(tmp_path))
    augment = Augment((64, 64), fit="window", mosaic=1.0, **PRESETS["aerial"])
    example = Examples([windows], [1.0], augment, Grid((64, 64), 16), border=False)[0]
    assert example.image.shape == (64, 64, 3)


def test_a_probability_is_needed() -> None:
    with pytest.raises(ValueError, match=r"mosaic is 2\.0, but must be a probability"):
        Augment(SIZE, mosaic=2.0)
