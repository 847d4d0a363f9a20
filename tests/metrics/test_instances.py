"""Average precision and F1 of polylines: by hand, against their definition, and what must not matter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise, permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.metrics.bootstrap import bootstrap_intervals
from yolino.metrics.distances import chamfer_distances, frechet_distances, visible_lines
from yolino.metrics.instances import ChamferMetric, FrechetMetric, InstanceMetric, _assign
from yolino.types import Polylines, Segments

SIZE = (100, 200)
NOTHING = Polylines.from_list([])
METRICS = [ChamferMetric, FrechetMetric]

Side = Sequence[tuple]  # (y, score, label) of horizontal lines

each_metric = pytest.mark.parametrize("metric_class", METRICS)
row = st.tuples(st.integers(1, 19), st.integers(0, 3), st.integers(0, 1))
image = st.tuples(st.lists(row, max_size=5), st.lists(row, max_size=4))
box = np.array([[0, 0], [60, 0], [60, 60], [0, 60.0]])


def rows(side: Side, *, start: float = 20.0, end: float = 120.0) -> Polylines:
    """Horizontal lines: their distance is that of their y, for either metric."""
    lines = [[[start, each[0]], [end, each[0]]] for each in side]
    scores = [each[1] if len(each) > 1 else 1.0 for each in side]
    return Polylines.from_list(lines, scores, [each[2] if len(each) > 2 else 0 for each in side])


def mixed(side: Side) -> Polylines:
    """Lines on a lattice, so that distances are often equal, of which many end in `box`."""
    lines = [[[5 * (y % 7), 5 * y], [15 * (y % 4) + 45, 5 * y]] for y, *_ in side]
    return Polylines.from_list(lines, [score / 3 for _, score, _ in side], [label for *_, label in side])


def scores_of(
    metric: InstanceMetric, *images: tuple[Polylines | Segments, Polylines | Segments], ignore: Sequence = ()
) -> dict[str, float]:
    for prediction, truth in images:
        metric.update(prediction, truth, SIZE, ignore)
    return metric.compute()


def literal(metric: InstanceMetric, images: Sequence, ignore: Sequence = ()) -> dict[str, float]:
    """The definition of the average precisions, prediction by prediction and step by step."""
    scores = {}
    for threshold in metric.thresholds or ():
        areas, predicted = [], 0
        for label in range(max(len(metric.classes), 1)):
            labelled, outcomes = 0, []
            for prediction, truth in images:
                found, wanted = (
                    [
                        (lines.scores[i], lines[i : i + 1], optional[i])
                        for i in range(len(lines))
                        if not metric.classes or lines.labels[i] == label
                    ]
                    for lines, optional in (
                        visible_lines(side, SIZE, ignore, samples=metric.samples)
                        for side in (prediction, truth)
                    )
                )
                labelled += sum(not optional for *_, optional in wanted)
                outcomes += literal_outcomes(metric, found, wanted, threshold)
            predicted += len(outcomes)
            if labelled:
                areas.append(literal_area(outcomes, labelled))
        scores[f"ap_{threshold:g}px"] = sum(areas) / len(areas) if areas else float(predicted == 0)
    return scores | {"ap": sum(scores.values()) / len(scores)}


def literal_outcomes(metric: InstanceMetric, found: list, wanted: list, threshold: float) -> list:
    """Score and rightness of each prediction that counts; the best score comes first in `found`."""
    outcomes, taken = [], set()
    for score, line, optional in found:
        distances = [float(metric.distances(line, each, math.inf)[0, 0]) for _, each, _ in wanted]
        nearest = [t for t, distance in enumerate(distances) if distance == min(distances) <= threshold]
        free = [t for t in nearest if not wanted[t][2] and t not in taken]
        if free:
            taken.add(free[0])
            outcomes.append((score, True))
        elif not optional and not any(wanted[t][2] for t in nearest):
            outcomes.append((score, False))
    return outcomes


def literal_area(outcomes: list[tuple[float, bool]], labelled: int) -> float:
    """The area below precision over recall, each precision the best at that recall or a higher one."""
    curve = []
    for score in {score for score, _ in outcomes}:
        above = [right for each, right in outcomes if each >= score]
        curve.append((sum(above) / labelled, sum(above) / len(above)))
    recalls = sorted({0.0, *(recall for recall, _ in curve)})
    return sum(
        (high - low) * max(precision for recall, precision in curve if recall >= high)
        for low, high in pairwise(recalls)
    )


@each_metric
def test_three_predictions_and_two_labels_by_hand(metric_class: type) -> None:
    metric = metric_class(thresholds=[1, 5, 10])
    scores = scores_of(metric, (rows([(13, 0.9), (55, 0.8), (47, 0.7)]), rows([(10,), (40,)])))
    # Within 5: right, wrong (15 away), wrong (7): precision 1 at recall 1/2.
    # Within 10: right, wrong, right: precision 1 at recall 1/2, then 2/3 at recall 1.
    expected = {"ap_1px": 0, "ap_5px": 1 / 2, "ap_10px": 1 / 2 + 1 / 2 * 2 / 3}
    expected["ap"] = sum(expected.values()) / 3
    expected |= {"precision": 1 / 3, "recall": 1 / 2, "f1": 2 / 5}  # at 5 px, the middle one
    assert scores == pytest.approx(expected)
    assert list(scores) == ["ap", "ap_1px", "ap_5px", "ap_10px", "precision", "recall", "f1"]


def test_precision_at_a_recall_is_the_best_at_that_or_a_higher_one() -> None:
    found = rows([(90, 0.9), (10, 0.8), (20, 0.7), (70, 0.6), (30, 0.5)])
    scores = scores_of(ChamferMetric(thresholds=[2]), (found, rows([(10,), (20,), (30,), (40,)])))
    # Precisions 0, 1/2, 2/3, 2/4, 3/5 at recalls 0, 1/4, 2/4, 2/4, 3/4.
    assert scores["ap"] == pytest.approx((2 / 3 + 2 / 3 + 3 / 5) / 4)


def test_equal_scores_are_one_step() -> None:
    truth = rows([(10,), (40,)])
    for order in permutations([(10, 0.5), (70, 0.5), (40, 0.5)]):
        scores = scores_of(ChamferMetric(thresholds=[2]), (rows(order), truth))
        assert scores["ap"] == pytest.approx(2 / 3)  # one point of the curve: 2 of 3 right, all found
    # Also over images: the right one of the second image does not come after the wrong one of the first.
    images = [(rows([(70, 0.5)]), NOTHING), (rows([(10, 0.5)]), rows([(10,)]))]
    for order in (images, images[::-1]):
        assert scores_of(ChamferMetric(thresholds=[2]), *order)["ap"] == 1 / 2


def test_images_are_ranked_together() -> None:
    images = [(rows([(70, 0.6)]), rows([(10,)])), (rows([(10, 0.9)]), rows([(10,)]))]
    assert scores_of(ChamferMetric(thresholds=[2]), *images)["ap"] == 1 / 2
    images = [(rows([(70, 0.95)]), rows([(10,)])), images[1]]
    assert scores_of(ChamferMetric(thresholds=[2]), *images)["ap"] == 1 / 4


@each_metric
def test_a_prediction_whose_nearest_label_is_taken_is_wrong(metric_class: type) -> None:
    truth = rows([(10,), (20,)])
    found = rows([(11, 0.9), (14, 0.8)])  # both nearest to the first
    scores = scores_of(metric_class(thresholds=[8]), (found, truth))
    assert scores["ap"] == 1 / 2
    assert scores["f1"] == 1  # the assignment gives the second label to the second prediction


@each_metric
def test_the_better_score_takes_the_label_not_the_nearer_line(metric_class: type) -> None:
    scores = scores_of(metric_class(thresholds=[8]), (rows([(15, 0.9), (10, 0.8)]), rows([(10,)])))
    assert scores["ap"] == 1
    assert scores["precision"] == 1 / 2


@each_metric
def test_of_equally_near_labels_a_free_one_is_taken(metric_class: type) -> None:
    between = rows([(15, 0.9), (15, 0.8)]), rows([(10,), (20,)])
    twice = rows([(10, 0.9), (10, 0.8)]), rows([(10,), (10,)])
    for images in (between, twice):
        assert scores_of(metric_class(thresholds=[8]), images)["ap"] == 1


@each_metric
def test_thresholds_are_inclusive_and_sorted(metric_class: type) -> None:
    metric = metric_class(thresholds=(8, 4.0))
    scores = scores_of(metric, (rows([(18,)]), rows([(10,)])))
    assert [scores["ap_4px"], scores["ap_8px"], scores["ap"]] == [0, 1, 1 / 2]
    assert scores["f1"] == 0  # of two, the smaller is in the middle


@each_metric
@pytest.mark.parametrize(
    ("width", "hits"), [(200, [1, 1, 1]), (100, [0, 1, 1]), (50, [0, 0, 1]), (40, [0, 0, 0])]
)
def test_the_default_thresholds_follow_the_width(metric_class: type, width: int, hits: list) -> None:
    metric = metric_class()
    metric.update(rows([(12, 0.5)]), rows([(10,)]), (100, width))
    scores = metric.compute()
    assert list(scores)[:4] == ["ap", "ap_1%", "ap_2%", "ap_4%"]
    assert [scores["ap_1%"], scores["ap_2%"], scores["ap_4%"]] == hits
    assert scores["f1"] == hits[1]


def test_direction_counts_for_frechet_unless_undirected() -> None:
    truth = Polylines.from_list([[[10, 10], [90, 60]], [[150, 90], [150, 5]]])
    reverse = Polylines.from_list([vertices[::-1] for vertices in truth])
    assert scores_of(FrechetMetric(), (reverse, truth))["ap"] == 0
    assert scores_of(FrechetMetric(directed=False), (reverse, truth))["ap"] == 1
    assert scores_of(ChamferMetric(), (reverse, truth))["ap"] == 1


def test_each_metric_has_its_distance() -> None:
    rng = np.random.default_rng(0)
    lines = [
        Polylines.from_list([np.cumsum(rng.normal(0, 9, (4, 2)), axis=0) for _ in range(3)]) for _ in "ab"
    ]
    expected = chamfer_distances(*lines)
    np.testing.assert_array_equal(ChamferMetric().distances(*lines, math.inf), expected)
    for directed in (True, False):
        expected = frechet_distances(*lines, directed=directed)
        found = FrechetMetric(directed=directed).distances(*lines, math.inf)
        np.testing.assert_array_equal(found, expected)


def test_samples_reach_the_distance() -> None:
    coarse, fine = FrechetMetric(samples=2, thresholds=[5]), FrechetMetric(thresholds=[5])
    bent = Polylines.from_list([[[20, 10], [70, 60], [120, 10]]])
    assert scores_of(coarse, (bent, rows([(10,)])))["ap"] == 1  # the ends agree
    assert scores_of(fine, (bent, rows([(10,)])))["ap"] == 0


@settings(deadline=None, max_examples=30)
@given(st.lists(image, max_size=3), st.booleans(), st.booleans(), st.booleans())
def test_precisions_equal_the_definition(sides: list, classes: bool, ignored: bool, directed: bool) -> None:
    images = [(mixed(found), mixed(wanted)) for found, wanted in sides]
    ignore, names = [box] if ignored else [], ["solid", "dashed"] if classes else []
    for metric in (
        ChamferMetric(thresholds=[4, 10, 25], classes=names, samples=8),
        FrechetMetric(thresholds=[5, 10, 25], classes=names, samples=8, directed=directed),
    ):
        if images:
            scores = scores_of(metric, *images, ignore=ignore)
            for name, expected in literal(metric, images, ignore).items():
                assert scores[name] == pytest.approx(expected, abs=1e-12)
            assert all(0 <= score <= 1 for score in scores.values())


@settings(deadline=None, max_examples=40)
@given(st.lists(image, min_size=1, max_size=5), st.lists(st.integers(0, 3), min_size=5, max_size=5))
def test_weights_are_how_often_an_image_counts(sides: list, counts: list[int]) -> None:
    counts = counts[: len(sides)]
    options: dict = {"thresholds": [4, 10], "classes": ["solid", "dashed"]}
    metric, repeated = ChamferMetric(**options), ChamferMetric(**options)
    for (found, wanted), many in zip(sides, counts, strict=True):
        metric.update(mixed(found), mixed(wanted), SIZE, [box])
        for _ in range(many):
            repeated.update(mixed(found), mixed(wanted), SIZE, [box])
    weighted = metric.weighted(np.array([counts, [1] * len(sides)], np.float64))
    if len(repeated):
        assert {name: values[0] for name, values in weighted.items()} == pytest.approx(repeated.compute())
    else:
        assert {values[0] for values in weighted.values()} == {1.0}
    assert {name: values[1] for name, values in weighted.items()} == metric.compute()


def test_scores_can_be_bootstrapped() -> None:
    rng = np.random.default_rng(5)
    metric = FrechetMetric(thresholds=[2, 6])
    for _ in range(30):
        y = rng.integers(5, 95, 4)
        found = rows(list(zip(np.clip(y + rng.normal(0, 4, 4), 0, 100), rng.random(4), strict=True)))
        metric.update(found, rows([(each,) for each in y]), SIZE)
    intervals, scores = bootstrap_intervals(metric, np.random.default_rng(0), resamples=250), metric.compute()
    assert intervals.keys() == scores.keys()
    for name, (low, high) in intervals.items():
        assert low < scores[name] < high


@settings(deadline=None, max_examples=40)
@given(st.lists(image, min_size=1, max_size=3), st.randoms(use_true_random=False), st.booleans())
def test_the_order_of_lines_and_images_does_not_matter(sides: list, random: object, classes: bool) -> None:
    def score(order: list) -> list[dict[str, float]]:
        images = [(mixed(found), mixed(wanted)) for found, wanted in order]
        options: dict = {
            "thresholds": [4, 25],
            "classes": ["solid", "dashed"] if classes else [],
            "samples": 9,
        }
        return [scores_of(metric(**options), *images, ignore=[box]) for metric in METRICS]

    before = score(sides)
    for side in (sides, *(lines for pair in sides for lines in pair)):
        random.shuffle(side)  # type: ignore[attr-defined]
    assert score(sides) == before


@settings(deadline=None, max_examples=40)
@given(st.lists(row, min_size=1, max_size=6), st.booleans())
def test_a_prediction_equal_to_the_labels_is_perfect(side: list, ignored: bool) -> None:
    lines = mixed(side)
    for metric in (ChamferMetric(), FrechetMetric(), ChamferMetric(classes=["solid", "dashed"])):
        scores = scores_of(metric, (lines, lines), ignore=[box] if ignored else [])
        assert set(scores.values()) == {1.0}


@settings(deadline=None, max_examples=30)
@given(image, st.sampled_from([0.5, 2.0, 4.0, 16.0]))  # powers of 2 round nothing
def test_scores_do_not_change_with_the_scale_of_the_image(sides: tuple, scale: float) -> None:
    for metric_class in METRICS:
        before, after = metric_class(), metric_class()
        found, wanted = (mixed(side) for side in sides)
        before.update(found, wanted, SIZE, [box])
        found, wanted = (side.with_vertices(scale * side.vertices) for side in (found, wanted))
        after.update(found, wanted, (int(scale * SIZE[0]), int(scale * SIZE[1])), [scale * box])
        assert after.compute() == before.compute()


@each_metric
def test_empty_sides_have_defined_scores(metric_class: type) -> None:
    some = rows([(50, 0.5)])
    for options in ({}, {"classes": ["solid", "dashed"]}):
        assert set(scores_of(metric_class(**options), (NOTHING, NOTHING)).values()) == {1.0}
        assert set(scores_of(metric_class(**options), (NOTHING, some)).values()) == {0.0}
        assert set(scores_of(metric_class(**options), (some, NOTHING)).values()) == {0.0}
        assert set(scores_of(metric_class(**options), (some, rows([(90,)]))).values()) == {0.0}


def test_an_image_without_labels_lowers_the_precision() -> None:
    right = rows([(10, 0.5)]), rows([(10,)])
    scores = scores_of(ChamferMetric(), right, (rows([(10, 0.9)]), NOTHING), (NOTHING, NOTHING))
    assert scores["ap"] == scores["precision"] == 1 / 2
    assert scores["recall"] == 1


def test_classes_are_scored_apart_and_averaged_over_those_labelled() -> None:
    found = rows([(10, 0.9, 1), (20, 0.8, 0), (30, 0.7, 2)])
    truth = rows([(10, 1, 1), (20, 1, 1), (40, 1, 0)])
    metric = ChamferMetric(classes=["solid", "dashed", "double"], thresholds=[2])
    scores = scores_of(metric, (found, truth))
    assert scores["ap"] == pytest.approx(
        (1 / 2 + 0) / 2
    )  # dashed: one of two; solid: none; double: not there
    assert scores["precision"] == scores["recall"] == 1 / 3
    together = scores_of(ChamferMetric(thresholds=[2]), (found, truth))
    assert together["ap"] == pytest.approx(2 / 3)
    assert together["recall"] == 2 / 3
    # A draw without any dashed line averages over the rest.
    metric.update(rows([(40, 0.5, 0)]), rows([(40, 1, 0)]), SIZE)
    assert metric.weighted(np.array([[0.0, 2.0]]))["ap"] == 1


def test_segments_and_polylines_may_meet() -> None:
    lines = rows([(10, 0.9), (40, 0.8)])
    segments = Segments(lines.endpoints, lines.scores)
    for images in ((segments, lines), (lines, segments), (segments, segments)):
        assert scores_of(ChamferMetric(), images)["ap"] == 1


def test_only_what_the_image_shows_is_compared() -> None:
    leaving = Polylines.from_list([[[20, 50], [150, 50], [150, 130], [180, 130], [180, 30]]])
    parts = Polylines.from_list([[[20, 50], [150, 50], [150, 100]], [[180, 100], [180, 30]]], [0.5, 0.4])
    assert scores_of(FrechetMetric(), (parts, leaving))["ap"] == 1
    assert scores_of(FrechetMetric(), (parts[:1], leaving))["recall"] == 1 / 2
    outside = Polylines.from_list([[[20, 150], [150, 150]], [[199.5, 20], [250, 20]], [[50, 50]]])
    assert scores_of(FrechetMetric(), (outside, NOTHING))["ap"] == 1


class TestIgnoredRegions:
    """The lines run from x = 20 to 120; what lies left of some x is ignored."""

    @staticmethod
    def left_of(x: float) -> list[np.ndarray]:
        return [np.array([[0, 0], [x, 0], [x, 100], [0, 100]], np.float64)]

    def test_what_lies_inside_is_not_compared(self) -> None:
        found, truth = rows([(10,)]), Polylines.from_list([[[50, 30], [60, 10], [120, 10]]])
        assert set(scores_of(FrechetMetric(), (found, truth)).values()) == {0.0}
        for metric_class in METRICS:
            scores = scores_of(metric_class(), (found, truth), ignore=self.left_of(60))
            assert set(scores.values()) == {1.0}

    @pytest.mark.parametrize("x", [75, 130])
    def test_what_lies_mostly_inside_is_neither_right_nor_wrong(self, x: float) -> None:
        ignore, optional, required = (
            self.left_of(x),
            rows([(10, 0.9)], end=90),
            rows([(50, 0.5)], start=100, end=200),
        )
        both = Polylines.from_list([*optional, *required], [0.9, 0.5])
        for images in ((both, required), (required, both), (optional, optional), (optional, NOTHING)):
            assert set(scores_of(ChamferMetric(), images, ignore=ignore).values()) == {1.0}
        assert set(scores_of(ChamferMetric(), (NOTHING, optional), ignore=ignore).values()) == {1.0}
        assert scores_of(ChamferMetric(), (both, NOTHING), ignore=ignore)["ap"] == 0

    def test_an_optional_prediction_may_be_right(self) -> None:
        longer, shorter = rows([(10, 0.5)], end=120), rows([(10, 0.5)], end=116)
        ignore = self.left_of(69)  # 51 of 100 are left of the longer one, 49 of the shorter one
        options: dict = {"thresholds": [4]}
        for images in ((shorter, longer), (longer, shorter)):
            scores = scores_of(ChamferMetric(**options), images, ignore=ignore)
            assert set(scores.values()) == {1.0}
        scores = scores_of(ChamferMetric(**options), (longer, rows([(40,)], end=116)), ignore=ignore)
        assert set(scores.values()) == {0.0}

    def test_what_finds_an_optional_label_does_not_count_however_often(self) -> None:
        optional, found = rows([(10,)], end=90), rows([(10, 0.9), (11, 0.8), (30, 0.7)], end=130)
        scores = scores_of(
            ChamferMetric(thresholds=[20]),
            (found, Polylines.from_list([*optional, *rows([(30,)], end=130)])),
            ignore=self.left_of(60),
        )
        assert scores["recall"] == 1
        assert scores["ap"] == scores["precision"] == 1


def test_the_assignment_has_the_most_pairs_and_then_the_least_wrong_predictions() -> None:
    rng = np.random.default_rng(3)
    for _ in range(400):
        p, t = rng.integers(0, 5, 2)
        near = rng.random((p, t)) < 0.4
        optional, optional_truth = rng.random(p) < 0.3, rng.random(t) < 0.4
        uncounted = optional | near[:, optional_truth].any(axis=1)
        required = near[:, ~optional_truth]
        best = (0, -np.count_nonzero(~uncounted))
        slots = [*range(required.shape[1]), *[-1] * p]  # -1: no label
        for slot in set(permutations(slots, int(p))):
            if all(j < 0 or required[i, j] for i, j in enumerate(slot)):
                wrong = sum(j < 0 and not uncounted[i] for i, j in enumerate(slot))
                best = max(best, (sum(j >= 0 for j in slot), -wrong))
        expected = [best[0], best[0] - best[1], required.shape[1]]
        assert _assign(near, optional, optional_truth).tolist() == expected


@pytest.mark.parametrize("thresholds", [[], [0.0], [-1.0], [math.nan], [math.inf, 1.0]])
def test_thresholds_must_be_positive(thresholds: list[float]) -> None:
    with pytest.raises(ValueError, match="thresholds must be positive numbers of pixels"):
        ChamferMetric(thresholds=thresholds)


def test_bad_settings_are_refused() -> None:
    with pytest.raises(ValueError, match="must differ"):
        ChamferMetric(thresholds=[5, 5.0])
    with pytest.raises(ValueError, match="samples must be at least 2"):
        FrechetMetric(samples=1)


@pytest.mark.parametrize("label", [-1, 2])
def test_labels_must_name_a_class(label: int) -> None:
    metric = ChamferMetric(classes=["solid", "dashed"])
    with pytest.raises(ValueError, match=rf"truth has the label {label}, .* 0 to 1 \(solid, dashed\)"):
        metric.update(NOTHING, rows([(10, 1, label)]), SIZE)
    with pytest.raises(ValueError, match="prediction has the label"):
        metric.update(rows([(10, 1, label)]), NOTHING, SIZE)
    assert len(metric) == 0
    if label > 0:
        ChamferMetric().update(rows([(10, 1, label)]), NOTHING, SIZE)


def test_bad_lines_are_refused_and_not_added() -> None:
    metric = ChamferMetric()
    with pytest.raises(ValueError, match="NaN"):
        metric.update(Polylines.from_list([[[0, 0], [math.nan, 5]]]), NOTHING, SIZE)
    with pytest.raises(ValueError, match="score"):
        metric.update(rows([(10, math.nan)]), NOTHING, SIZE)
    with pytest.raises(ValueError, match="corners"):
        metric.update(NOTHING, NOTHING, SIZE, [np.zeros((2, 2))])
    with pytest.raises(ValueError, match="first image"):
        metric.compute()
