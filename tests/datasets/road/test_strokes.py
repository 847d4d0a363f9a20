from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from yolino.datasets.road.layout import Pattern, Stripe
from yolino.datasets.road.strokes import paint_dots, paint_stripe
from yolino.datasets.road.view import View

VIEW = View((360, 640), 0.5, 700.0, (320.0, 120.0), 1.5, curvature=0.002)
WHITE = (255.0, 255.0, 255.0)


def canvas() -> np.ndarray:
    return np.zeros((*VIEW.size, 3), np.uint8)


def at(x: float):  # type: ignore[no-untyped-def]
    return lambda z: np.full_like(z, x)


@pytest.mark.parametrize("x", [-5.4, -1.8, 0.3, 1.8, 5.4])
def test_the_stripe_lies_where_the_road_is_projected(x: float) -> None:
    image = canvas()
    paint_stripe(image, VIEW, Stripe(0.15, WHITE, opacity=1.0), at(x))
    light = image[..., 0].astype(float)
    for row in range(180, 355, 5):
        if light[row, 0] > 0 or light[row, -1] > 0 or light[row].sum() == 0:
            continue
        middle = (light[row] * (np.arange(640) + 0.5)).sum() / light[row].sum()
        z = VIEW.distance(np.array([row + 0.5]))
        assert middle == pytest.approx(VIEW.column(x, z)[0], abs=0.3)


def test_the_stripe_covers_its_width_on_average_near_and_far() -> None:
    image = canvas()
    paint_stripe(image, VIEW, Stripe(0.15, WHITE, opacity=1.0), at(0.5))
    for row in (130, 150, 200, 300):
        z = VIEW.distance(np.array([row + 0.5]))[0]
        assert image[row, :, 0].sum() / 255 == pytest.approx(700 * 0.15 / z, rel=0.06)


def test_painted_length_by_hand() -> None:
    pattern = Pattern(10.0, ((1.0, 4.0), (6.0, 7.0)))
    z = np.array([0.0, 1.0, 2.5, 4.0, 5.0, 6.5, 10.0, 12.0])
    assert np.allclose(pattern.painted(z), [0, 0, 1.5, 3, 3, 3.5, 4, 5])
    assert np.allclose(np.diff(replace(pattern, phase=3.0).painted(np.array([4.0, 7.0]))), [3.0])


def test_dashes_are_painted_where_the_pattern_says() -> None:
    image = canvas()
    paint_stripe(image, VIEW, Stripe(0.15, WHITE, pattern=Pattern(12.0, ((6.0, 9.0),)), opacity=1.0), at(0.0))
    lit = image[..., 0].max(axis=1) > 60
    z = VIEW.distance(np.arange(360) + 0.5)
    assert lit[(z > 6.3) & (z < 8.7)].all()
    assert not lit[(z > 9.4) & (z < 17.0)].any()


def test_dots_lie_on_their_line() -> None:
    image = canvas()
    dots = Stripe(0.12, WHITE, pattern=Pattern(4.0, ((1.0, 1.12),)), opacity=1.0, raised=True)
    paint_dots(image, VIEW, dots, at(1.0), sun=0.0)
    for z in (5.06, 9.06, 13.06):
        u, v = VIEW.project(np.array([[1.0, 0.0, z]]))[0]
        part = image[int(v) - 3 : int(v) + 3, int(u) - 3 : int(u) + 3]
        assert part.max() > 150


def test_wear_takes_paint_away() -> None:
    good, worn = canvas(), canvas()
    paint_stripe(good, VIEW, Stripe(0.15, WHITE), at(0.0))
    paint_stripe(worn, VIEW, Stripe(0.15, WHITE, wear=0.8), at(0.0))
    assert worn.sum() < 0.8 * good.sum()
