"""The paper's precision, recall and F1: its figure, a literal twin, and what must not matter."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.metrics.points import RADIUS_FRACTIONS, PointMatch, PointMetric, match_points
from yolino.metrics.samples import Samples, sample_lines
from yolino.types import Polylines, Segments

SIZE = (100, 200)
lattice = st.tuples(st.integers(0, 24), st.integers(0, 12))
lattice_lines = st.lists(st.lists(lattice, min_size=2, max_size=4), max_size=6)


def segments(*endpoints: list) -> Segments:
    return Segments(np.array(endpoints, float).reshape(-1, 2, 2))


def horizontal(y: float, start: float = 10.0, end: float = 60.0) -> Polylines:
    return Polylines.from_list([[[start, y], [end, y]]])


def counts(match: PointMatch) -> tuple[int, int, int]:
    return len(match.pairs), len(match.prediction), len(match.truth)


def loop_over_truth(found: Samples, wanted: Samples, radius: float, angle: float, directed: bool) -> set[int]:
    """The definition as a loop over the ground-truth points."""
    chosen = set()
    for point, direction in zip(wanted.points, wanted.angles, strict=True):
        turn = np.abs((found.angles - direction + np.pi) % (2 * np.pi) - np.pi)
        if not directed:
            turn = np.minimum(turn, np.pi - turn)
        distance = np.hypot(*(found.points - point).T)
        distance[turn > angle] = np.inf
        if len(distance) and distance.min() <= radius:
            chosen.add(int(distance.argmin()))
    return chosen


def wild_lines(rng: np.random.Generator, n: int) -> Polylines:
    return Polylines.from_list(rng.uniform(0, 1, (rng.integers(2, 6), 2)) * [200, 100] for _ in range(n))


def test_the_figure_of_the_paper() -> None:
    # One polyline of 14 samples; predictions of 18, of which 8 lie closest to it and point along it.
    truth = Polylines.from_list([[[20, 50], [34, 50]]])
    prediction = segments(
        [[21, 51], [26, 51]],  # 5 beside the start: true
        [[29, 50.5], [32, 50.5]],  # 3 on the line: true
        [[21, 53], [25, 53]],  # 4 beside the first ones but further away: false
        [[30, 49], [30, 46]],  # 3 across the line: false, and in nobody's way
        [[60, 50], [63, 50]],  # 3 far away: false
    )
    match = match_points(prediction, truth, SIZE, radius=2.5)
    assert counts(match) == (8, 18, 14)
    precision, recall = 8 / 18, 8 / 14
    f1 = 2 * precision * recall / (precision + recall)
    assert match.scores() == pytest.approx({"precision": precision, "recall": recall, "f1": f1})
    assert np.flatnonzero(match.true_positives).tolist() == list(range(8))
    assert np.flatnonzero(match.false_positives).tolist() == list(range(8, 18))
    np.testing.assert_array_equal(np.flatnonzero(match.found) + 20, [21, 22, 23, 24, 25, 29, 30, 31])
    assert match.false_negatives.sum() == 6


@pytest.mark.parametrize("directed", [True, False])
@pytest.mark.parametrize("angle", [0.3, math.pi / 4, math.pi])
@pytest.mark.parametrize("radius", [2.0, 4.0, 50.0])
def test_matches_equal_a_loop_over_the_ground_truth(radius: float, angle: float, directed: bool) -> None:
    rng = np.random.default_rng(7)
    for _ in range(5):
        truth, noise = wild_lines(rng, 3), wild_lines(rng, 2)
        moved = truth.with_vertices(truth.vertices + rng.normal(0, 3, truth.vertices.shape))
        prediction = Polylines.from_list([*moved, *noise])
        match = match_points(prediction, truth, SIZE, radius=radius, angle_radius=angle, directed=directed)
        found, wanted = sample_lines(prediction, SIZE), sample_lines(truth, SIZE)
        expected = loop_over_truth(found, wanted, radius, angle, directed)
        assert set(match.pairs[:, 0].tolist()) == expected
        assert match.distances.max(initial=0.0) <= radius


def test_pairs_are_one_to_one_and_the_masks_add_up() -> None:
    rng = np.random.default_rng(3)
    match = match_points(wild_lines(rng, 4), wild_lines(rng, 4), SIZE, radius=10.0)
    assert len(match.pairs) > 50
    for side in (0, 1):
        assert len(set(match.pairs[:, side].tolist())) == len(match.pairs)
    assert match.true_positives.sum() == match.found.sum() == len(match.pairs)
    delta = match.prediction.points[match.pairs[:, 0]] - match.truth.points[match.pairs[:, 1]]
    np.testing.assert_allclose(np.hypot(*delta.T), match.distances)


def test_a_predicted_sample_counts_once() -> None:
    match = match_points(segments([[30, 50], [31, 50]]), segments([[28, 50], [33, 50]]), SIZE, radius=4.0)
    assert counts(match) == (1, 1, 5)
    assert np.flatnonzero(match.found).tolist() == [2]


def test_a_line_predicted_twice_is_half_wrong() -> None:
    truth = horizontal(50)
    twice = Polylines.from_list([*truth, *truth])
    assert match_points(twice, truth, SIZE).scores() == pytest.approx(
        {"precision": 0.5, "recall": 1.0, "f1": 2 / 3}
    )


def test_a_crossing_line_does_not_hide_the_right_one() -> None:
    truth = horizontal(50)
    crossing = Polylines.from_list([[[30.5, 40], [30.5, 60]], [[10, 51], [60, 51]]])
    assert match_points(crossing, truth, SIZE).scores()["recall"] == 1


@pytest.mark.parametrize("shift", [0.25, 0.5, 0.75])
@pytest.mark.parametrize("degrees", range(0, 360, 30))
def test_the_phase_of_the_samples_costs_at_most_the_ends(degrees: int, shift: float) -> None:
    direction = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
    line = np.array([[100.0, 50.0], np.array([100, 50]) + 40 * direction])
    match = match_points(segments(line + shift * direction), segments(line), SIZE)
    assert len(match.pairs) >= 39


def test_the_default_radii_are_a_fiftieth_of_the_width_and_45_degrees() -> None:
    truth = segments([[100, 50], [101, 50]])
    assert match_points(segments([[100, 54], [101, 54]]), truth, SIZE).radius == 4
    for y, tp in ((54, 1), (54.01, 0)):
        assert counts(match_points(segments([[100, y], [101, y]]), truth, SIZE))[0] == tp
    for degrees, tp in ((44.9, 1), (45, 1), (45.1, 0), (-45, 1), (180, 0)):
        half = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))]) / 2
        turned = segments([np.array([100.5, 50]) - half, np.array([100.5, 50]) + half])
        assert counts(match_points(turned, truth, SIZE))[0] == tp


def test_direction_counts_unless_undirected() -> None:
    truth = Polylines.from_list([[[10, 10], [90, 60]], [[150, 90], [150, 5]]])
    reverse = Polylines.from_list([v[::-1] for v in truth])
    assert match_points(reverse, truth, SIZE).scores()["f1"] == 0
    assert match_points(reverse, truth, SIZE, directed=False).scores()["f1"] == 1


def test_segments_and_polylines_may_meet() -> None:
    truth = Polylines.from_list([[[10, 10], [30, 10], [30, 40]]])
    assert match_points(Segments(truth.endpoints), truth, SIZE).scores()["f1"] == 1
    assert match_points(truth, Segments(truth.endpoints), SIZE).scores()["f1"] == 1


def test_ignored_regions_count_on_neither_side() -> None:
    truth, prediction = horizontal(50), horizontal(80)
    box = np.array([[0, 70], [200, 70], [200, 100], [0, 100.0]])
    assert counts(match_points(prediction, truth, SIZE)) == (0, 50, 50)
    assert counts(match_points(prediction, truth, SIZE, [box])) == (0, 0, 50)
    assert counts(match_points(truth, prediction, SIZE, [box])) == (0, 50, 0)
    metric = PointMetric()
    metric.update(horizontal(80), horizontal(80), SIZE, [box])
    assert metric.rows[0, :2].tolist() == [0, 0]


@settings(deadline=None)
@given(lattice_lines, lattice_lines, st.randoms(use_true_random=False), st.booleans())
def test_the_order_of_the_lines_does_not_matter(pred: list, gt: list, random: object, directed: bool) -> None:
    before = match_points(
        Polylines.from_list(pred), Polylines.from_list(gt), SIZE, radius=3.0, directed=directed
    )
    random.shuffle(pred)  # type: ignore[attr-defined]
    random.shuffle(gt)  # type: ignore[attr-defined]
    after = match_points(
        Polylines.from_list(pred), Polylines.from_list(gt), SIZE, radius=3.0, directed=directed
    )
    assert counts(before) == counts(after)
    np.testing.assert_allclose(np.sort(before.distances), np.sort(after.distances), atol=1e-6)


@settings(deadline=None)
@given(st.lists(st.tuples(st.floats(0, 90), st.floats(100, 200), st.floats(-4, 4)), min_size=1, max_size=9))
def test_a_prediction_equal_to_the_labels_is_perfect(lines: list) -> None:
    apart = [[[x0, 10 * i + 5], [x1, 10 * i + 5 + rise]] for i, (x0, x1, rise) in enumerate(lines)]
    polylines = Polylines.from_list(apart)
    scores = match_points(Polylines.from_list(apart[::-1]), polylines, SIZE).scores()
    assert scores == {"precision": 1, "recall": 1, "f1": 1}


@settings(deadline=None)
@given(lattice_lines, lattice_lines)
def test_scores_lie_between_0_and_1(pred: list, gt: list) -> None:
    scores = match_points(Polylines.from_list(pred), Polylines.from_list(gt), SIZE, radius=3.0).scores()
    assert all(0 <= value <= 1 for value in scores.values())


def test_images_are_averaged_by_their_samples() -> None:
    metric = PointMetric()
    metric.update(horizontal(50, 10, 20), horizontal(50, 10, 20), SIZE)
    metric.update(horizontal(80, 10, 40), horizontal(20, 10, 40), SIZE)
    assert metric.compute() == pytest.approx({"precision": 0.25, "recall": 0.25, "f1": 0.25})


def test_settings_reach_the_matching() -> None:
    metric = PointMetric(radius=10.0, angle_radius=math.pi, directed=False, spacing=2.0)
    match = metric.match(horizontal(59), horizontal(50), SIZE)
    assert counts(match) == (25, 25, 25)
    with pytest.raises(ValueError, match="first image"):
        metric.compute()


def test_the_curve_tells_the_scores_at_smaller_radii() -> None:
    metric = PointMetric(radius=10.0)
    metric.update(
        Polylines.from_list([*horizontal(53), *horizontal(88)]),
        Polylines.from_list([*horizontal(50), *horizontal(80)]),
        SIZE,
    )
    curve = metric.curve()
    np.testing.assert_allclose(curve["fraction"], RADIUS_FRACTIONS)
    np.testing.assert_allclose(curve["recall"], [0, 0, 0.5, 0.5, 0.5, 0.5, 0.5, 1, 1, 1])
    assert {name: curve[name][-1] for name in metric.compute()} == metric.compute()
    for i, fraction in enumerate(RADIUS_FRACTIONS):
        smaller = PointMetric(radius=float(10 * fraction))
        smaller.update(horizontal(53), horizontal(50), SIZE)
        alone = PointMetric(radius=10.0)
        alone.update(horizontal(53), horizontal(50), SIZE)
        assert alone.curve()["f1"][i] == smaller.compute()["f1"]


def test_empty_sides_have_defined_scores() -> None:
    nothing, something = Polylines.from_list([]), horizontal(50)
    zero, one = ({"precision": v, "recall": v, "f1": v} for v in (0.0, 1.0))
    assert match_points(nothing, nothing, SIZE).scores() == one
    assert match_points(nothing, something, SIZE).scores() == zero
    assert match_points(something, nothing, SIZE).scores() == zero


def test_an_empty_image_changes_nothing_beside_others() -> None:
    metric = PointMetric()
    nothing = Polylines.from_list([])
    metric.update(horizontal(80), horizontal(50), SIZE)
    metric.update(nothing, nothing, SIZE)
    assert metric.compute()["f1"] == 0


@pytest.mark.parametrize("radius", [0.0, -1.0, math.nan, math.inf])
def test_the_radius_must_be_positive(radius: float) -> None:
    with pytest.raises(ValueError, match="radius must be a positive number of pixels"):
        PointMetric(radius=radius)
    with pytest.raises(ValueError, match="radius must be a positive number of pixels"):
        match_points(horizontal(5), horizontal(5), SIZE, radius=radius)


@pytest.mark.parametrize("angle", [0.0, -1.0, 3.2, 45.0, math.nan])
def test_the_angle_radius_must_be_in_radians(angle: float) -> None:
    with pytest.raises(ValueError, match="radians"):
        PointMetric(angle_radius=angle)
