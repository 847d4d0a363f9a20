"""The paper's precision, recall and F1: its figure, a literal twin, and what must not matter."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.metrics.bootstrap import bootstrap_intervals
from yolino.metrics.points import (
    RADIUS_FRACTIONS,
    SCORE_THRESHOLDS,
    PointMatch,
    PointMetric,
    match_points,
)
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
    chosen, angles = set(), found.angles
    for point, direction in zip(wanted.points, wanted.angles, strict=True):
        turn = np.abs((angles - direction + np.pi) % (2 * np.pi) - np.pi)
        if not directed:
            turn = np.minimum(turn, np.pi - turn)
        distance = np.hypot(*(found.points - point).T)
        distance[turn > angle] = np.inf
        if len(distance) and distance.min() <= radius:
            chosen.add(int(distance.argmin()))
    return chosen


def wild_lines(rng: np.random.Generator, n: int) -> Polylines:
    lines = [rng.uniform(0, 1, (rng.integers(2, 6), 2)) * [200, 100] for _ in range(n)]
    return Polylines.from_list(lines, rng.integers(0, 101, n) / 100, rng.integers(0, 3, n))


def scored(*lines: tuple[float, float]) -> Polylines:
    """Horizontal lines of 50 px, given as y and score."""
    return Polylines.from_list([[[10, y], [60, y]] for y, _ in lines], [score for _, score in lines])


def classed(*lines: tuple[float, float, int]) -> Polylines:
    """Horizontal lines from x = 10, given as y, length and label."""
    vertices = [[[10, y], [10 + length, y]] for y, length, _ in lines]
    return Polylines.from_list(vertices, labels=[label for *_, label in lines])


def of(counts: tuple[int, int, int], ending: str = "") -> dict[str, float]:
    """The scores that belong to numbers of true positives, predicted and ground-truth samples."""
    true_positives, predicted, wanted = counts
    values = [1.0, 1.0, 1.0]
    if predicted + wanted:
        precision = true_positives / predicted if predicted else 0.0
        recall = true_positives / wanted if wanted else 0.0
        both = precision + recall
        values = [precision, recall, 2 * precision * recall / both if both else 0.0]
    return {name + ending: v for name, v in zip(("precision", "recall", "f1"), values, strict=True)}


def count_in_a_loop(prediction: Polylines, truth: Polylines, radius: float) -> tuple[int, int, int]:
    found, wanted = sample_lines(prediction, SIZE), sample_lines(truth, SIZE)
    hits = loop_over_truth(found, wanted, radius, math.pi / 4, True)
    return len(hits), len(found), len(wanted)


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


def test_each_class_is_compared_with_itself() -> None:
    metric = PointMetric(classes=("dashed", "solid", "dots"))
    truth = classed((20, 30, 0), (50, 20, 1))
    # The solid line is found, but called dashed; dots occur nowhere.
    metric.update(classed((20, 30, 0), (51, 20, 0)), truth, SIZE)
    expected = (
        of((50, 50, 50)) | of((30, 50, 30), "_dashed") | of((0, 0, 20), "_solid") | of((0, 0, 0), "_dots")
    )
    assert metric.compute() == pytest.approx(expected)
    assert expected["precision_dashed"] == 0.6
    assert expected["f1_solid"] == 0
    assert expected["f1_dots"] == 1
    # With a second image the samples are added before they are divided.
    metric.update(classed((20, 40, 1), (80, 10, 2)), classed((20, 40, 1)), SIZE)
    expected = of((90, 100, 90)) | of((30, 50, 30), "_dashed") | of((40, 40, 60), "_solid")
    assert metric.compute() == pytest.approx(expected | of((0, 10, 0), "_dots"))


def test_a_line_of_another_class_hides_nothing() -> None:
    metric = PointMetric(classes=("dashed", "solid"))
    metric.update(classed((50, 30, 1), (51, 30, 0)), classed((50, 30, 0)), SIZE)
    assert metric.compute() == pytest.approx(
        of((30, 60, 30)) | of((30, 30, 30), "_dashed") | of((0, 30, 0), "_solid")
    )


def test_the_scores_of_a_class_are_those_of_its_lines_alone() -> None:
    rng = np.random.default_rng(11)
    names = ("a", "b", "c")
    metric, totals = PointMetric(classes=names, radius=6.0), np.zeros((3, 3), np.int64)
    for _ in range(4):
        truth = wild_lines(rng, 5)
        prediction = truth.with_vertices(truth.vertices + rng.normal(0, 3, truth.vertices.shape))
        prediction = Polylines(
            prediction.vertices, prediction.offsets, prediction.scores, rng.integers(0, 3, 5)
        )
        metric.update(prediction, truth, SIZE)
        for label in range(3):
            lines = prediction[prediction.labels == label], truth[truth.labels == label]
            totals[label] += count_in_a_loop(*lines, 6.0)
    assert totals.min() > 0
    scores = metric.compute()
    for name, numbers in zip(names, totals.tolist(), strict=True):
        ours = {key: scores[key] for key in of((0, 0, 0), f"_{name}")}
        assert ours == pytest.approx(of(tuple(numbers), f"_{name}"))


def test_other_names_and_numbers_for_the_classes_change_nothing() -> None:
    rng = np.random.default_rng(12)
    prediction, truth = wild_lines(rng, 6), wild_lines(rng, 6)
    metric, turned = PointMetric(classes=("a", "b", "c")), PointMetric(classes=("c", "a", "b"))
    metric.update(prediction, truth, SIZE)
    sides = (Polylines(s.vertices, s.offsets, labels=(s.labels + 1) % 3) for s in (prediction, truth))
    turned.update(*sides, SIZE)
    assert metric.compute() == turned.compute()
    without = PointMetric()
    without.update(prediction, truth, SIZE)
    assert without.compute().items() <= metric.compute().items()


def test_classes_know_ignored_regions_and_opposite_directions() -> None:
    truth = classed((20, 30, 0), (80, 30, 1))
    reverse = Polylines.from_list([line[::-1] for line in truth], labels=truth.labels)
    box = np.array([[0, 70], [200, 70], [200, 100], [0, 100.0]])
    metric = PointMetric(classes=("a", "b"), directed=False, score_curve=True)
    metric.update(reverse, classed((20, 30, 0)), SIZE, [box])
    scores = metric.compute()
    assert {scores[name] for name in ("f1", "f1_a", "f1_b", "f1_at_0.00", "f1_at_0.95")} == {1}
    directed = PointMetric(classes=("a", "b"))
    directed.update(reverse, truth, SIZE)
    assert directed.compute()["f1_a"] == directed.compute()["f1_b"] == 0


def test_the_score_curve_matches_again_without_the_predictions_below() -> None:
    metric = PointMetric(score_curve=True)
    # The nearer line takes all the samples until it goes; then they are the other one's.
    metric.update(scored((51, 0.3), (53, 0.8)), horizontal(50), SIZE)
    curve = metric.score_curve()
    np.testing.assert_array_equal(curve["threshold"], SCORE_THRESHOLDS)
    np.testing.assert_array_equal(curve["precision"], [0.5] * 7 + [1] * 10 + [0] * 3)
    np.testing.assert_array_equal(curve["recall"], [1] * 17 + [0] * 3)
    np.testing.assert_allclose(curve["f1"], [2 / 3] * 7 + [1] * 10 + [0] * 3)
    scores = metric.compute()
    assert (scores["f1"], scores["f1_at_0.30"], scores["f1_at_0.35"]) == pytest.approx((2 / 3, 2 / 3, 1))
    assert (scores["best_f1"], scores["best_threshold"]) == (1, 0.35)


def test_a_score_of_exactly_the_threshold_is_kept() -> None:
    metric = PointMetric(score_curve=True)
    metric.update(scored(*((5 * i + 2.0, i / 20) for i in range(20))), horizontal(2), SIZE)
    np.testing.assert_array_equal(metric.rows[0, 3:63:3], 50 * np.arange(20, 0, -1))


def test_the_score_curve_is_that_of_the_predictions_above_alone() -> None:
    rng = np.random.default_rng(13)
    metric = PointMetric(radius=6.0, classes=("a", "b", "c"), score_curve=True)
    totals = np.zeros((20, 3), np.int64)
    for _ in range(2):
        truth = wild_lines(rng, 2)
        moved = truth.with_vertices(truth.vertices + rng.normal(0, 3, truth.vertices.shape))
        prediction = Polylines.from_list([*moved, *wild_lines(rng, 4)], rng.integers(0, 101, 6) / 100)
        metric.update(prediction, truth, SIZE)
        for i in range(20):
            above = prediction[prediction.scores >= i / 20]
            totals[i] += count_in_a_loop(above, truth, 6.0)
    curve, scores = metric.score_curve(), metric.compute()
    for i, numbers in enumerate(totals.tolist()):
        expected = of(tuple(numbers))
        assert {name: curve[name][i] for name in expected} == pytest.approx(expected)
        assert {name: scores[f"{name}_at_{i / 20:.2f}"] for name in expected} == pytest.approx(expected)
    assert scores["f1_at_0.00"] == scores["f1"]
    assert scores["best_f1"] == curve["f1"].max()
    assert scores["best_threshold"] == curve["threshold"][curve["f1"].argmax()]


@settings(deadline=None, max_examples=40)
@given(lattice_lines, lattice_lines, st.randoms(use_true_random=False))
def test_the_order_of_the_lines_matters_to_no_class_and_no_threshold(
    pred: list, gt: list, random: object
) -> None:
    results = []
    for _ in range(2):
        metric = PointMetric(radius=3.0, classes=("a", "b"), score_curve=True)
        sides = (
            Polylines.from_list(lines, [len(v) / 5 for v in lines], [len(v) % 2 for v in lines])
            for lines in (pred, gt)
        )
        metric.update(*sides, SIZE)
        results.append(metric.compute())
        random.shuffle(pred)  # type: ignore[attr-defined]
        random.shuffle(gt)  # type: ignore[attr-defined]
    assert results[0] == results[1]


def test_options_leave_the_other_scores_alone() -> None:
    rng = np.random.default_rng(14)
    plain, full = PointMetric(), PointMetric(classes=("a", "b", "c"), score_curve=True)
    for _ in range(3):
        prediction, truth = wild_lines(rng, 5), wild_lines(rng, 5)
        plain.update(prediction, truth, SIZE)
        full.update(prediction, truth, SIZE)
    assert plain.compute().items() <= full.compute().items()
    for name, values in plain.curve().items():
        np.testing.assert_array_equal(values, full.curve()[name])


def test_the_names_of_the_scores_do_not_depend_on_the_images() -> None:
    nothing = Polylines.from_list([])
    names = []
    for prediction in (nothing, classed((20, 30, 1))):
        metric = PointMetric(classes=("a", "b"), score_curve=True)
        metric.update(prediction, nothing, SIZE)
        names.append(list(metric.compute()))
    assert names[0] == names[1]
    assert len(names[0]) == 3 * (1 + 2 + 20) + 2


def test_weights_and_intervals_reach_classes_and_thresholds() -> None:
    rng = np.random.default_rng(15)
    images = [(wild_lines(rng, 4), wild_lines(rng, 4)) for _ in range(3)]

    def scores_of(*chosen: int) -> PointMetric:
        metric = PointMetric(radius=20.0, classes=("a", "b", "c"), score_curve=True)
        for i in chosen:
            metric.update(*images[i], SIZE)
        return metric

    metric = scores_of(0, 1, 2)
    weighted = metric.weighted(np.array([[2.0, 0.0, 1.0], [0.0, 1.0, 0.0]]))
    for row, chosen in enumerate(((0, 0, 2), (1,))):
        expected = scores_of(*chosen).compute()
        assert {name: values[row] for name, values in weighted.items()} == pytest.approx(expected)
    intervals = bootstrap_intervals(metric, np.random.default_rng(0), resamples=50)
    assert set(intervals) == set(metric.compute())
    low, high = intervals["f1_at_0.50"]
    assert 0 <= low < high <= 1


def test_labels_need_a_class_where_there_are_classes() -> None:
    metric = PointMetric(classes=("dashed", "solid"))
    with pytest.raises(ValueError, match=r"truth has the label 2, but labels must be 0 to 1 \(dashed, solid"):
        metric.update(classed((20, 30, 0)), classed((20, 30, 2)), SIZE)
    with pytest.raises(ValueError, match="prediction has the label -1"):
        metric.update(classed((20, 30, -1)), classed((20, 30, 1)), SIZE)
    with pytest.raises(ValueError, match="different names, got solid, solid"):
        PointMetric(classes=("solid", "solid"))
    with pytest.raises(ValueError, match="make it with score_curve=True"):
        metric.score_curve()
    with pytest.raises(ValueError, match="first image"):
        PointMetric(score_curve=True).score_curve()


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
