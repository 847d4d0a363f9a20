from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from yolino.datasets import TuSimple
from yolino.evaluate import (
    Evaluation,
    class_rows,
    confusion_tables,
    evaluate,
    point_radius,
    score_rows,
    write_report,
)
from yolino.header import Header
from yolino.inference import Predictor, load
from yolino.io import read_image
from yolino.metrics import ChamferMetric, ClassMetric, TuSimpleMetric, score_files
from yolino.types import Polylines, Sample

ROWS = list(range(160, 720, 10))
SEEN = [399.5, 879.5]
"""Pixel columns in 1280x720 of the lines that the tiny model sees at x = 40 and 88 of 128."""


@pytest.fixture
def predictor(tiny_model: Path) -> Predictor:
    return load(tiny_model)


@pytest.fixture
def write_dataset(tmp_path: Path) -> Callable[..., TuSimple]:
    """Writes frames with vertical lanes at the given columns, and their labels."""

    def write(*frames: list[float], black: tuple[int, ...] = (), classes: str | None = None) -> TuSimple:
        records = []
        for i, columns in enumerate(frames):
            name = f"clips/{i}/20.png"
            (tmp_path / name).parent.mkdir(parents=True)
            cv2.imwrite(str(tmp_path / name), np.full((720, 1280, 3), 0 if i in black else 200, np.uint8))
            record = {"raw_file": name, "lanes": [[x] * len(ROWS) for x in columns], "h_samples": ROWS}
            records.append(record | ({"classes": classes} if classes else {}))
        text = "".join(json.dumps(record) + "\n" for record in records)
        (tmp_path / "label_data_test.json").write_text(text)
        return TuSimple(tmp_path, classes=classes is not None)

    return write


def test_a_perfect_model_has_perfect_scores(
    predictor: Predictor, write_dataset: Callable[..., TuSimple]
) -> None:
    scores = evaluate(predictor, write_dataset(SEEN, SEEN)).scores
    assert scores["accuracy"] == pytest.approx(1, abs=0.02)
    assert scores["fp"] == scores["fn"] == 0
    assert scores["images"] == 2
    assert scores["recall"] > 0.95
    assert scores["precision"] > 0.85  # the labels begin 70 px below the lines
    assert scores["segment_f1"] > 0.9
    assert scores["fps"] == pytest.approx(1000 / scores["ms"])


def test_misses_and_false_alarms_count(predictor: Predictor, write_dataset: Callable[..., TuSimple]) -> None:
    """Frame 0: one of two lines is a lane. Frame 1 is black: nothing is seen, two lanes are missed."""
    scores = evaluate(predictor, write_dataset(SEEN[:1], SEEN, black=(1,))).scores
    assert scores["accuracy"] == pytest.approx(0.5, abs=0.02)
    assert scores["fp"] == pytest.approx((0.5 + 0) / 2)
    assert scores["fn"] == pytest.approx((0 + 1) / 2)
    assert scores["recall"] == pytest.approx(1 / 3, abs=0.05)


def test_the_submission_file_has_the_same_scores(
    predictor: Predictor, write_dataset: Callable[..., TuSimple], tmp_path: Path
) -> None:
    dataset = write_dataset(SEEN[:1], SEEN, [10.0, 399.5])
    scores = evaluate(predictor, dataset, save=tmp_path / "scores").scores
    records = [
        json.loads(line) for line in (tmp_path / "scores" / "predictions.json").read_text().splitlines()
    ]
    assert set(records[0]) == {"raw_file", "lanes", "h_samples", "run_time"}
    assert all(record["run_time"] > 0 for record in records)
    fast = tmp_path / "fast.json"  # this machine may be slower than the benchmark allows
    fast.write_text("".join(json.dumps(record | {"run_time": 1}) + "\n" for record in records))
    official = score_files(fast, tmp_path / "label_data_test.json")
    for name in ("accuracy", "fp", "fn", "fn_strict"):
        assert scores[name] == pytest.approx(official[name])


