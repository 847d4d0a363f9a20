from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.datasets.batch import Batch
from yolino.datasets.faults import NEAR, polyline_findings
from yolino.types import Polylines

LONG = [[0, 0], [30, 0], [60, 30]]


def findings(
    *samples: list[object], size: tuple[int, int] | None = None, directed: bool = True, classes: int = 1
) -> list[tuple[int, str, str]]:
    lines = [Polylines.from_list([np.array(v, float).reshape(-1, 2) for v in some]) for some in samples]
    batch = Batch.of([str(i) for i in range(len(samples))], [size] * len(samples), lines)
    found = list(polyline_findings(batch, classes, directed=directed))
    assert all(finding.sample == str(i) for i, finding in found)
    return [(i, finding.kind, finding.detail) for i, finding in found]


def shifted(line: object, x: float, y: float) -> np.ndarray:
    return np.array(line, float) + np.array([x, y])


def test_polylines_that_are_nearly_the_same_are_found_and_others_are_not():
    middle = [[0, 0], [10, 0], [20, 0], [30, 0], [60, 30]]  # the same way with other vertices
    for again in (shifted(LONG, 0.5, 0.5), middle, shifted(middle, -0.4, 0.3)):
        assert findings([LONG, again]) == [(0, "near duplicate", "polyline 1 follows polyline 0")]
    for other in (shifted(LONG, 0, 2), LONG[:2], [[0, 0], [30, 30], [60, 30]], [[0, 0], [60, 30]]):
        assert findings([LONG, other]) == []


def test_every_stretch_of_both_polylines_counts():
    spike = [[0, 0], [30, 0], [20, 20], [30, 0], [60, 30]]
    bump = [[0, 0], [22, 11], [24, 16], [26, 13], [60, 30]]
    for one, other in ((LONG, spike), ([[0, 0], [60, 30]], bump)):
        for pair in ([one, other], [other, one]):
            assert "near duplicate" not in [kind for _, kind, _ in findings(pair)]


def test_polylines_of_several_samples_are_not_compared():
    assert findings([LONG], [LONG]) == []
    assert findings([], [LONG, shifted(LONG, 0, 9), LONG], []) == [
        (1, "duplicate polyline", "polyline 2 is polyline 0")
    ]


def test_the_direction_counts_where_it_means_something():
    back = LONG[::-1]
    assert findings([LONG, back]) == []
    assert findings([LONG, back], directed=False) == [
        (0, "near duplicate", "polyline 1 runs against polyline 0")
    ]
    ring = [[0, 0], [30, 0], [30, 30], [0, 30], [0, 0]]
    assert findings([ring, ring[::-1]]) == []
    assert findings([ring, ring[::-1]], directed=False)[0][1] == "near duplicate"


def test_each_polyline_is_named_once_beside_the_earliest():
    assert [detail for _, _, detail in findings([LONG, LONG, shifted(LONG, 0.1, 0), LONG])] == [
        "polyline 1 is polyline 0",
        "polyline 2 follows polyline 0",
        "polyline 3 is polyline 0",
    ]


def test_contradicting_classes_are_told():
    lines = Polylines.from_list([LONG, LONG], labels=[0, 1])
    batch = Batch.of(["a"], [None], [lines])
    (found,) = polyline_findings(batch, 2, directed=True)
    assert found[1].detail == "polyline 1 is polyline 0, of another class"


def test_short_polylines_beside_each_other_are_not_nearly_the_same():
    short = [[5, 5], [6, 6]]
    assert findings([short, shifted(short, 0.3, 0.3)]) == []
    assert findings([short, short])[0][1] == "duplicate polyline"


def test_a_polyline_can_have_several_faults():
    line = [[-5, 5], [-5, 5], [9, 5], [9, 9], [5, 0]]
    assert [(kind, detail) for _, kind, detail in findings([LONG, line], size=(40, 70), classes=0)] == [
        ("repeated vertex", "polyline 1: 1 of 5 vertices repeat the one before"),
        ("self-overlap", "polyline 1"),
        ("partly outside", "polyline 1: 2 of 5 vertices"),
    ]


def test_without_a_size_nothing_lies_outside():
    assert findings([[[-5, 5], [-9, 9]]]) == []


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_nothing_else(value):
    line = [[1, 1], [value, 1], [1, 1], [1, 1]]
    assert findings([line, line], size=(40, 70)) == [
        (0, "not finite", "polyline 0"),
        (0, "not finite", "polyline 1"),
    ]


def dense(line: np.ndarray) -> np.ndarray:
    steps = np.linspace(0, 1, 200)[:, None]
    return np.concatenate([a + steps * (b - a) for a, b in pairwise(line)])


def hausdorff(a: np.ndarray, b: np.ndarray) -> float:
    """Of many points of both, the largest distance to the nearest point of the other."""
    gaps = np.linalg.norm(dense(a)[:, None] - dense(b)[None], axis=2)
    return float(max(gaps.min(axis=0).max(), gaps.min(axis=1).max()))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32), st.integers(2, 4), st.floats(0.1, 1.5))
def test_nearness_equals_the_distance_of_many_points(seed, count, noise):
    rng = np.random.default_rng(seed)
    line = rng.uniform(0, 50, (count, 2))
    other = line + rng.uniform(-noise, noise, line.shape)
    distance = hausdorff(line, other)
    if abs(distance - NEAR) > 0.15 and np.linalg.norm(np.diff(line, axis=0), axis=1).sum() > 10:
        kinds = [kind for _, kind, _ in findings([line, other], directed=False) if kind != "self-overlap"]
        assert kinds == (["near duplicate"] if distance < NEAR else [])


def test_huge_coordinates_are_examined_like_others():
    far = [[0, 0], [1e300, 1e300]]
    assert findings([far, far])[0][1] == "duplicate polyline"
    assert findings([[[0, 0], [1e9, 0]], [[0, 0.5], [1e9, 0]]])[0][1] == "near duplicate"
