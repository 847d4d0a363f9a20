from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.datasets.road.layout import Boundary, sample_layout
from yolino.datasets.tusimple import CLASSES


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 10_000))
def test_boundaries_are_ordered_and_the_own_lane_is_around_the_axis(seed: int) -> None:
    layout = sample_layout(np.random.default_rng(seed))
    offsets = [b.offset for b in layout.boundaries]
    assert offsets == sorted(offsets)
    assert 2 <= len(offsets) <= 6
    left, right = offsets[layout.own], offsets[layout.own + 1]
    assert abs(left + right) < 1e-9
    assert 2.5 < right - left < 4.8
    assert layout.edges[0] < offsets[0]
    assert layout.edges[1] > offsets[-1]


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 10_000))
def test_the_paint_fits_the_class(seed: int) -> None:
    for boundary in sample_layout(np.random.default_rng(seed)).boundaries:
        name = CLASSES[boundary.label]
        patterns = [stripe.pattern.period for stripe in boundary.stripes]
        if name.startswith("continuous"):
            assert patterns == [0.0]
        if name == "double continuous yellow":
            assert patterns == [0.0, 0.0]
            assert boundary.stripes[0].shift == -boundary.stripes[1].shift
        if "dash" in name:
            assert all(period > 0 for period in patterns)
        if "yellow" in name:
            assert all(stripe.color[0] > stripe.color[2] + 50 for stripe in boundary.stripes)
        if name == "Botts' dots":
            assert all(stripe.raised for stripe in boundary.stripes)


def test_all_classes_appear() -> None:
    layouts = [sample_layout(np.random.default_rng(seed)) for seed in range(150)]
    assert {boundary.label for layout in layouts for boundary in layout.boundaries} == set(
        range(len(CLASSES))
    )


def test_a_taper_leaves_the_offset_smoothly() -> None:
    boundary = Boundary(1.5, 1, (), taper=(10.0, 0.1))
    x = boundary.run(np.array([5.0, 10.0, 25.0, 100.0]))
    assert np.allclose(x, [1.5, 1.5, 1.5 + 0.1 * 225 / 30, 1.5 + 0.1 * 8100 / 105])
