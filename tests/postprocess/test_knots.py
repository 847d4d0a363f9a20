"""Knots come where the curve is far from the points, as many as the last ones were good for."""

from __future__ import annotations

import numpy as np
import pytest

from yolino.postprocess.knots import choose_number, insert_knot, place_knots, sum_intervals


@pytest.mark.parametrize(
    ("degree", "inner"),
    [(1, [1, 2, 4, 7, 11]), (2, [1.5, 3, 5.5, 9]), (3, [2, 4, 7]), (4, [3, 5.5]), (5, [4])],
)
def test_as_many_coefficients_as_points_leave_out_the_outer_points(degree: int, inner: list[float]) -> None:
    at, knots = np.array([0.0, 1, 2, 4, 7, 11, 16]), np.empty(8 + degree)
    place_knots(at, degree, 7, knots)
    expected = [0.0] * (degree + 1) + inner + [16.0] * (degree + 1)
    np.testing.assert_array_equal(knots, expected)


def test_the_fewest_knots_are_the_ends() -> None:
    knots = np.full(11, -1.0)
    place_knots(np.array([0.0, 1, 2, 4, 7, 11, 16]), 3, 4, knots)
    np.testing.assert_array_equal(knots, [0, 0, 0, 0, 16, 16, 16, 16, -1, -1, -1])


@pytest.mark.parametrize(
    ("last", "excess", "gain", "number"),
    [
        (0, 5.0, 0.0, 1),  # the first
        (1, 9.0, 3.0, 2),  # three would do, but at most twice as many
        (4, 3.0, 2.0, 6),
        (4, 3.0, 2.1, 5),  # 5.7
        (4, 0.1, 2.0, 2),  # at least half as many
        (1, 0.1, 2.0, 1),
        (4, 3.0, 0.005, 8),  # nothing gained
        (4, 3.0, -1.0, 8),
        (4, 0.011, 0.009, 8),  # not 4.9
    ],
)
def test_the_number_follows_what_the_last_ones_gained(
    last: int, excess: float, gain: float, number: int
) -> None:
    assert choose_number(last, excess, gain, 0.01) == number


def test_a_point_at_a_knot_counts_half_on_both_sides() -> None:
    sums = np.full(6, -1.0)
    sum_intervals(np.array([1.0, 2, 4, 8, 16, 32]), np.array([3, 3, 4, 4, 5, 5]), 3, sums)
    np.testing.assert_array_equal(sums, [1 + 2 + 2, 2 + 8 + 8, 8 + 32, 0, 0, 0])


def test_the_worst_interval_is_halved_at_its_middle_point() -> None:
    at = np.array([0.0, 1, 2, 4, 7, 11, 16, 22, 30])
    knots = np.array([0.0, 0, 7, 30, 30, -1, -1, -1, -1, -1, -1])
    inside, sums = np.array([3, 3, 0, 0, 0, 0, 0, 0, 0]), np.array([2.0, 9, 0, 0, 0, 0, 0, 0, 0])
    insert_knot(knots, 3, at, (inside, sums))
    np.testing.assert_array_equal(knots[:6], [0, 0, 7, 16, 30, 30])
    np.testing.assert_array_equal(inside[:3], [3, 1, 1])
    np.testing.assert_array_equal(sums[:3], [2, 3, 3])
    insert_knot(knots, 4, at, (inside, sums))
    np.testing.assert_array_equal(knots[:7], [0, 0, 7, 11, 16, 30, 30])
    np.testing.assert_array_equal(inside[:4], [3, 0, 0, 1])
    np.testing.assert_array_equal(sums[:4], [2, 0, 0, 3])  # the first of the equal ones
    insert_knot(knots, 5, at, (inside, sums))
    insert_knot(knots, 6, at, (inside, sums))
    np.testing.assert_array_equal(knots[:9], [0, 0, 2, 7, 11, 16, 22, 30, 30])
    np.testing.assert_array_equal(inside[:6], [1, 1, 0, 0, 0, 0])


def test_an_interval_without_points_is_not_chosen_however_bad() -> None:
    at, knots = np.array([0.0, 1, 2, 3]), np.array([0.0, 0, 1, 3, 3, -1])
    inside, sums = np.array([0, 1, 0, 0]), np.array([50.0, 1, 0, 0])
    insert_knot(knots, 3, at, (inside, sums))
    np.testing.assert_array_equal(knots, [0, 0, 1, 2, 3, 3])
