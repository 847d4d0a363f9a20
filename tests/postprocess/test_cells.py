"""The runs around a cell hold exactly the points in its 3 x 3 cells."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.postprocess.cells import neighborhoods, sort_points, windows


@settings(deadline=None, max_examples=80)
@given(st.integers(0, 10**6), st.integers(1, 80), st.sampled_from([1.0, 5.0, 200.0]))
def test_runs_hold_the_points_in_the_cells_around(seed: int, n: int, extent: float) -> None:
    points = np.random.default_rng(seed).uniform(-extent, extent, (n, 2))
    rows, order, keys, columns = sort_points(points, 1.0)
    np.testing.assert_array_equal(rows, points[order])
    assert sorted(order) == list(range(n))
    assert (np.diff(keys) >= 0).all()
    cells = np.stack(np.divmod(keys, columns), axis=1)
    near = np.abs(cells[:, None] - cells).max(axis=2) <= 1
    later, around = windows(keys, columns), neighborhoods(keys, columns)
    for p in range(n):
        met = [q for run in later[p] for q in range(*run)]
        assert met == [q for q in range(p + 1, n) if near[p, q]]
        assert [q for run in around[p] for q in range(*run)] == np.flatnonzero(near[p]).tolist()
    apart = np.linalg.norm(rows[:, None] - rows, axis=2)
    assert near[apart <= 1.0].all()


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10**6), st.sampled_from([1, 300, 3000]), st.sampled_from([0, 8, 16, 40, 60]))
def test_keys_of_any_size_are_sorted(seed: int, n: int, bits: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.integers(0, 2 ** min(bits // 2, 29) + 1, (n, 2)).astype(float)
    _, order, keys, _ = sort_points(points, 0.9)
    expected = np.sort(keys)
    np.testing.assert_array_equal(keys, expected)
    ties = np.diff(keys) == 0
    assert (np.diff(order)[ties] > 0).all()