def test_a_slow_machine_is_a_warning_but_no_error_of_the_model(
    predictor: Predictor,
    write_dataset: Callable[..., TuSimple],
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr("yolino.evaluate.run.TIME_LIMIT_MS", 0.0)
    scores = evaluate(predictor, write_dataset(SEEN)).scores
    assert scores["accuracy"] > 0.95
    assert "1 of 1 images took more than 0 ms" in caplog.text


def test_pictures_of_the_worst_images_come_worst_first(
    predictor: Predictor, write_dataset: Callable[..., TuSimple], tmp_path: Path
) -> None:
    dataset = write_dataset(SEEN, SEEN[:1], [20.0], SEEN)
    evaluate(predictor, dataset, save=tmp_path / "scores", worst=2)
    pictures = sorted(path.name for path in (tmp_path / "scores" / "worst").iterdir())
    assert pictures == ["01-clips-2-20.png", "02-clips-1-20.png"]
    assert read_image(tmp_path / "scores" / "worst" / pictures[0]).shape == (720, 1280, 3)
    assert (tmp_path / "scores" / "worst.png").is_file()


def test_nothing_is_written_unless_asked(
    predictor: Predictor, write_dataset: Callable[..., TuSimple], tmp_path: Path
) -> None:
    dataset = write_dataset(SEEN)
    before = set(tmp_path.rglob("*"))
    evaluate(predictor, dataset)
    assert set(tmp_path.rglob("*")) == before


class InMemory:
    """A dataset of samples."""

    directed = True

    def __init__(self, *samples: Sample, classes: tuple[str, ...] = ("line",)) -> None:
        self.samples, self.classes = samples, classes

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, index: int, /) -> Sample:
        return self.samples[index]


def lines(*columns: float, labels: list[int] | None = None) -> Polylines:
    return Polylines.from_list([[(x, 64.0), (x, 0.0)] for x in columns], labels=labels)


WHITE = np.full((64, 128, 3), 255, np.uint8)


def test_other_datasets_are_scored_at_rows_of_their_images(predictor: Predictor) -> None:
    scores = evaluate(predictor, InMemory(Sample("a", WHITE, lines(40.0, 88.0)))).scores
    assert scores["accuracy"] > 0.95
    assert scores["f1"] > 0.95


def test_ignored_regions_leave_the_benchmark_out(predictor: Predictor) -> None:
    region = np.array([[70.0, 0.0], [128, 0], [128, 64], [70, 64]])
    scores = evaluate(predictor, InMemory(Sample("a", WHITE, lines(40.0), [region]))).scores
    assert "accuracy" not in scores
    assert scores["precision"] > 0.95


@pytest.mark.parametrize(
    ("classes", "message"),
    [(("dashed", "dots"), "knows solid, dashed, the labels dashed, dots"), (("lane",), "the labels lane")],
)
def test_classes_of_other_names_are_not_compared_by_their_place(
    class_model: Path, classes: tuple[str, ...], message: str
) -> None:
    dataset = InMemory(Sample("a", WHITE, lines(40.0)), classes=classes)
    with pytest.raises(ValueError, match=message):
        evaluate(load(class_model), dataset, metrics={"classes": ClassMetric()})


def test_classes_are_compared_by_name(class_model: Path) -> None:
    """The model says that both are dashed; the dataset numbers its classes the other way round."""
    names = ("dashed", "solid")
    dataset = InMemory(Sample("a", WHITE, lines(40.0, 88.0, labels=[0, 1])), classes=names)
    scores = evaluate(load(class_model), dataset).scores
    assert scores["class_accuracy"] == pytest.approx(0.5, abs=0.05)
    assert scores["recall_dashed"] > 0.95
    assert scores["precision_dashed"] == pytest.approx(0.5, abs=0.05)
    assert scores["f1_solid"] == 0.0
    assert scores["class_accuracy_lines"] == 0.5
    assert scores["class_recall_lines_dashed"] == 1.0
    assert scores["class_recall_lines_solid"] == 0.0
    other = evaluate(load(class_model), InMemory(Sample("a", WHITE, lines(40.0)), classes=("lane",)))
    assert "class_accuracy" not in other.scores
    assert (other.classes, other.confusion, other.line_confusion) == ((), (), ())
    assert class_rows(other) == confusion_tables(other) == []


