from __future__ import annotations

import numpy as np
import pytest

from yolino.types import Polylines
from yolino.viz import draw_polylines
from yolino.viz.heads import arrow_axes, placed_axes


def star(count: int = 60, radius: float = 60.0) -> Polylines:
    """Gives lines through (500, 500), like those of an intersection."""
    turn = np.arange(count) * 2 * np.pi / count
    way = radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return Polylines.from_list(np.stack([500 - way, 500 + way], axis=1))


def place(lines: Polylines, width: int) -> tuple[np.ndarray, np.ndarray]:
    canvas = np.zeros((1000, 1000, 3), np.uint8)
    return placed_axes(canvas, lines, np.full(len(lines), width))


@pytest.mark.parametrize("width", [1, 3, 6])
def test_heads_keep_two_lengths_from_each_other(width: int) -> None:
    axes, _ = place(star(), width)
    assert len(arrow_axes(star(), width)[0]) >= 60
    assert 1 <= len(axes) < 30
    middles = axes.mean(axis=1)
    lengths = np.linalg.norm(axes[:, 1] - axes[:, 0], axis=1)
    apart = np.linalg.norm(middles[:, None] - middles, axis=2)
    np.fill_diagonal(apart, np.inf)
    assert (apart > 1.5 * lengths[:, None]).all()


def test_heads_of_lanes_side_by_side_move_along_their_lanes() -> None:
    """Heads of 22 px on lanes 14 px apart would lie upon each other in the middle of each stretch."""
    lanes = Polylines.from_list([[[50.0, y], [950.0, y]] for y in 400.0 + 14.0 * np.arange(4)])
    axes, rows = place(lanes, 3)
    assert set(rows.tolist()) == {0, 1, 2, 3}
    np.testing.assert_allclose(axes[:, 0, 1], 400 + 14 * rows)
    assert (axes[:, 1, 0] > axes[:, 0, 0]).all()


def test_heads_that_have_room_stay_where_they_belong() -> None:
    lines = Polylines.from_list([[[50.0, 200.0], [950.0, 200.0]], [[50.0, 600.0], [950.0, 600.0]]])
    np.testing.assert_allclose(place(lines, 3)[0], arrow_axes(lines, 3)[0])


def test_the_better_line_gets_the_room() -> None:
    cross = [[[400.0, 500.0], [600.0, 500.0]], [[400.0, 503.0], [600.0, 503.0]]]
    for scores, winner in (([0.2, 0.9], 1), ([0.9, 0.2], 0)):
        lines = Polylines.from_list(cross, scores)
        axes, rows = place(lines, 3)
        centered = rows[np.abs(axes.mean(axis=1)[:, 0] - 500) < 1]
        assert centered.tolist() == [winner]


def test_heads_outside_of_the_image_take_no_room() -> None:
    outside = Polylines.from_list([[[-900.0, 500.0], [-100.0, 500.0]], [[2000.0, 9.0], [9e5, 9.0]]])
    assert len(place(outside, 3)[0]) == 0
    assert len(place(Polylines.from_list([]), 3)[0]) == 0


def test_an_intersection_is_not_hidden_by_its_heads() -> None:
    """Sixty lines in a square of 120 px, of 3 px: a head of 22 px on each would cover most of it."""
    image, rng = np.zeros((1000, 1000, 3), np.uint8), np.random.default_rng(0)
    lines = Polylines.from_list(440 + 120 * rng.random((60, 2, 2)))
    plain = draw_polylines(image, lines, arrows=False, thickness=3)
    heads = (draw_polylines(image, lines, thickness=3) != plain).any(axis=2)
    assert 0 < heads[440:560, 440:560].mean() < 0.25
