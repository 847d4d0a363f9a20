"""Lines become one sample per pixel of length, whatever their slope and their vertices."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.geometry import clip_segments
from yolino.metrics.samples import require_classes, sample_lines
from yolino.types import Polylines, Segments

SIZE = (100, 200)
coordinates = st.tuples(st.floats(0, 200), st.floats(0, 100))


def one(start: list[float], end: list[float]) -> Segments:
    return Segments(np.array([[start, end]]))


def test_samples_lie_in_the_middle_of_equal_stretches() -> None:
    samples = sample_lines(one([10, 20], [13, 20]), SIZE)
    np.testing.assert_allclose(samples.points, [[10.5, 20], [11.5, 20], [12.5, 20]])
    np.testing.assert_allclose(samples.directions, [[1, 0]] * 3)


@pytest.mark.parametrize("degrees", range(0, 360, 15))
def test_every_slope_has_one_sample_per_pixel(degrees: int) -> None:
    direction = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
    samples = sample_lines(Segments(np.array([[[100, 50], np.array([100, 50]) + 40 * direction]])), SIZE)
    assert len(samples) == 40
    np.testing.assert_allclose(np.linalg.norm(np.diff(samples.points, axis=0), axis=1), 1)
    np.testing.assert_allclose(samples.directions, np.tile(direction, (40, 1)), atol=1e-12)
    turn = samples.angles - math.radians(degrees)
    np.testing.assert_allclose(np.cos(turn), 1)


@pytest.mark.parametrize(
    ("length", "count"),
    [(0.0, 0), (0.01, 1), (0.99, 1), (1.49, 1), (1.5, 2), (2.4, 2), (16.3, 16), (16.6, 17)],
)
def test_the_count_is_the_rounded_length_but_at_least_one(length: float, count: int) -> None:
    assert len(sample_lines(one([7, 30], [7, 30 + length]), SIZE)) == count


def test_spacing_sets_the_distance() -> None:
    samples = sample_lines(one([0, 5], [10, 5]), SIZE, spacing=2.5)
    np.testing.assert_allclose(samples.points[:, 0], [1.25, 3.75, 6.25, 8.75])


def test_a_polyline_is_sampled_along_its_arc_and_knows_the_direction_of_each_piece() -> None:
    line = Polylines.from_list([[[0, 0], [2.5, 0], [2.5, 2.5]]])
    samples = sample_lines(line, SIZE)
    np.testing.assert_allclose(samples.points, [[0.5, 0], [1.5, 0], [2.5, 0], [2.5, 1], [2.5, 2]], atol=1e-12)
    np.testing.assert_allclose(samples.directions[[0, 1, 3, 4]], [[1, 0], [1, 0], [0, 1], [0, 1]])


@settings(deadline=None)
@given(st.lists(coordinates, min_size=2, max_size=6), st.lists(st.floats(0, 1), max_size=8))
def test_more_vertices_on_the_same_line_change_nothing(vertices: list, cuts: list) -> None:
    line = np.array(vertices)
    pieces = [
        line[i] + (line[i + 1] - line[i]) * t for i in range(len(line) - 1) for t in sorted({0.0, *cuts})
    ]
    dense = np.array([*pieces, line[-1]])
    few, many = (sample_lines(Polylines.from_list([v]), SIZE) for v in (line, dense))
    length = Polylines.from_list([line]).lengths[0]
    if abs(length % 1 - 0.5) > 1e-6:
        assert len(few) == len(many)
        np.testing.assert_allclose(few.points, many.points, atol=1e-6)


@settings(deadline=None)
@given(st.lists(st.lists(coordinates, max_size=4), max_size=4))
def test_the_counts_and_owners_are_those_of_each_polyline_alone(lines: list) -> None:
    polylines = Polylines.from_list(lines, labels=np.arange(len(lines)) * 3)
    samples = sample_lines(polylines, SIZE)
    for i in range(len(polylines)):
        alone = sample_lines(polylines[i : i + 1], SIZE)
        np.testing.assert_array_equal(samples.points[samples.owners == i], alone.points)
    np.testing.assert_array_equal(samples.labels, samples.owners * 3)
    np.testing.assert_allclose(np.linalg.norm(samples.directions, axis=1), 1)


def sample_in_a_loop(line: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """The definition for one polyline, in plain loops: cut, measure, walk."""
    pieces, _ = clip_segments(np.stack([line[:-1], line[1:]], axis=1), size)
    lengths = [math.dist(start, end) for start, end in pieces]
    total = sum(lengths)
    count = max(1, math.floor(total + 0.5)) if total > 0 else 0
    points = []
    for k in range(count):
        at = (k + 0.5) * total / count
        for (start, end), length in zip(pieces, lengths, strict=True):
            if at < length:
                points.append(start + (end - start) * at / length)
                break
            at -= length
    return np.array(points).reshape(-1, 2)


@pytest.mark.parametrize("seed", range(20))
def test_samples_equal_a_loop_over_lines_that_leave_the_image(seed: int) -> None:
    rng = np.random.default_rng(seed)
    lines = [rng.uniform(-1, 2, (rng.integers(2, 6), 2)) * [200, 100] for _ in range(4)]
    # Along the border, from corner to corner, and level: where cutting divides by zero.
    lines += [
        np.array(v, float) for v in ([[0, -50], [0, 150]], [[-20, 50], [220, 50]], [[-9, -9], [300, 300]])
    ]
    samples = sample_lines(Polylines.from_list(lines), SIZE)
    expected = [sample_in_a_loop(line, SIZE) for line in lines]
    np.testing.assert_array_equal(samples.owners, np.repeat(range(7), [len(points) for points in expected]))
    np.testing.assert_allclose(samples.points, np.concatenate(expected), atol=1e-9)
    alone = sample_lines(Segments(Polylines.from_list(lines).endpoints), SIZE)
    pieces = [sample_in_a_loop(piece, SIZE) for piece in Polylines.from_list(lines).endpoints]
    np.testing.assert_allclose(alone.points, np.concatenate(pieces), atol=1e-9)


def test_views_and_read_only_arrays_are_welcome() -> None:
    vertices = np.array([[0, 5], [9, 9], [30, 40], [9, 9], [90, 70], [9, 9]], float)[::2]
    vertices.setflags(write=False)
    assert len(sample_lines(Polylines(vertices, [0, 3]), SIZE)) == 113
    assert len(sample_lines(Segments(np.stack([vertices[:1], vertices[1:2]], axis=1)[::-1]), SIZE)) == 46


def test_segments_are_sampled_one_by_one() -> None:
    segments = Segments(np.array([[[0, 0], [3, 0]], [[3, 0], [3, 2]], [[9, 9], [9, 9]]]), labels=[4, 2, 1])
    samples = sample_lines(segments, SIZE)
    assert samples.owners.tolist() == [0, 0, 0, 1, 1]
    assert samples.labels.tolist() == [4, 4, 4, 2, 2]


def test_parts_outside_the_image_are_cut_off() -> None:
    for lines in (one([-50, 10], [50, 10]), Polylines.from_list([[[-50, 10], [-1, 10], [50, 10]]])):
        samples = sample_lines(lines, SIZE)
        np.testing.assert_allclose(samples.points[:, 0], np.arange(50) + 0.5)
    assert len(sample_lines(one([-1e12, 10], [1e12, 10]), SIZE)) == 200
    assert len(sample_lines(one([0, -5], [50, -5]), SIZE)) == 0


def test_points_inside_an_ignored_polygon_are_removed() -> None:
    concave = np.array([[2, 0], [8, 0], [8, 10], [6, 10], [6, 4], [4, 4], [4, 10], [2, 10.0]])
    through = sample_lines(one([0, 7], [10, 7]), SIZE, ignore=[concave])
    np.testing.assert_allclose(through.points[:, 0], [0.5, 1.5, 4.5, 5.5, 8.5, 9.5])
    above = sample_lines(one([0, 2], [10, 2]), SIZE, ignore=[concave])
    np.testing.assert_allclose(above.points[:, 0], [0.5, 1.5, 8.5, 9.5])


def test_several_polygons_add_up() -> None:
    boxes = [np.array([[x, 0], [x + 2, 0], [x + 2, 9], [x, 9.0]]) for x in (1, 2, 7)]
    samples = sample_lines(one([0, 5], [10, 5]), SIZE, ignore=boxes)
    np.testing.assert_allclose(samples.points[:, 0], [0.5, 4.5, 5.5, 6.5, 9.5])


def test_nothing_gives_nothing() -> None:
    for lines in (
        Polylines.from_list([]),
        Polylines.from_list([[], [[3, 3]]]),
        Segments(np.zeros((0, 2, 2))),
    ):
        assert len(sample_lines(lines, SIZE)) == 0


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_coordinates_must_be_finite(value: float) -> None:
    with pytest.raises(ValueError, match="NaN or infinite"):
        sample_lines(one([0, value], [5, 5]), SIZE)
    with pytest.raises(ValueError, match="NaN or infinite"):
        sample_lines(Polylines.from_list([[[value, 0]]]), SIZE)


def test_bad_arguments_are_named() -> None:
    line = one([0, 0], [5, 5])
    with pytest.raises(ValueError, match="spacing must be positive"):
        sample_lines(line, SIZE, spacing=0.0)
    with pytest.raises(ValueError, match="size must be a positive"):
        sample_lines(line, (0, 10))
    with pytest.raises(ValueError, match="at least 3 finite corners"):
        sample_lines(line, SIZE, ignore=[np.zeros((2, 2))])
    with pytest.raises(ValueError, match="at least 3 finite corners"):
        sample_lines(line, SIZE, ignore=[np.full((4, 2), np.nan)])


def test_labels_must_be_classes() -> None:
    lines = Segments(np.zeros((2, 2, 2)), labels=[0, 2])
    require_classes(lines, "truth", ())
    require_classes(lines, "truth", ("a", "b", "c"))
    require_classes(lines[:0], "truth", ("a",))
    with pytest.raises(ValueError, match=r"truth has the label 2, but labels must be 0 to 1 \(a, b\)"):
        require_classes(lines, "truth", ("a", "b"))
    with pytest.raises(ValueError, match="truth has the label -1, but labels must be 0 or more"):
        require_classes(Segments(np.zeros((1, 2, 2)), labels=[-1]), "truth", ())
