from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from yolino.datasets.synthetic_shapes import CLASSES, KINDS, shapes_scene
from yolino.geometry import resample

SIZE = (200, 300)


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


@pytest.mark.parametrize("seed", range(5))
def test_the_lines_of_a_branch_share_one_vertex_exactly(seed: int) -> None:
    lines = list(shapes_scene(rng(seed), SIZE, kinds=["branch"]).polylines)
    assert 3 <= len(lines) <= 4
    starts, ends = [tuple(line[0]) for line in lines], [tuple(line[-1]) for line in lines]
    trunk_ends = starts.count(ends[0]) == len(lines) - 1
    arms_end = ends.count(starts[0]) == len(lines) - 1
    assert trunk_ends or arms_end


def test_a_two_way_line_is_two_opposite_polylines_in_the_same_place() -> None:
    lines = list(shapes_scene(rng(), SIZE, kinds=["two-way"]).polylines)
    assert len(lines) == 2
    assert np.array_equal(lines[0], lines[1][::-1])


def test_a_loop_ends_where_it_starts() -> None:
    (loop,) = list(shapes_scene(rng(), SIZE, kinds=["loop"]).polylines)
    assert np.array_equal(loop[0], loop[-1])
    assert len(np.unique(loop, axis=0)) == len(loop) - 1


@pytest.mark.parametrize("seed", range(5))
def test_dashes_are_apart_and_in_a_row(seed: int) -> None:
    scene = shapes_scene(rng(seed), SIZE, kinds=["dashes"])
    lines = list(scene.polylines)
    assert len(lines) >= 2
    assert set(scene.polylines.labels) == {CLASSES.index("dash")}
    for one, following in pairwise(lines):
        gap = np.hypot(*(following[0] - one[-1]))
        assert gap > 0.3 * np.hypot(*(one[-1] - one[0]))
        assert (following[0] - one[-1]) @ (one[-1] - one[0]) > 0


def test_two_lines_cross() -> None:
    one, other = (resample(line, 0.5) for line in shapes_scene(rng(1), SIZE, kinds=["crossing"]).polylines)
    distance = np.hypot(*(one[:, None] - other[None]).transpose(2, 0, 1))
    assert distance.min() < 0.5


def test_lines_run_in_all_directions() -> None:
    directions = []
    for seed in range(60):
        for line in shapes_scene(rng(seed), SIZE, kinds=["line"]).polylines:
            delta = line[-1] - line[0]
            directions.append(np.arctan2(delta[1], delta[0]))
    counts, _ = np.histogram(directions, bins=8, range=(-np.pi, np.pi))
    assert (counts > 0).all()


@pytest.mark.parametrize("seed", range(4))
def test_a_line_is_bright_at_its_left_and_dark_at_its_right(seed: int) -> None:
    scene = shapes_scene(rng(seed), SIZE, kinds=["line"])
    assert isinstance(scene.image, np.ndarray)
    image = scene.image.mean(axis=2)
    (line,) = list(scene.polylines)
    points = resample(line, 2.0)[2:-2]
    tangent = np.gradient(points, axis=0)
    left = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1) / np.hypot(*tangent.T)[:, None]

    def look(at: np.ndarray) -> float:
        column, row = np.clip(at.astype(int), 0, (SIZE[1] - 1, SIZE[0] - 1)).T
        return float(np.median(image[row, column]))

    assert look(points + 1.3 * left) > look(points - 1.3 * left) + 60


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_labelled_is_drawn(kind: str) -> None:
    scene = shapes_scene(rng(2), SIZE, kinds=[kind])
    empty = shapes_scene(rng(2), SIZE, kinds=[])
    assert isinstance(scene.image, np.ndarray)
    assert isinstance(empty.image, np.ndarray)
    points = np.concatenate([resample(line, 1.0) for line in scene.polylines])
    column, row = np.clip(points.astype(int), 0, (SIZE[1] - 1, SIZE[0] - 1)).T
    change = np.abs(scene.image.astype(int) - empty.image.astype(int)).max(axis=2)
    assert np.mean(change[row, column] > 25) > 0.8


def test_an_unknown_kind_is_named() -> None:
    with pytest.raises(ValueError, match="'spiral'"):
        shapes_scene(rng(), SIZE, kinds=["spiral"])


def test_a_size_without_pixels_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 1 pixel"):
        shapes_scene(rng(), (0, 10))
