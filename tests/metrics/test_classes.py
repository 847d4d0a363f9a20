"""Classes are compared on the samples that were found."""

from __future__ import annotations

import math

import numpy as np
import pytest

from yolino.metrics.bootstrap import bootstrap_intervals
from yolino.metrics.classes import ClassMetric
from yolino.metrics.samples import sample_lines
from yolino.types import Polylines

SIZE = (100, 200)


def rows(*lines: tuple[float, float, int]) -> Polylines:
    """Horizontal lines from x = 10, given as y, length and label."""
    return Polylines.from_list(
        [[[10, y], [10 + length, y]] for y, length, _ in lines], labels=[label for *_, label in lines]
    )


def test_the_confusion_matrix_counts_found_samples() -> None:
    metric = ClassMetric()
    truth = rows((20, 30, 0), (50, 20, 1), (80, 10, 1))
    prediction = rows((20, 30, 0), (51, 20, 0), (80, 10, 1))
    metric.update(prediction, truth, SIZE)
    np.testing.assert_array_equal(metric.confusion, [[30, 0], [20, 10]])
    np.testing.assert_array_equal(metric.line_confusion, [[1, 0], [1, 1]])
    assert metric.compute() == {"class_accuracy": 40 / 60, "class_accuracy_lines": 2 / 3}


def test_lines_that_are_not_found_do_not_count() -> None:
    metric = ClassMetric()
    metric.update(rows((20, 30, 1), (90, 40, 0)), rows((20, 30, 1), (60, 40, 1)), SIZE)
    assert metric.compute() == {"class_accuracy": 1.0, "class_accuracy_lines": 1.0}
    assert metric.confusion.sum() == 30
    assert metric.line_confusion.sum() == 1


def two_pieces(first: int) -> Polylines:
    """A line from x = 10 to 50 in two pieces of the classes 0 and 1, the first of this length."""
    pieces = [[[10, 20], [10 + first, 20]], [[10 + first, 20], [50, 20]]]
    return Polylines.from_list(pieces, labels=[0, 1])


@pytest.mark.parametrize(("first", "found_as"), [(25, 0), (15, 1), (20, 0)])
def test_a_line_was_found_as_the_class_that_most_of_it_carries(first: int, found_as: int) -> None:
    metric = ClassMetric(("a", "b"))
    metric.update(two_pieces(first), rows((20, 40, 1)), SIZE)
    np.testing.assert_array_equal(metric.confusion, [[0, 0], [first, 40 - first]])
    np.testing.assert_array_equal(metric.line_confusion, [[0, 0], np.eye(2)[found_as]])
    assert metric.compute()["class_accuracy_lines"] == float(found_as == 1)


@pytest.mark.parametrize(("length", "counts"), [(19, 0), (20, 1)])
def test_a_line_counts_once_half_of_it_is_found(length: int, counts: int) -> None:
    metric = ClassMetric(("a", "b"), radius=0.6)
    metric.update(rows((20, length, 0), (70, 40, 0)), rows((20, 40, 0), (70, 40, 0)), SIZE)
    assert metric.line_confusion.sum() == 1 + counts
    assert metric.confusion.sum() == 40 + length


def test_lines_without_samples_do_not_count() -> None:
    metric = ClassMetric(("a", "b"))
    outside = Polylines.from_list([[[10, 20], [50, 20]], [[-50, 20], [-10, 20]], []], labels=[1, 0, 0])
    metric.update(rows((20, 40, 1)), outside, SIZE)
    np.testing.assert_array_equal(metric.line_confusion, [[0, 0], [0, 1]])


def test_the_recall_of_a_class_is_a_row_of_the_matrix() -> None:
    metric = ClassMetric(("a", "b", "c", "d"))
    truth = rows((10, 30, 0), (40, 20, 1), (60, 10, 1), (80, 10, 0))
    metric.update(rows((10, 30, 0), (40, 20, 0), (60, 10, 1), (80, 10, 2)), truth, SIZE)
    scores = metric.compute()
    assert scores["class_recall_a"] == 30 / 40
    assert scores["class_recall_b"] == 10 / 30
    assert scores["class_recall_lines_a"] == scores["class_recall_lines_b"] == 1 / 2
    assert scores["class_recall_c"] == scores["class_recall_lines_c"] == 0.0  # predicted, but never there
    assert scores["class_recall_d"] == scores["class_recall_lines_d"] == 1.0  # on neither side
    intervals = bootstrap_intervals(metric, np.random.default_rng(0), resamples=20)
    assert intervals.keys() == scores.keys()


def test_images_add_up_whatever_classes_they_show() -> None:
    metric = ClassMetric()
    for label, found in ((0, 0), (3, 1), (1, 1)):
        metric.update(rows((20, 10, found)), rows((20, 10, label)), SIZE)
    np.testing.assert_array_equal(metric.confusion.sum(axis=1), [10, 10, 0, 10])
    assert metric.confusion[3, 1] == 10
    assert metric.compute()["class_accuracy"] == pytest.approx(2 / 3)
    low, high = bootstrap_intervals(metric, np.random.default_rng(0), resamples=50)["class_accuracy"]
    assert 0 <= low < 2 / 3 < high <= 1


def test_two_lines_in_the_same_place_are_judged_alike_in_any_order() -> None:
    lines = [(20.0, 30.0, 1), (20.0, 30.0, 0)]
    results = []
    for prediction in (lines, lines[::-1]):
        for truth in (
            [(21.0, 30.0, 1)],
            [(21.0, 30.0, 0), (21.0, 30.0, 1)],
            [(21.0, 30.0, 1), (21.0, 30.0, 0)],
        ):
            metric = ClassMetric(("a", "b"))
            metric.update(rows(*prediction), rows(*truth), SIZE)
            results.append((metric.confusion.tolist(), metric.line_confusion.tolist()))
    assert results[:3] == results[3:]
    assert results[1] == results[2]


