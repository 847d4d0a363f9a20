from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.postprocess.merging import _halve_angle

COORDINATES = st.floats(-1e200, 1e200).filter(lambda value: value == 0 or abs(value) > 1e-200)


@given(COORDINATES, COORDINATES)
@settings(deadline=None)
def test_half_of_an_angle_is_that_of_trigonometry(dx: float, dy: float) -> None:
    hx, hy = _halve_angle(dx, dy)
    length, wanted = math.hypot(hx, hy), math.atan2(dy, dx) / 2 if (dx, dy) != (0, 0) else 0.0
    assert hx / length == pytest.approx(math.cos(wanted), abs=1e-15)
    assert hy / length == pytest.approx(math.sin(wanted), abs=1e-15)


def test_half_of_a_half_turn_is_a_right_angle() -> None:
    assert _halve_angle(-2.0, 0.0) == (0.0, 1.0)
    assert _halve_angle(-2.0, -0.0) == (0.0, -1.0)
    assert _halve_angle(0.0, 0.0) == (1.0, 0.0)
