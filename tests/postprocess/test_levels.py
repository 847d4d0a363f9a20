"""Upper ends at one height: hand-computed roads, and what may never change."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yolino.postprocess import ChainLinker
from yolino.postprocess.levels import level_ends
from yolino.types import Segments

CELL = 16.0
Lines = list[np.ndarray]


def level(lines: Lines, reach: float, shortest: float = 0.0) -> Lines:
    """Gives the lines with leveled ends, one array each."""
    offsets = np.cumsum([0, *map(len, lines)])
    vertices, bounds = level_ends(np.concatenate(lines), offsets, reach, shortest, CELL)
    assert bounds[-1] == len(vertices)
    return np.split(vertices, bounds[1:-1])


def straight(x: float, bottom: float, top: float, lean: float = 0.0) -> np.ndarray:
    """Gives a line that goes up to y = top, with a vertex each 8 px and x moving by `lean` per px."""
    y = np.append(np.arange(bottom, top, -8.0), top)
    return np.stack([x + lean * (bottom - y), y], axis=1)


def test_ends_come_to_their_median() -> None:
    """Tops at 84, 100 and 118: the first is cut at 100, the last goes on with its own slope."""
    lines = [straight(90, 300, 84, 0.5), straight(200, 300, 100), straight(400, 300, 118, -1.5)]
    for turn in (1, -1):
        found = level([line[::turn] for line in lines], 20.0)
        tops = [line[-1] if turn > 0 else line[0] for line in found]
        np.testing.assert_allclose(tops, [(190, 100), (200, 100), (400 - 1.5 * 200, 100)])
        np.testing.assert_array_equal(found[1][::turn], lines[1])
        np.testing.assert_array_equal(found[2][::turn][:-1], lines[2])
        np.testing.assert_array_equal(found[0][::turn][:-1], lines[0][lines[0][:, 1] > 100])


def test_two_lines_meet_in_the_middle_if_that_is_near() -> None:
    lines = [straight(0, 300, 80), straight(90, 300, 110)]
    for reach, tops in ((30.0, [95.0, 95.0]), (29.0, [80.0, 110.0])):
        assert [line[-1, 1] for line in level(lines, reach)] == tops


@pytest.mark.parametrize(
    "other",
    [
        straight(0, 300, 139),  # farther away than the reach
        straight(0, 300, 61),
        np.array([(0.0, 119.0), (80.0, 109.5)]),  # so flat that it would go on for 80 px
        np.array([(120.0, 99.0), (150.0, 90.0)]),  # nothing of it lies below
        straight(420, 300, 119, 0.5),  # would go on where no line has been
        np.array([(0.0, 130.0), (9.0, 90.0), (9.0, 130.0), (0.0, 130.0)]),  # closed
        np.array([(0.0, 110.0), (60.0, 110.0)]),  # has no upper end
    ],
)
def test_some_lines_stay_as_they_are(other: np.ndarray) -> None:
    road = [straight(x, 300, 100) for x in (100.0, 200.0, 300.0)]
    found = level([*road, other], 38.0)
    np.testing.assert_array_equal(np.concatenate(found), np.concatenate([*road, other]))


def test_of_a_line_along_the_row_no_stub_is_left() -> None:
    road = [straight(x, 300, 112) for x in (100.0, 200.0, 300.0)]
    flat = np.stack([np.linspace(112, 272, 11), np.linspace(112.4, 92.4, 11)], axis=1)
    for line in (flat, flat[::-1]):
        (*_, cut) = level([*road, line], 32.0, shortest=3.0)
        assert np.linalg.norm(cut[0] - cut[-1]) == pytest.approx(np.hypot(3.2, 0.4))
        (*_, found) = level([*road, line], 32.0, shortest=4.0)
        np.testing.assert_array_equal(found, line)


def test_one_line_stays_as_it_is() -> None:
    np.testing.assert_array_equal(level([straight(5, 90, 31)], 100.0)[0], straight(5, 90, 31))


roads = st.lists(
    st.tuples(st.integers(0, 640), st.integers(60, 140), st.floats(-2, 2), st.booleans()),
    min_size=1,
    max_size=7,
)


@given(roads, st.floats(0, 60))
def test_only_upper_ends_move_and_only_within_the_reach(
    road: list[tuple[int, int, float, bool]], reach: float
) -> None:
    lines = [straight(x, 300, top, lean)[:: -1 if turned else 1] for x, top, lean, turned in road]
    tops = sorted(top for _, top, _, _ in road)
    row, middle = np.median(tops), (tops[(len(tops) - 1) // 2], tops[len(tops) // 2])
    every = np.concatenate(lines)[:, 0]
    for (x, top, lean, turned), given_line, new in zip(road, lines, level(lines, reach), strict=True):
        turn = -1 if turned else 1
        line, found = given_line[::turn], new[::turn]
        np.testing.assert_array_equal(found[0], line[0])
        inside = every.min() - 1e-6 <= x + lean * (300 - row) <= every.max() + 1e-6
        near = abs(top - row) <= reach and middle[1] - middle[0] <= reach
        assert found[-1, 1] == (row if near and inside else top)
        assert (np.diff(found[:, 1]) < 0).all()
        shared = min(len(found), len(line)) - 1
        np.testing.assert_array_equal(found[:shared], line[:shared])


def test_the_linker_levels_ends_in_cells(
    chain: Callable[..., Segments], join: Callable[..., Segments]
) -> None:
    parts = [
        chain([(x, 320.0 - CELL * i) for i in range(count)])
        for x, count in ((50.0, 12), (150.0, 13), (250.0, 14))
    ]
    for cells, tops in ((0.0, [112, 128, 144]), (0.9, [112, 128, 144]), (1.1, [128, 128, 128])):
        lines = ChainLinker(CELL, level_ends_cells=cells)(join(*parts))
        assert sorted(line[:, 1].min() for line in lines) == pytest.approx(tops)
        assert lines.scores == pytest.approx([1.0, 1.0, 1.0])