def confusions_in_a_loop(
    prediction: Polylines, truth: Polylines, radius: float
) -> tuple[np.ndarray, np.ndarray]:
    """The definition as loops: each ground-truth sample picks a predicted one, which keeps its nearest."""
    found, wanted = sample_lines(prediction, SIZE), sample_lines(truth, SIZE)
    keeper: dict[int, tuple[float, int, int]] = {}
    for i, (point, direction, label) in enumerate(
        zip(wanted.points, wanted.directions, wanted.labels, strict=True)
    ):
        distance = np.hypot(*(found.points - point).T)
        distance[found.directions @ direction < math.cos(math.pi / 4)] = np.inf
        best = int(distance.argmin())
        if distance[best] <= radius:
            keeper[best] = min(keeper.get(best, (math.inf, 0, 0)), (float(distance[best]), int(label), i))
    confusion = np.zeros((3, 3), int)
    for best, (_, label, _) in keeper.items():
        confusion[label, found.labels[best]] += 1
    lines = np.zeros((3, 3), int)
    for line in set(wanted.owners.tolist()):
        votes = [int(found.labels[best]) for best, (_, _, i) in keeper.items() if wanted.owners[i] == line]
        if votes and len(votes) >= (wanted.owners == line).sum() / 2:
            lines[
                wanted.labels[wanted.owners == line][0], min(set(votes), key=lambda v: (-votes.count(v), v))
            ] += 1
    return confusion, lines


def wild(rng: np.random.Generator, n: int) -> Polylines:
    lines = [rng.uniform(0, 1, (3, 2)) * [200, 100] for _ in range(n)]
    return Polylines.from_list(lines, labels=rng.integers(0, 3, n))


def test_the_confusion_matrix_equals_a_loop_over_the_ground_truth() -> None:
    rng = np.random.default_rng(6)
    metric, expected = ClassMetric(("a", "b", "c"), radius=15.0), np.zeros((2, 3, 3), int)
    for _ in range(6):
        prediction, truth = wild(rng, 8), wild(rng, 8)
        metric.update(prediction, truth, SIZE)
        expected += np.stack(confusions_in_a_loop(prediction, truth, 15.0))
    samples, lines = expected
    assert (samples > 0).all()
    assert lines.sum() > 10
    np.testing.assert_array_equal(metric.confusion, samples)
    np.testing.assert_array_equal(metric.line_confusion, lines)
    assert metric.compute()["class_accuracy"] == pytest.approx(samples.trace() / samples.sum())


def test_other_numbers_for_the_classes_turn_the_matrix_only() -> None:
    rng = np.random.default_rng(7)
    prediction, truth = wild(rng, 6), wild(rng, 6)
    new = np.array([2, 0, 1])
    metric, turned = ClassMetric(("a", "b", "c")), ClassMetric(("b", "c", "a"))
    metric.update(prediction, truth, SIZE)
    sides = (Polylines(side.vertices, side.offsets, labels=new[side.labels]) for side in (prediction, truth))
    turned.update(*sides, SIZE)
    assert metric.confusion.sum() > 50
    np.testing.assert_array_equal(turned.confusion[np.ix_(new, new)], metric.confusion)
    assert metric.compute() == turned.compute()


def test_ignored_regions_are_not_in_the_matrix() -> None:
    metric = ClassMetric(("a", "b"))
    box = np.array([[0, 40], [200, 40], [200, 60], [0, 60.0]])
    metric.update(rows((20, 30, 0), (50, 20, 0)), rows((20, 30, 0), (50, 20, 1)), SIZE, [box])
    np.testing.assert_array_equal(metric.confusion, [[30, 0], [0, 0]])


def test_named_classes_fix_the_size_and_the_allowed_labels() -> None:
    metric = ClassMetric(("solid", "dashed", "dots"))
    metric.update(rows((20, 10, 0)), rows((20, 10, 0)), SIZE)
    assert metric.confusion.shape == (3, 3)
    with pytest.raises(
        ValueError, match=r"prediction has the label 3, but labels must be 0 to 2 \(solid, dashed"
    ):
        metric.update(rows((20, 10, 3)), rows((20, 10, 0)), SIZE)
    with pytest.raises(ValueError, match="truth has the label -1, but labels must be 0 or more"):
        ClassMetric().update(rows((20, 10, 0)), rows((20, 10, -1)), SIZE)


def test_settings_reach_the_matching() -> None:
    reverse = Polylines.from_list([[[40, 26], [10, 26]]])
    metric = ClassMetric(radius=8.0, directed=False, spacing=2.0, angle_radius=math.pi / 8)
    metric.update(reverse, rows((20, 30, 0)), SIZE)
    assert metric.confusion.sum() == 15
    with pytest.raises(ValueError, match="radius must be a positive"):
        ClassMetric(radius=-1.0)


def test_without_found_samples_the_accuracy_is_defined() -> None:
    nothing, something = Polylines.from_list([]), rows((20, 30, 1))
    for prediction, truth, expected in (
        (nothing, nothing, 1),
        (nothing, something, 0),
        (something, nothing, 0),
        (rows((80, 30, 1)), something, 0),
    ):
        metric = ClassMetric()
        metric.update(prediction, truth, SIZE)
        assert metric.compute() == {"class_accuracy": expected, "class_accuracy_lines": expected}
