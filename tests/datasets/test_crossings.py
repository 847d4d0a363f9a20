from __future__ import annotations

from fractions import Fraction
from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.datasets.crossings import overlap_themselves
from yolino.types import Polylines


def overlaps(*lines: object) -> list[bool]:
    return overlap_themselves(
        Polylines.from_list([np.array(line, float).reshape(-1, 2) for line in lines])
    ).tolist()


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ([], False),
        ([[1, 1]], False),
        ([[1, 1], [1, 1], [1, 1]], False),
        ([[0, 0], [9, 9]], False),
        ([[0, 0], [5, 5], [9, 9]], False),  # straight on
        ([[0, 0], [5, 0], [5, 5], [2, -3]], True),  # crosses
        ([[0, 0], [5, 0], [5, 5], [2, 0]], True),  # touches
        ([[5, -1], [5, 1], [-9, 1], [-9, 0], [5, 0]], True),  # touches with its last vertex
        ([[5, -1], [5, 1], [-9, 1], [-9, 0], [4, 0]], False),
        ([[0, 0], [5, 0], [5, 5], [2, 1]], False),
        ([[0, 0], [5, 0], [3, 0]], True),  # runs back
        ([[0, 0], [5, 0], [5, 0], [3, 0]], True),  # with a repeated vertex
        ([[0, 0], [5, 0], [5, 3], [9, 3], [9, 0], [4, 0]], True),  # runs over itself later
        ([[0, 0], [5, 0], [5, 5], [0, 0]], False),  # a ring
        ([[0, 0], [5, 0], [5, 5], [5, 5], [0, 0], [0, 0]], False),
        ([[0, 0], [5, 0], [0, 0]], True),  # a ring without inside
        ([[0, 0], [5, 0], [5, 5], [9, 5], [9, 0], [0, 0]], True),  # a ring that folds where it closes
        ([[0, 0], [5, 0], [5, 5], [0, 0], [0, 5]], True),  # through its start, and on
        ([[0, 0], [4, 4], [4, 0], [0, 4], [0, 0]], True),  # an eight
    ],
)
def test_each_case(line, expected):
    assert overlaps(line) == [expected]
    assert overlaps(line[::-1]) == [expected]


def test_polylines_are_told_apart():
    cross, straight, ring = (
        [[0, 0], [5, 0], [5, 5], [2, -3]],
        [[0, 0], [9, 9]],
        [[0, 0], [5, 0], [5, 5], [0, 0]],
    )
    assert overlaps(straight, cross, [], ring, straight, cross) == [False, True, False, False, False, True]
    assert overlaps() == []


def slow(line: list[tuple[int, int]]) -> bool:
    """Looks at all pairs of segments, in fractions."""
    points = [p for i, p in enumerate(line) if i == 0 or p != line[i - 1]]
    pieces = list(pairwise(points))
    closed = len(pieces) > 1 and points[0] == points[-1]
    for i, j in combinations(range(len(pieces)), 2):
        common = shared(pieces[i], pieces[j])
        allowed = {pieces[j][0]} if j == i + 1 else set()
        if closed and i == 0 and j == len(pieces) - 1:
            allowed.add(points[0])
        if common is not None and (common == "many" or common not in allowed):
            return True
    return False


def shared(a, b):
    """Gives the point that two segments have in common, "many", or None."""
    (p, q), (r, s) = a, b
    d, e = (q[0] - p[0], q[1] - p[1]), (s[0] - r[0], s[1] - r[1])
    cross = d[0] * e[1] - d[1] * e[0]
    gap = (r[0] - p[0], r[1] - p[1])
    if cross:
        t = Fraction(gap[0] * e[1] - gap[1] * e[0], cross)
        u = Fraction(gap[0] * d[1] - gap[1] * d[0], cross)
        return (p[0] + t * d[0], p[1] + t * d[1]) if 0 <= t <= 1 and 0 <= u <= 1 else None
    if gap[0] * d[1] - gap[1] * d[0]:
        return None
    length = d[0] ** 2 + d[1] ** 2
    places = sorted(Fraction((x - p[0]) * d[0] + (y - p[1]) * d[1], length) for x, y in (r, s))
    low, high = max(places[0], 0), min(places[1], 1)
    if low > high:
        return None
    return (p[0] + low * d[0], p[1] + low * d[1]) if low == high else "many"


grid = st.integers(0, 6)


@settings(max_examples=200, deadline=None)
@given(st.lists(st.lists(st.tuples(grid, grid), max_size=7), max_size=8))
def test_the_sweep_equals_all_pairs_in_fractions(lines):
    assert overlaps(*lines) == [slow(line) for line in lines]


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32), st.integers(3, 40))
def test_it_does_not_depend_on_the_axis_or_the_place(seed, count):
    line = np.random.default_rng(seed).integers(0, 50, (count, 2)).cumsum(axis=0) % 97
    expected = overlaps(line)
    assert overlaps(line[:, ::-1]) == expected
    assert overlaps(1000 - line) == expected


def test_a_long_spiral_is_quick_and_does_not_meet_itself():
    turn = np.linspace(0, 200, 20_000)
    spiral = (turn[:, None] + 1) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    assert overlaps(spiral) == [False]
    assert overlaps(np.append(spiral, [[0, 0]], axis=0)) == [True]
