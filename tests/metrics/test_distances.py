"""Chamfer and Frechet distance: by hand, against their definitions in loops, and what must not matter."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.metrics.distances import (
    chamfer,
    chamfer_distances,
    frechet,
    frechet_distances,
    sample_polylines,
    visible_lines,
)
from yolino.types import Polylines, Segments

SIZE = (100, 200)
coordinate = st.floats(-1e3, 1e3)
line = st.lists(st.tuples(coordinate, coordinate), min_size=1, max_size=6).map(
    lambda points: np.array(points, np.float64)
)
count = st.integers(2, 12)


def curve(*points: tuple[float, float]) -> np.ndarray:
    return np.array(points, np.float64)


def points_of(vertices: np.ndarray, samples: int) -> np.ndarray:
    return sample_polylines(Polylines.from_list([vertices]), samples).vertices


def loop_chamfer(a: np.ndarray, b: np.ndarray) -> float:
    """The definition: the mean of the two mean distances to the nearest point of the other."""
    there = [min(math.dist(p, q) for q in b) for p in a]
    back = [min(math.dist(p, q) for p in a) for q in b]
    return (sum(there) / len(there) + sum(back) / len(back)) / 2


def recursive_frechet(a: np.ndarray, b: np.ndarray) -> float:
    """The definition by Eiter and Mannila: the last pair, after the best of the walks that lead there."""

    @cache
    def walk(i: int, j: int) -> float:
        before = [
            walk(*pair) for pair in ((i - 1, j), (i, j - 1), (i - 1, j - 1)) if pair[0] >= 0 and pair[1] >= 0
        ]
        return max(min(before, default=0.0), math.dist(a[i], b[j]))

    return walk(len(a) - 1, len(b) - 1)


def hausdorff(a: np.ndarray, b: np.ndarray) -> float:
    distances = np.hypot(*(a[:, None] - b).transpose(2, 0, 1))
    return float(max(distances.min(axis=1).max(), distances.min(axis=0).max()))


def test_by_hand() -> None:
    short, long = curve((0, 0), (10, 0)), curve((0, 0), (20, 0))
    # Points 0, 5, 10 and 0, 10, 20: 0 + 5 + 0 there, 0 + 0 + 10 back; the walk ends with 10 to 20.
    assert chamfer(short, long, samples=3) == pytest.approx((5 / 3 + 10 / 3) / 2)
    assert frechet(short, long, samples=3) == 10
    beside = curve((0, 3), (10, 3))
    assert chamfer(short, beside) == pytest.approx(3)
    assert frechet(short, beside) == pytest.approx(3)
    apart = curve((13, 4), (13, 4))
    assert chamfer(curve((10, 0)), apart) == frechet(curve((10, 0)), apart) == 5


def test_direction_matters_to_frechet_alone() -> None:
    forward, backward = curve((0, 0), (10, 0)), curve((10, 0), (0, 0))
    assert chamfer(forward, backward) == pytest.approx(0, abs=1e-12)
    assert frechet(forward, backward) == 10
    assert frechet(forward, backward, directed=False) == pytest.approx(0, abs=1e-12)


def test_going_back_costs_frechet_and_not_chamfer() -> None:
    straight = curve((0, 0), (30, 0))
    detour = curve((0, 0), (20, 0), (10, 0), (30, 0))  # 20 to 10 is walked three times
    assert chamfer(straight, detour) < 0.2
    assert frechet(straight, detour) == pytest.approx(5, abs=0.5)


def test_100_points_are_the_default() -> None:
    a, b = curve((0, 0), (10, 0), (10, 50)), curve((3, 1), (9, 40), (9, 45))
    assert chamfer(a, b) == chamfer(a, b, samples=100) != chamfer(a, b, samples=50)
    b = curve((0, 0), (7, 0), (10, 3), (10, 50))
    assert frechet(a, b) == frechet(a, b, samples=100) != frechet(a, b, samples=50)


@settings(deadline=None, max_examples=40)
@given(line, line, count)
def test_distances_equal_their_definitions(a: np.ndarray, b: np.ndarray, samples: int) -> None:
    first, second = points_of(a, samples), points_of(b, samples)
    assert chamfer(a, b, samples=samples) == pytest.approx(loop_chamfer(first, second), abs=1e-9)
    there, back = recursive_frechet(first, second), recursive_frechet(first, second[::-1])
    assert frechet(a, b, samples=samples) == pytest.approx(there, abs=1e-9)
    assert frechet(a, b, directed=False, samples=samples) == pytest.approx(min(there, back), abs=1e-9)


@settings(deadline=None)
@given(line, line, count)
def test_distances_are_symmetric_and_0_to_oneself(a: np.ndarray, b: np.ndarray, samples: int) -> None:
    assert chamfer(a, b, samples=samples) == chamfer(b, a, samples=samples)
    assert chamfer(a, a, samples=samples) == 0
    for directed in (True, False):
        forward = frechet(a, b, directed=directed, samples=samples)
        backward = frechet(b, a, directed=directed, samples=samples)
        assert forward == pytest.approx(backward, abs=1e-9)
        assert frechet(a, a, directed=directed, samples=samples) == 0


@settings(deadline=None)
@given(line, line, count, st.tuples(coordinate, coordinate), st.floats(0.01, 100))
def test_distances_move_and_scale_with_the_plane(
    a: np.ndarray, b: np.ndarray, samples: int, shift: tuple[float, float], scale: float
) -> None:
    for distance in (chamfer, frechet):
        expected = distance(a, b, samples=samples)
        assert distance(a + shift, b + shift, samples=samples) == pytest.approx(expected, abs=1e-8)
        assert distance(scale * a, scale * b, samples=samples) == pytest.approx(scale * expected, abs=1e-8)


@settings(deadline=None)
@given(line, line, count)
def test_bounds(a: np.ndarray, b: np.ndarray, samples: int) -> None:
    first, second = points_of(a, samples), points_of(b, samples)
    undirected = frechet(a, b, directed=False, samples=samples)
    ends = max(math.dist(a[0], b[0]), math.dist(a[-1], b[-1]))
    assert chamfer(a, b, samples=samples) <= hausdorff(first, second) + 1e-9
    assert hausdorff(first, second) <= undirected + 1e-9
    assert undirected <= frechet(a, b, samples=samples) + 1e-9
    assert ends <= frechet(a, b, samples=samples) + 1e-9


def random_lines(rng: np.random.Generator, n: int) -> Polylines:
    return Polylines.from_list(
        rng.uniform(0, 100, 2) + np.cumsum(rng.normal(0, 10, (rng.integers(1, 9), 2)), axis=0)
        for _ in range(n)
    )


@pytest.mark.parametrize("limit", [math.inf, 30.0, 1e-6])
def test_all_pairs_equal_each_pair(limit: float) -> None:
    rng = np.random.default_rng(0)
    a, b = random_lines(rng, 7), random_lines(rng, 5)
    tables = {
        loop_chamfer: chamfer_distances(a, b, limit=limit),
        recursive_frechet: frechet_distances(a, b, limit=limit),
        lambda p, q: min(recursive_frechet(p, q), recursive_frechet(p, q[::-1])): frechet_distances(
            a, b, directed=False, limit=limit
        ),
    }
    for function, table in tables.items():
        assert table.shape == (7, 5)
        expected = np.array([[function(p, q) for q in b] for p in a])
        within = expected <= limit
        np.testing.assert_allclose(table[within], expected[within])
        assert (table[~within] > limit).all()
    if limit == 30.0:
        assert np.isinf(frechet_distances(a, b, limit=limit)).any()


def test_a_pair_exactly_at_the_limit_is_within() -> None:
    a, b = (Polylines.from_list([points]) for points in ([[0.1, 0.2]], [[1.4, 1.7]]))
    exactly = float(chamfer_distances(a, b)[0, 0])
    assert chamfer_distances(a, b, limit=exactly)[0, 0] == exactly
    assert frechet_distances(a, b, limit=exactly)[0, 0] == exactly


def test_no_lines_have_no_distances() -> None:
    some, none = random_lines(np.random.default_rng(1), 3), Polylines.from_list([])
    for limit in (math.inf, 5.0):
        assert chamfer_distances(some, none, limit=limit).shape == (3, 0)
        assert frechet_distances(none, some, directed=False, limit=limit).shape == (0, 3)


def test_points_are_evenly_spaced_from_end_to_end() -> None:
    polylines = Polylines.from_list(
        [[[0, 0], [30, 0], [30, 10]], [[5, 5], [5, 5]], [[1, 2]]], [0.1, 0.2, 0.3], [3, 2, 1]
    )
    sampled = sample_polylines(polylines, 5)
    expected = [[0, 0], [10, 0], [20, 0], [30, 0], [30, 10], *[[5, 5]] * 5, *[[1, 2]] * 5]
    np.testing.assert_allclose(sampled.vertices, expected)
    assert sampled.offsets.tolist() == [0, 5, 10, 15]
    assert sampled.scores.tolist() == [0.1, 0.2, 0.3]
    assert sampled.labels.tolist() == [3, 2, 1]
    assert len(sample_polylines(Polylines.from_list([]), 5)) == 0


@pytest.mark.parametrize("samples", [1, 0, -3])
def test_less_than_two_points_are_refused(samples: int) -> None:
    with pytest.raises(ValueError, match="samples must be at least 2"):
        sample_polylines(Polylines.from_list([]), samples)
    for distance in (chamfer, frechet):
        with pytest.raises(ValueError, match="samples must be at least 2"):
            distance(curve((0, 0)), curve((1, 1)), samples=samples)


def test_a_line_without_points_is_refused() -> None:
    with pytest.raises(ValueError, match="no vertices"):
        chamfer(np.zeros((0, 2)), curve((1, 1)))


def test_visible_lines_are_cut_at_the_image() -> None:
    across = Polylines.from_list([[[-10, 50], [60, 50], [60, 120], [90, 120], [90, 90]]], [0.5], [4])
    lines, optional = visible_lines(across, SIZE, samples=3)
    assert sorted(vertices.tolist() for vertices in lines) == [
        [[0, 50], [55, 50], [60, 100]],
        [[90, 100], [90, 95], [90, 90]],
    ]
    assert lines.scores.tolist() == [0.5, 0.5]
    assert lines.labels.tolist() == [4, 4]
    assert optional.tolist() == [False, False]


def test_less_than_a_pixel_is_no_line() -> None:
    stub = Polylines.from_list([[[199.1, 50], [230, 50]], [[199, 50], [230, 50]], [[7, 7]]])
    lines, _ = visible_lines(stub, SIZE, samples=2)
    assert [vertices.tolist() for vertices in lines] == [[[199, 50], [200, 50]]]


def test_segments_are_lines_of_two_vertices() -> None:
    ends = np.array([[[10, 10], [50, 30]], [[20, 80], [-20, 80.0]]])
    scores, labels = [0.3, 0.9], [1, 2]
    from_segments = visible_lines(Segments(ends, scores, labels), SIZE).lines
    from_polylines = visible_lines(Polylines.from_list(ends, scores, labels), SIZE).lines
    for name in ("vertices", "offsets", "scores", "labels"):
        np.testing.assert_array_equal(getattr(from_segments, name), getattr(from_polylines, name))


def test_points_in_ignored_regions_are_removed() -> None:
    box = curve((24, 0), (200, 0), (200, 100), (24, 100))
    lines = Polylines.from_list(
        [[[0, 5], [100, 5]], [[0, 15], [40, 15]], [[10, 25], [38, 25]], [[50, 5], [90, 60]]],
        [0.4, 0.3, 0.2, 0.1],
    )
    left, optional = visible_lines(lines, SIZE, [box], samples=5)
    assert [vertices[:, 0].tolist() for vertices in left] == [[0], [0, 10, 20], [10, 17]]
    assert optional.tolist() == [True, False, True]  # 1, 3 and 2 of 5 points are left
    half = visible_lines(lines[1:3], SIZE, [curve((20, 0), (60, 0), (60, 99), (20, 99))], samples=4)
    assert half.optional.tolist() == [False, False]  # half of the points are left: not more than half gone
    assert len(visible_lines(lines, SIZE, [box, curve((-1, -1), (30, -1), (30, 99), (-1, 99))]).lines) == 0


@settings(deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9), st.integers(0, 2)), min_size=1, max_size=6),
    st.randoms(use_true_random=False),
)
def test_visible_lines_do_not_depend_on_the_order(ends: list, random: object) -> None:
    def seen(order: list) -> tuple:
        polylines = Polylines.from_list(
            [[[10 * x, 5], [10 * y, 95]] for x, y, _ in order], [score / 2 for *_, score in order]
        )
        lines, optional = visible_lines(polylines, SIZE, [curve((0, 40), (50, 40), (50, 99), (0, 99))])
        return lines.vertices.tolist(), lines.offsets.tolist(), lines.scores.tolist(), optional.tolist()

    before = seen(ends)
    random.shuffle(ends)  # type: ignore[attr-defined]
    assert seen(ends) == before
    assert before[2] == sorted(before[2], reverse=True)


@pytest.mark.parametrize(
    ("lines", "size", "ignore", "message"),
    [
        (Polylines.from_list([[[0, 0], [np.nan, 1]]]), SIZE, [], "coordinate that is NaN"),
        (Polylines.from_list([[[0, 0], [9, 1]]], [np.nan]), SIZE, [], "score that is NaN"),
        (Segments(np.zeros((0, 2, 2))), (0, 5), [], "positive \\(height, width\\)"),
        (Segments(np.zeros((0, 2, 2))), SIZE, [np.zeros((2, 2))], "at least 3 finite corners"),
    ],
)
def test_bad_input_is_refused(lines: Polylines | Segments, size: tuple, ignore: list, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        visible_lines(lines, size, ignore)
