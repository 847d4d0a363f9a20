from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.geometry import distance_to_segments
from yolino.inference.tracking_distance import SAMPLES, compare_polylines, sample_evenly
from yolino.inference.tracking_smoothing import offsets_to
from yolino.types import Polylines


def slow_distance(a: np.ndarray, b: np.ndarray) -> float:
    """The definition, one point after the other."""

    def one_way(points: np.ndarray, line: np.ndarray) -> float:
        endpoints = np.stack([line[:-1], line[1:]], axis=1)
        return float(np.mean([distance_to_segments(point[None], endpoints)[0] for point in points]))

    a, b = sample_evenly(a), sample_evenly(b)
    return (one_way(a, b) + one_way(b, a)) / 2


def test_by_hand() -> None:
    first = Polylines.from_list([[(0, 0), (100, 0)]])
    second = Polylines.from_list(
        [
            [(0, 0), (100, 0)],
            [(0, 3), (100, 3)],
            [(100, 3), (0, 3)],
            [(0, 0), (200, 0)],
            [(50, -50), (50, 50)],
        ]
    )
    distances, agreements = compare_polylines(first, second, 1000.0)
    np.testing.assert_allclose(agreements, [[1, 1, -1, 1, 0]], atol=1e-9)
    np.testing.assert_allclose(distances[0, :3], [0, 3, 3])
    # Half of the longer line lies 0 to 100 pixels away: 25 on average, and 12.5 with the way back.
    assert distances[0, 3] == pytest.approx(12.5, abs=0.5)
    assert distances[0, 4] == pytest.approx(25, abs=1)


def test_what_is_out_of_reach_is_infinitely_far() -> None:
    first = Polylines.from_list([[(0, 0), (100, 0)]])
    second = Polylines.from_list([[(0, 31), (100, 31)], [(0, 29), (100, 29)]])
    distances, _ = compare_polylines(first, second, 30.0)
    np.testing.assert_allclose(distances, [[np.inf, 29]])


@pytest.mark.parametrize(("n", "m"), [(0, 0), (0, 2), (2, 0)])
def test_nothing_to_compare(n: int, m: int) -> None:
    line = [(0, 0), (10, 0)]
    distances, agreements = compare_polylines(
        Polylines.from_list([line] * n), Polylines.from_list([line] * m), 10.0
    )
    assert distances.shape == agreements.shape == (n, m)


def test_more_pairs_than_are_compared_at_once() -> None:
    rng = np.random.default_rng(0)
    lines = Polylines.from_list(list(rng.uniform(0, 100, (15, 4, 2))))
    distances, agreements = compare_polylines(lines, lines, 1e9)
    expected = [[slow_distance(a, b) for b in lines] for a in lines]
    np.testing.assert_allclose(distances, expected, atol=1e-9)
    np.testing.assert_allclose(distances, distances.T)
    np.testing.assert_allclose(agreements, agreements.T)
    np.testing.assert_allclose(np.diag(distances), 0, atol=1e-9)


points = st.integers(-50, 50).map(float)
lines = st.lists(st.tuples(points, points), min_size=2, max_size=5).filter(lambda p: len(set(p)) > 1)


@given(lines, lines)
@settings(max_examples=50, deadline=None)
def test_it_is_what_the_definition_says_and_symmetric(
    a: list[tuple[float, float]], b: list[tuple[float, float]]
) -> None:
    first, second = Polylines.from_list([a]), Polylines.from_list([b])
    (distance,), (agreement,) = (value[0] for value in compare_polylines(first, second, np.inf))
    assert distance == pytest.approx(slow_distance(np.array(a), np.array(b)), abs=1e-9)
    back = compare_polylines(second, first, np.inf)
    assert back[0][0, 0] == pytest.approx(distance)
    assert back[1][0, 0] == pytest.approx(agreement)
    assert -1 - 1e-9 <= agreement <= 1 + 1e-9


def test_even_samples_of_a_line_and_of_a_point() -> None:
    np.testing.assert_allclose(sample_evenly(np.array([[0.0, 0], [2, 0], [4, 0]]), 5)[:, 0], [0, 1, 2, 3, 4])
    assert (sample_evenly(np.array([[3.0, 4.0]])) == (3, 4)).all()
    assert len(sample_evenly(np.array([[3.0, 4.0]]))) == SAMPLES


def test_offsets_by_hand() -> None:
    expected = np.array([[0.0, 0.0], [100.0, 0.0]])
    offsets = offsets_to(np.array([[-50.0, 4.0], [50.0, 4.0], [80.0, 8.0]]), expected)
    np.testing.assert_allclose(offsets.vertices, [(0, -4), (0, -4), (0, -8)], atol=1e-9)
    # The shared part: 50 pixels at 4, then 30 along x that rise from 4 to 8.
    slope = np.hypot(30, 4)
    assert offsets.mean[1] == pytest.approx(-(50 * 4 + slope * 6) / (50 + slope), abs=0.1)
    assert offsets.mean[0] == pytest.approx(0, abs=1e-9)


def test_a_line_beyond_the_end_has_no_offsets() -> None:
    offsets = offsets_to(np.array([[120.0, 4.0], [150.0, 4.0]]), np.array([[0.0, 0.0], [100.0, 0.0]]))
    assert (offsets.vertices == 0).all()
    assert (offsets.mean == 0).all()


def test_a_hairpin_is_not_pulled_to_its_other_branch() -> None:
    hairpin = np.array([[0.0, 0], [100, 0], [100, 10], [0, 10]])
    moved = hairpin + np.array([0, 6])  # nearer to the other branch than to its own
    offsets = offsets_to(moved, hairpin)
    np.testing.assert_allclose(offsets.vertices[:, 1][[0, 3]], -6)
