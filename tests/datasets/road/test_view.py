from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.datasets.road.view import View, sample_view

FLAT = View(size=(360, 640), scale=0.5, focal=700.0, vanishing=(320.0, 120.0), height=1.5)


def test_a_point_of_the_flat_straight_road_by_hand() -> None:
    # 10 m ahead, 2 m right, on the ground: u = 320 + 700 * 2 / 10, v = 120 + 700 * 1.5 / 10
    assert np.allclose(FLAT.project(np.array([[2.0, 0.0, 10.0]])), [[460.0, 225.0]])
    assert np.allclose(FLAT.project(np.array([[2.0, 1.5, 10.0]])), [[460.0, 120.0]])


def test_curve_and_lateral_position_shift_the_road() -> None:
    view = View((360, 640), 0.5, 700.0, (320.0, 120.0), 1.5, lateral=0.5, curvature=0.01)
    # the axis at 20 m: 0.01 * 20 ** 2 / 2 - 0.5 = 1.5 m to the right of the camera
    assert view.column(0.0, np.array([20.0]))[0] == pytest.approx(320 + 700 * 1.5 / 20)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10_000))
def test_distance_inverts_row(seed: int) -> None:
    view = sample_view(np.random.default_rng(seed), (360, 640), margin=4)
    z = 1 / np.linspace(1 / 2.0, 1 / min(view.farthest * 0.6, 100), 50)
    assert np.allclose(view.distance(view.row(z)), z, rtol=0.01)


def test_a_crest_hides_what_lies_beyond() -> None:
    view = View((360, 640), 0.5, 700.0, (320.0, 120.0), 1.5, bend=-0.002)
    # the line of sight touches the crest where (1.5 + 0.001 z**2) / z is least: z = sqrt(1.5 / 0.001)
    assert view.farthest == pytest.approx(np.sqrt(1500), rel=0.02)
    assert view.top > FLAT.top


def test_ground_rows_are_the_borders_of_rows() -> None:
    first, z = FLAT.ground_rows
    assert len(z) == 360 - first + 1
    assert (np.diff(z) < 0).all()
    assert z[-1] == pytest.approx(700 * 1.5 / 240, rel=1e-3)
