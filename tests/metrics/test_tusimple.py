"""The official TuSimple arithmetic: cases computed by hand, and a twin on scikit-learn's regression."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import numpy as np
import pytest
from sklearn.linear_model import LinearRegression

from yolino.metrics.tusimple import TuSimpleMetric, lanes_at_rows, score_files, score_image
from yolino.types import Polylines, Segments

ROWS = list(range(160, 360, 10))
DATA = Path(os.environ.get("YOLINO_DATA", Path(__file__).parents[2] / "../shared/data")) / "tusimple"


def vertical(x: float) -> list[float]:
    return [x] * len(ROWS)


def slanted(x: float, slope: float = 1.0) -> list[float]:
    return [x + slope * (y - 160) for y in ROWS]


def shifted(lane: list[float], by: float, rows: int) -> list[float]:
    """The lane with its first rows moved."""
    return [x + by if i < rows else x for i, x in enumerate(lane)]


def test_a_perfect_prediction() -> None:
    lanes = [vertical(100), slanted(300), slanted(900, -2)]
    assert score_image(lanes[::-1], lanes, ROWS) == (1, 0, 0, 0)


@pytest.mark.parametrize(("by", "accuracy"), [(19.9, 1.0), (-19.9, 1.0), (20.0, 0.75), (-20.0, 0.75)])
def test_an_x_is_right_below_twenty_pixels(by: float, accuracy: float) -> None:
    assert score_image([shifted(vertical(300), by, 5)], [vertical(300)], ROWS).accuracy == accuracy


@pytest.mark.parametrize("slope", [1.0, -1.0, 0.5, 3.0])
def test_slanted_lanes_have_a_wider_threshold(slope: float) -> None:
    limit = 20 * math.hypot(1, slope)
    lane = slanted(600, slope)
    if slope == 1:
        assert limit == pytest.approx(28.2842712)
    assert score_image([shifted(lane, limit - 0.01, 5)], [lane], ROWS).accuracy == 1
    assert score_image([shifted(lane, limit + 0.01, 5)], [lane], ROWS).accuracy == 0.75


def test_the_angle_is_that_of_the_labelled_points_alone() -> None:
    lane = slanted(200)
    lane[:10] = [-2] * 10
    prediction = shifted(lane[::-1], 28.0, 5)[::-1]
    assert score_image([prediction], [lane], ROWS).accuracy == 1
    single = [-2.0] * 19 + [500]
    assert score_image([[-2.0] * 19 + [519.9]], [single], ROWS).accuracy == 1
    assert score_image([[-2.0] * 19 + [520.1]], [single], ROWS).accuracy == 0.95


def test_no_lane_here_agrees_with_no_lane_here() -> None:
    lane = [-2] * 15 + [300] * 5
    assert score_image([[-2] * 20], [lane], ROWS) == (0.75, 1, 1, 1)
    # Any negative number says the same, and is not a column near 0.
    assert score_image([[-30] * 15 + [300] * 5], [lane], ROWS).accuracy == 1
    assert score_image([[5] * 15 + [300] * 5], [lane], ROWS).accuracy == 0.25


@pytest.mark.parametrize(("wrong", "fp", "fn"), [(3, 0, 0), (4, 1, 1)])
def test_a_lane_is_matched_from_85_percent_on(wrong: int, fp: float, fn: float) -> None:
    score = score_image([shifted(vertical(300), 50, wrong)], [vertical(300)], ROWS)
    assert score == (1 - wrong / 20, fp, fn, fn)


def test_the_best_prediction_counts_and_unmatched_ones_are_false() -> None:
    truth = [vertical(100), vertical(400)]
    predictions = [shifted(vertical(100), 50, 4), shifted(vertical(100), 50, 2), vertical(700)]
    # Accuracies .9 and 0; one of two labels matched, two of three predictions not.
    assert score_image(predictions, truth, ROWS) == pytest.approx((0.45, 2 / 3, 0.5, 0.5))


def test_a_fifth_lane_is_forgiven() -> None:
    truth = [vertical(x) for x in (100, 300, 500, 700, 900)]
    assert score_image(truth, truth, ROWS) == (1, 0, 0, 0)
    assert score_image(truth[:4], truth, ROWS) == (1, 0, 0, 0.2)
    assert score_image(truth[:3], truth, ROWS) == (0.75, 0, 0.25, 0.4)
    # The worst lane goes, also where it is matched: 1 + 1 + 1 + .95 of four.
    worse = [*truth[:3], shifted(truth[3], 50, 1), shifted(truth[4], 50, 2)]
    assert score_image(worse, truth, ROWS) == pytest.approx((3.95 / 4, 0, 0, 0))


def test_of_four_lanes_none_is_forgiven() -> None:
    truth = [vertical(x) for x in (100, 300, 500, 700)]
    assert score_image(truth[:3], truth, ROWS) == (0.75, 0, 0.25, 0.25)


def test_more_than_two_lanes_too_many_are_worth_nothing() -> None:
    truth = [vertical(100)]
    predictions = [vertical(x) for x in (100, 300, 500, 700)]
    assert score_image(predictions[:3], truth, ROWS) == pytest.approx((1, 2 / 3, 0, 0))
    assert score_image(predictions, truth, ROWS) == (0, 0, 1, 1)


def test_more_than_200_ms_are_worth_nothing() -> None:
    truth = [vertical(100)]
    assert score_image(truth, truth, ROWS, 200.0) == (1, 0, 0, 0)
    assert score_image(truth, truth, ROWS, 200.1) == (0, 0, 1, 1)


def test_one_prediction_for_two_labels_makes_fp_negative_as_in_the_benchmark() -> None:
    assert score_image([vertical(100)], [vertical(95), vertical(105)], ROWS) == (1, -1, 0, 0)


def test_empty_sides_have_defined_scores() -> None:
    lane = [vertical(100)]
    assert score_image([], [], ROWS) == (0, 0, 0, 0)
    assert score_image([], lane, ROWS) == (0, 0, 1, 1)
    assert score_image(lane, [], ROWS) == (0, 1, 0, 0)
    assert score_image(lane * 3, [], ROWS) == (0, 0, 1, 1)


def with_scikit_learn(pred: np.ndarray, gt: np.ndarray, rows: np.ndarray) -> tuple[float, float, float]:
    if len(pred) > len(gt) + 2:
        return 0, 0, 1
    accuracies = []
    for lane in gt:
        there, slope = lane >= 0, 0.0
        if there.sum() >= 2:
            slope = LinearRegression().fit(rows[there].reshape(-1, 1), lane[there]).coef_[0]
        limit, best = 20 / math.cos(math.atan(slope)), 0.0
        for guess in pred:
            right = 0
            for a, b in zip(guess, lane, strict=True):
                right += abs((a if a >= 0 else -100) - (b if b >= 0 else -100)) < limit
            best = max(best, right / len(rows))
        accuracies.append(best)
    missed = sum(a < 0.85 for a in accuracies)
    fp = (len(pred) - (len(gt) - missed)) / len(pred) if len(pred) else 0
    total, lanes = sum(accuracies), min(len(gt), 4) or 1
    if len(gt) > 4:
        total, missed = total - min(accuracies), max(missed - 1, 0)
    return total / lanes, fp, missed / lanes


def test_scores_equal_a_loop_with_scikit_learns_regression() -> None:
    rng = np.random.default_rng(11)
    rows = np.arange(160.0, 720, 10)
    for _ in range(150):
        gt = rng.uniform(0, 1280, (rng.integers(0, 7), 1)) + rng.normal(0, 1, (1, 1)) * (rows - 160)
        gt = np.where((rows < rng.integers(150, 400)) | (gt > 1280), -2, gt.round())
        some = rng.permutation(len(gt))[: rng.integers(0, len(gt) + 1)]
        pred = np.concatenate(
            [gt[some] + rng.normal(0, 12, (len(some), len(rows))), gt[:0], -gt[: rng.integers(0, 4)]]
        )
        expected = with_scikit_learn(pred, gt, rows)
        assert score_image(pred, gt, rows)[:3] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("pred", "gt", "rows", "message"),
    [
        ([], [], [], "at least one row"),
        ([[1.0, 2.0]], [], [160], "predicted lane 0 has 2 values, but there are 1 rows"),
        ([], [[1.0], [1.0, 2.0]], [160], "labelled lane 1 has 2 values"),
        ([[math.nan]], [], [160], "predicted lane 0 has a value that is NaN"),
        ([], [[math.inf]], [160], "labelled lane 0 has a value that is NaN or infinite"),
    ],
)
def test_bad_lanes_are_named(pred: list, gt: list, rows: list, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        score_image(pred, gt, rows)


def lines(path: Path, *records: object) -> Path:
    path.write_text("".join(f"{r if isinstance(r, str) else json.dumps(r)}\n" for r in records))
    return path


def label(name: str, *lanes: list, rows: list | None = None) -> dict:
    return {"raw_file": name, "lanes": list(lanes), "h_samples": rows or ROWS}


def guess(name: str, *lanes: list, run_time: float = 10) -> dict:
    return {"raw_file": name, "lanes": list(lanes), "run_time": run_time}


def test_files_are_averaged_over_the_labelled_images_in_any_order(tmp_path: Path) -> None:
    labels = lines(tmp_path / "labels.json", label("a", vertical(9)), "", label("b", [7, 7], rows=[1, 2]))
    predictions = lines(tmp_path / "pred.json", guess("b", [7, 99]), guess("a", vertical(9), vertical(400)))
    assert score_files(predictions, labels) == pytest.approx(
        {"accuracy": 0.75, "fp": 0.75, "fn": 0.5, "fn_strict": 0.5}
    )
    slow = lines(tmp_path / "slow.json", guess("b", [7, 7], run_time=201), guess("a", vertical(9)))
    assert score_files(slow, labels)["accuracy"] == 0.5


@pytest.mark.parametrize(
    ("predictions", "message"),
    [
        ([guess("a"), "{oops"], "pred.json, line 2 is not valid JSON"),
        ([guess("a"), "", "[1]"], "pred.json, line 3 must be a JSON object with raw_file, lanes, run_time"),
        ([{"lanes": [], "run_time": 1}], "line 1 must be a JSON object with raw_file"),
        ([{"raw_file": "a", "lanes": []}], "line 1 must be a JSON object with .*run_time"),
        ([{"raw_file": 7, "lanes": [], "run_time": 1}], "raw_file 7, but the name of an image"),
        ([{"raw_file": "a", "lanes": [3], "run_time": 1}], "lanes that are not a list of lists"),
        ([{"raw_file": "a", "lanes": [], "run_time": [1]}], r"run_time \[1\], but a number of milliseconds"),
        ([guess("a"), guess("a")], "line 2 repeats 'a' of .*line 1"),
        ([guess("a")], "lacks 1 of the 2 images .* first 'b'"),
        (
            [guess("a"), guess("b"), guess("c")],
            "line 3 predicts 'c', which .* does not label: 1 too many",
        ),
        ([guess("a", [1]), guess("b")], r"line 1 \(a\), labelled in .*: The predicted lane 0 has 1 values"),
        ([guess("a", ["x"] * 20), guess("b")], r"line 1 \(a\), labelled"),
        ([], "has no records"),
    ],
)
def test_bad_prediction_files_are_explained(tmp_path: Path, predictions: list, message: str) -> None:
    labels = lines(tmp_path / "labels.json", label("a", vertical(9)), label("b", vertical(9)))
    with pytest.raises(ValueError, match=message):
        score_files(lines(tmp_path / "pred.json", *predictions), labels)


def test_missing_files_are_named(tmp_path: Path) -> None:
    labels = lines(tmp_path / "labels.json", label("a"))
    with pytest.raises(FileNotFoundError, match=r"no file .*nowhere\.json"):
        score_files(tmp_path / "nowhere.json", labels)
    with pytest.raises(FileNotFoundError, match=r"no file .*nowhere\.json"):
        score_files(labels, tmp_path / "nowhere.json")


def test_undecodable_files_are_explained(tmp_path: Path) -> None:
    labels = lines(tmp_path / "labels.json", label("a"))
    (tmp_path / "image.json").write_bytes(b"\xff\xd8\xff\xe0")
    with pytest.raises(ValueError, match=r"image\.json, line 1 is not valid JSON"):
        score_files(tmp_path / "image.json", labels)


def polylines_of(lanes: list, rows: list) -> Polylines:
    """Lanes as the reader gives them: pixel centers, bottom to top."""
    return Polylines.from_list(
        [[x + 0.5, y + 0.5] for x, y in zip(lane[::-1], rows[::-1], strict=True) if x >= 0] for lane in lanes
    )


def test_polylines_meet_the_rows_of_the_benchmark() -> None:
    rows = list(range(160, 720, 10))
    lanes = [[-2] * 9 + [300.0 + 7 * i for i in range(47)], [900.0 - 5 * i for i in range(56)]]
    polylines = polylines_of(lanes, rows)
    np.testing.assert_allclose(lanes_at_rows(polylines, np.array(rows, float), (720, 1280)), lanes)
    metric = TuSimpleMetric()
    metric.update(polylines, polylines, (720, 1280))
    assert metric.compute() == {"accuracy": 1, "fp": 0, "fn": 0, "fn_strict": 0}


@pytest.mark.parametrize(("rows", "accuracy"), [(None, 0.5), ([300.0, 310.0], 1.0), ([100.0, 300.0], 0.5)])
def test_rows_scale_with_the_image_or_are_given(rows: list | None, accuracy: float) -> None:
    # At half the size the rows are 80, 85, ..., 355: the lower 28 of the 56 start at 220.
    truth, half = polylines_of([[100, 100]], [80, 355]), polylines_of([[100, 100]], [220, 355])
    metric = TuSimpleMetric(rows)
    metric.update(half, truth, (360, 640))
    assert metric.compute()["accuracy"] == accuracy


def test_the_first_crossing_from_below_counts_and_the_outside_does_not() -> None:
    hook = [[10, 100], [10, 50], [30, 70], [30, 10]]
    outside, dot = [[-5, 100], [-5, 0]], [[3, 3]]
    for line in (hook, hook[::-1]):
        polylines = Polylines.from_list([outside, line, dot])
        lanes = lanes_at_rows(polylines, np.array([59.5, 19.5, 4.5]), (100, 100))
        np.testing.assert_allclose(lanes, [[9.5, 29.5, -2]])


def test_segments_and_ignored_regions_are_refused() -> None:
    polylines, segments = Polylines.from_list([]), Segments(np.zeros((0, 2, 2)))
    with pytest.raises(ValueError, match="link the segments"):
        TuSimpleMetric().update(segments, polylines, (720, 1280))
    with pytest.raises(ValueError, match="no ignored regions"):
        TuSimpleMetric().update(polylines, polylines, (720, 1280), [np.zeros((3, 2))])


@pytest.mark.skipif(not DATA.is_dir(), reason="the TuSimple frames are not here: set YOLINO_DATA")
@pytest.mark.parametrize("name", ["label_data_0313.json", "label_data_0531.json"])
def test_real_labels_score_perfectly_against_themselves(name: str, tmp_path: Path) -> None:
    records = [json.loads(line) for line in (DATA / name).read_text().splitlines()]
    predictions = lines(tmp_path / "pred.json", *({**r, "run_time": 5} for r in records))
    assert score_files(predictions, DATA / name) == {"accuracy": 1, "fp": 0, "fn": 0, "fn_strict": 0}