def test_classes_that_the_model_lacks_are_not_compared_and_told(
    class_model: Path, caplog: pytest.LogCaptureFixture
) -> None:
    sample = Sample("a", WHITE, lines(40.0, 88.0, labels=[0, 1]))
    scores = evaluate(load(class_model), InMemory(sample, classes=("dashed", "dots"))).scores
    assert "class_accuracy" not in scores
    assert "the model knows solid, dashed, the labels dashed, dots" in caplog.text


def test_the_types_of_tusimple_are_compared_with_the_kinds_that_a_model_knows(
    make_model: Callable[..., Path],
    header: Header,
    write_dataset: Callable[..., TuSimple],
    tmp_path: Path,
) -> None:
    """The model takes all lines for dots (its last class); labelled are a double dashed one and dots."""
    names = ("dashed", "unknown", "continuous", "Botts' dots")
    outputs = ("endpoints", "scores", "probabilities")
    model = make_model(tmp_path / "types.onnx", header=replace(header, classes=names), outputs=outputs)
    found = evaluate(load(model), write_dataset(SEEN, SEEN, classes="4 5"), save=tmp_path / "scores")
    assert found.classes == names
    np.testing.assert_array_equal(found.line_confusion, [[0, 0, 0, 2], [0] * 4, [0] * 4, [0, 0, 0, 2]])
    assert found.scores["class_accuracy_lines"] == 0.5
    assert set(found.intervals) >= {"class_accuracy_lines", "class_recall_lines_dashed"}
    dashed, unknown, _, dots = class_rows(found)
    assert dashed[:4] == ("dashed", "2", "0.000", "0.000 .. 0.000")
    assert unknown[1:4] == ("0", "", "")  # none was there
    assert dots[:3] == ("Botts' dots", "2", "1.000")
    shown = {name for name, *_ in score_rows(found)}
    assert "class accuracy lines" in shown
    assert not any("dashed" in name for name in shown)
    title, columns, rows = confusion_tables(found)[0]
    assert title == "Lines that were found"
    assert columns == ("labelled \\ predicted", *names)
    assert rows[0] == ("dashed", "0", "0", "0", "2")


def test_the_report_draws_what_was_taken_for_what(tmp_path: Path) -> None:
    scores = {"class_accuracy": 0.9, "class_recall_lines_a": 0.75, "f1_a": 0.5, "images": 3}
    intervals = {"class_recall_lines_a": (0.5, 1.0)}
    matrices = [[30, 10], [0, 0]], [[3, 1], [0, 0]]
    found = Evaluation(scores, intervals, (), ("a", "b <c>"), *matrices)
    write_report(tmp_path, found, title="model")
    text, page = (tmp_path / "report.md").read_text(), (tmp_path / "report.html").read_text()
    assert "| a | 4 | 0.750 | 0.500 .. 1.000 |  |  | 0.500 |" in text
    assert "![](confusion.svg)" in text
    assert "<td>b &lt;c&gt;</td>" in page
    assert 'src="confusion.svg"' in page
    assert (tmp_path / "confusion.svg").is_file()


def test_the_fifth_lane_is_forgiven_by_the_benchmark_alone(
    predictor: Predictor, write_dataset: Callable[..., TuSimple]
) -> None:
    """Two of five lanes are found: the benchmark forgives one of the three that are not."""
    found = evaluate(predictor, write_dataset([20.0, 399.5, 640.0, 879.5, 1260.0]))
    assert found.scores["fn"] == 2 / 4
    assert found.scores["fn_strict"] == 3 / 5
    assert found.intervals["fn_strict"] == (3 / 5, 3 / 5)


