from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.header import Header
from yolino.tuning.search import Search, replaced, simplify, smooth
from yolino.tuning.space import Point, Space


def grid(*sizes: int) -> Space:
    """Parameters whose values are 0, 1, 2, ..."""
    names = tuple(f"p{i}" for i in range(len(sizes)))
    return Space(names, tuple(tuple(range(size)) for size in sizes), (0,) * len(sizes), (0,) * len(sizes), {})


def find(
    space: Space, value: Callable[[Point], float], trials: int = 10_000, seed: int = 0
) -> tuple[Point, int]:
    seen: set[Point] = set()

    def counted(point: Point) -> float:
        seen.add(point)
        return value(point)

    search = Search(space, counted, lambda: len(seen), trials, np.random.default_rng(seed))
    return search(space.start), len(seen)


def test_smoothing_by_hand() -> None:
    assert smooth(np.array([0.0, 4.0, 0.0, 0.0])).tolist() == [1.0, 2.0, 1.0, 0.0]
    assert smooth(np.array([3.0])).tolist() == [3.0]


@given(goal=st.tuples(st.integers(0, 6), st.integers(0, 3), st.integers(0, 8)), seed=st.integers(0, 5))
@settings(deadline=None, max_examples=20)
def test_the_top_of_a_hill_is_found(goal: Point, seed: int) -> None:
    space = grid(7, 4, 9)
    known: dict[Point, float] = {}

    def value(point: Point) -> float:
        known[point] = -float(sum(abs(a - b) for a, b in zip(point, goal, strict=True)))
        return known[point]

    found = Search(space, value, lambda: len(known), 999, np.random.default_rng(seed)).descend(space.start)
    assert found == goal


def test_a_plateau_is_better_than_a_peak() -> None:
    curve = [0.0, 1.0, 0.0, 0.0, 0.8, 0.8, 0.8, 0.0]
    assert find(grid(8), lambda p: curve[p[0]])[0] == (5,)


def test_a_second_hill_is_found_from_elsewhere() -> None:
    """Both parameters must move at once: no single one leads from the low hill at 0 to the high one at 7."""

    def value(point: Point) -> float:
        x, y = point
        return max(5.0 - x - y, 10.0 - 3 * abs(x - 6) - 3 * abs(y - 6), -1.0)

    assert find(grid(9, 9), value)[0] == (6, 6)


def test_it_ends_after_the_trials() -> None:
    rng = np.random.default_rng(3)
    noise = rng.random((9, 9, 9))
    _, spent = find(grid(9, 9, 9), lambda p: float(noise[p]), trials=60)
    assert 60 <= spent <= 60 + 3 * 9


def test_the_same_seed_gives_the_same() -> None:
    noise = np.random.default_rng(3).random((9, 9, 9))
    first, again = (find(grid(9, 9, 9), lambda p: float(noise[p]), 80, 4) for _ in range(2))
    assert first == again


def test_what_is_flat_stays_where_it_is() -> None:
    assert find(grid(5, 5), lambda p: 0.5)[0] == (0, 0)


def test_changes_that_give_little_are_taken_back() -> None:
    worth = np.array([0.5, 0.01, 0.2])

    def value(point: Point) -> float:
        return float((worth * np.array(point)).sum())

    best, start = (1, 1, 1), (0, 0, 0)
    assert simplify(best, start, value, lambda one, other: 0.0) == best
    assert simplify(best, start, value, lambda one, other: 0.04) == (1, 0, 1)
    assert simplify(best, start, value, lambda one, other: 0.15) == (1, 0, 0)
    assert simplify(best, start, value, lambda one, other: 1.0) == start


def test_a_change_that_costs_is_taken_back_without_any_error() -> None:
    assert simplify((1, 1), (0, 0), lambda p: float(p[0] - p[1]), lambda one, other: 0.0) == (1, 0)


def test_one_value_is_replaced() -> None:
    assert replaced((1, 2, 3), 1, 9) == (1, 9, 3)


def test_spaces_of_models_are_searched(header: Header) -> None:
    from yolino.tuning.space import build_space

    space = build_space(replace(header, postprocess={"threshold": 0.3}), only=("threshold",))
    found, _ = find(space, lambda p: -abs(space.setting(p)["threshold"] - 0.6))
    assert space.setting(found)["threshold"] == pytest.approx(0.6)