def test_direction_counts_unless_one_side_knows_none(predictor: Predictor) -> None:
    down = Polylines.from_list([[(x, 0.0), (x, 64.0)] for x in (40.0, 88.0)])
    dataset = InMemory(Sample("a", WHITE, down))
    assert evaluate(predictor, dataset).scores["f1"] == 0
    dataset.directed = False
    assert evaluate(predictor, dataset).scores["f1"] > 0.95


def test_an_empty_dataset_is_refused(predictor: Predictor) -> None:
    with pytest.raises(ValueError, match="no samples"):
        evaluate(predictor, InMemory())


def test_a_damaged_image_is_named(
    predictor: Predictor, write_dataset: Callable[..., TuSimple], tmp_path: Path
) -> None:
    dataset = write_dataset(SEEN, SEEN)
    (tmp_path / "clips/1/20.png").write_bytes(b"x")
    with pytest.raises(ValueError, match=r"clips/1/20\.png"):
        evaluate(predictor, dataset)


def test_chosen_metrics_have_their_names_and_intervals(
    predictor: Predictor, write_dataset: Callable[..., TuSimple]
) -> None:
    dataset = write_dataset(SEEN, SEEN[:1], SEEN)
    alone = evaluate(predictor, dataset, metrics={"chamfer": ChamferMetric()})
    assert {"ap", "f1", "images", "fps", "ms"} <= alone.scores.keys()
    assert "accuracy" not in alone.scores
    both = evaluate(predictor, dataset, metrics={"chamfer": ChamferMetric(), "tusimple": TuSimpleMetric()})
    assert both.scores["chamfer_ap"] == alone.scores["ap"]
    assert both.scores["tusimple_accuracy"] == pytest.approx(evaluate(predictor, dataset).scores["accuracy"])
    for name, (low, high) in both.intervals.items():
        assert low <= both.scores[name] <= high
    assert set(both.intervals) == set(both.scores) - {"images", "fps", "ms"}


def test_intervals_come_from_groups(predictor: Predictor, write_dataset: Callable[..., TuSimple]) -> None:
    """All frames in one group: there is nothing else to draw."""
    dataset = write_dataset(SEEN, SEEN[:1], SEEN)
    low, high = evaluate(predictor, dataset).intervals["fp"]
    assert low < high
    low, high = evaluate(predictor, dataset, groups=lambda name: name[:5]).intervals["fp"]
    assert low == high


def test_the_report_shows_scores_and_the_worst(
    predictor: Predictor, write_dataset: Callable[..., TuSimple], tmp_path: Path
) -> None:
    found = evaluate(predictor, write_dataset(SEEN, [20.0]), save=tmp_path / "scores", worst=1)
    assert [bad.name for bad in found.worst] == ["clips/1/20.png"]
    write_report(tmp_path / "scores", found, title="tiny <model>", facts=["fact & figure"])
    text = (tmp_path / "scores/report.md").read_text()
    assert "# tiny <model>" in text
    assert "- fact & figure" in text
    low, high = found.intervals["accuracy"]
    assert f"| accuracy | {found.scores['accuracy']:.4f} | {low:.3f} .. {high:.3f} |" in text
    assert "![](worst/01-clips-1-20.png)" in text
    page = (tmp_path / "scores/report.html").read_text()
    assert "<h1>tiny &lt;model&gt;</h1>" in page
    assert 'src="worst/01-clips-1-20.png"' in page
    assert page.count("<td>") == 3 * len(score_rows(found))


def test_the_radius_of_a_model_that_sees_windows_is_a_part_of_its_cells() -> None:
    header = Header("0", "m", (320, 320), 8, 1, "po", fit="window", scale=0.5)
    assert point_radius(header) == 12.8  # the paper's: 640 / 50
    assert point_radius(replace(header, fit="stretch", scale=1.0)) is None
