"""The table says what the runs left: means, ranges, reported numbers, and what is missing."""

import csv
import json

import pytest

from yolino.sweep import cells, facts, heading, load_sweep, notes, read_rows, write_tables
from yolino.sweep.description import Numbers
from yolino.sweep.result import RUNS, read_row, write_problem
from yolino.sweep.table import printed, short

SCORES = {"segment_f1": 0.5, "segment_recall": 0.4, "segment_precision": 0.6, "f1": 0.3, "recall": 0.3}
LAYOUT = """
reported_by: paper
columns: {Line: model.representation, Grid: stride}
groups:
  - {title: All, rows: [a, b], reported_on: {data: Shapes, train: 50, val: 3, backbone: residual}}
numbers: {a: {f1: 0.740, recall: 0.9}, b: {f1: 0.5, recall: 0.52}}
"""


@pytest.mark.parametrize(
    ("value", "text"), [(0.914, ".914"), (1.0, "1.000"), (0.0, ".000"), (-0.25, "-.250"), (None, "–")]
)
def test_scores_are_printed_as_in_the_paper(value, text):
    assert short(value) == text


def test_reported_numbers_keep_their_digits():
    assert printed(Numbers(f1=0.89, recall=0.9)) == {"segment_f1": ".89", "segment_recall": ".90"}
    assert printed(Numbers(f1=0.74, fn=0.112)) == {"segment_f1": ".740", "fn": ".112"}
    assert printed(Numbers()) == {}


def test_reported_numbers_stand_beside_ours(folder, finish, tmp_path):
    (folder / "sweep.yaml").write_text(LAYOUT)
    finish("a", **SCORES)
    sweep = load_sweep(folder)
    rows = read_rows(sweep, tmp_path / "out")
    assert heading(sweep, rows) == ["Line", "Grid", "F1", "Rec", "Prec"]
    assert cells(sweep, rows, "a") == ["po", "16 px", ".500 (.74)", ".400 (.90)", ".600"]
    assert cells(sweep, rows, "b") == ["eu", "32 px", "– (.50)", "– (.52)", "–"]
    assert cells(sweep, rows, "a", {"segment_f1": 0.5})[2] == "**.500** (.74)"
    assert notes(rows) == ["Not run yet: b."]


def test_the_best_is_bold_and_less_is_better_for_false_alarms(folder, finish, tmp_path):
    finish("a", **SCORES, precision=0.5, fp=0.2, accuracy=0.9, fn=0.1)
    finish("b", **{**SCORES, "segment_f1": 0.6}, precision=0.5, fp=0.3, accuracy=0.8, fn=0.1)
    sweep = load_sweep(folder)
    write_tables(sweep, tmp_path / "out")
    text = (tmp_path / "out" / "table.md").read_text()
    (line,) = [line for line in text.splitlines() if line.startswith("| a | 1 | po |")]
    assert line == "| a | 1 | po | **.900** | **.200** | .100 | .500 | .400 | .600 |"
    (line,) = [line for line in text.splitlines() if line.startswith("| b | 0 | eu |")]
    assert line == "| b | 0 | eu | .800 | .300 | .100 | **.600** | .400 | .600 |"


def test_seeds_give_a_mean_and_a_range(folder, finish, tmp_path):
    finish("a", 0, **SCORES, precision=0.5)
    finish("a", 1, **{**SCORES, "segment_f1": 0.8}, precision=0.5)
    out = tmp_path / "out"
    sweep = load_sweep(folder)
    write_tables(sweep, out)
    assert cells(sweep, read_rows(sweep, out), "a")[3] == ".650"
    text = (out / "table.md").read_text()
    assert "| a | 0, 1 | .500 .. .800 |" in text
    assert "| a, seed 1 | .800 (.700 .. .850) |" in text
    assert "Means over the seeds." in text
    (first, second) = csv.DictReader((out / "table.csv").read_text().splitlines())
    assert (first["row"], first["seeds"], first["segment_f1"]) == ("a", "0 1", "0.65000")
    assert (first["segment_f1_min"], first["segment_f1_max"]) == ("0.50000", "0.80000")
    assert (second["row"], second["segment_f1"], second["representation"]) == ("b", "", "eu")
    document = json.loads((out / "table.json").read_text())
    assert document["rows"][0]["range"]["segment_f1"] == [0.5, 0.8]
    assert [run["seed"] for run in document["rows"][0]["runs"]] == [0, 1]


def test_a_setting_called_like_a_column_of_the_table_has_its_whole_key(folder, finish, tmp_path):
    (folder / "b.yaml").write_text("base: _base.yaml\ntraining: {steps: 9}")
    finish("a", **SCORES)
    write_tables(load_sweep(folder), tmp_path / "out")
    header, first, second = csv.reader((tmp_path / "out" / "table.csv").read_text().splitlines())
    assert len(set(header)) == len(header)
    assert dict(zip(header, first, strict=True))["steps"] == "4"
    assert dict(zip(header, second, strict=True))["training.steps"] == "9"


def test_why_a_row_is_missing_is_told(folder, finish, tmp_path):
    out = tmp_path / "out"
    finish("a", **SCORES, precision=0.5)
    write_problem(out / RUNS / "b-seed0", "not run: no data", ValueError("no data"))
    sweep = load_sweep(folder)
    rows = read_rows(sweep, out)
    assert cells(sweep, rows, "b")[3:] == ["not run", "–", "–"]
    assert notes(rows) == ["b, seed 0: not run: no data"]
    write_tables(sweep, out)
    assert "- b, seed 0: not run: no data" in (out / "table.md").read_text()
    (out / RUNS / "b-seed0" / "problem.txt").write_text("")
    assert notes(read_rows(sweep, out)) == ["b, seed 0: "]
    finish("b", **SCORES, precision=0.5)
    assert notes(read_rows(sweep, out)) == []


def test_rows_whose_names_begin_alike_are_told_apart(folder, finish, tmp_path):
    (folder / "a-seed0.yaml").write_text("base: a.yaml")
    finish("a", 1, **SCORES)
    finish("a-seed0", 2, **SCORES)
    assert list(read_row("a", tmp_path / "out").results) == [1]
    assert list(read_row("a-seed0", tmp_path / "out").results) == [2]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"{}", "the key 'row' is missing"),
        (b"[", "Invalid JSON"),
        (b'{"row": 1}', "row is 1: Input should be a valid string"),
        (b"", "Invalid JSON: EOF while parsing a value at line 1 column 0"),
        (b"null", "Input should be an object"),
        (b"\xff\xfe\x00", "Invalid JSON"),
    ],
)
def test_a_broken_result_is_named(folder, finish, tmp_path, content, message):
    finish("a", **SCORES)
    (tmp_path / "out" / RUNS / "a-seed0" / "result.json").write_bytes(content)
    expected = rf"a-seed0/result\.json: {message}.*\. Delete the folder .*a-seed0 to run it anew"
    with pytest.raises(ValueError, match=expected):
        read_rows(load_sweep(folder), tmp_path / "out")


def test_a_score_that_is_no_number_is_named(folder, finish, tmp_path):
    finish("a", **SCORES)
    path = tmp_path / "out" / RUNS / "a-seed0" / "result.json"
    path.write_text(path.read_text().replace('"segment_f1": 0.5', '"segment_f1": NaN'))
    with pytest.raises(ValueError, match=r"scores\.segment_f1 is nan: .*finite number"):
        read_rows(load_sweep(folder), tmp_path / "out")


class TestFacts:
    def test_what_was_trained_and_scored_is_said(self, folder, finish, tmp_path):
        finish("a", **SCORES)
        finish("b", 3, **SCORES)
        sweep = load_sweep(folder)
        assert facts(sweep, read_rows(sweep, tmp_path / "out")) == [
            "Trained on shapes (50 images), scored on other shapes (3 images); backbone residual, "
            "input 64x96, 4 steps of 2 images, seed 0, 3."
        ]

    def test_nothing_is_added_on_the_reported_data(self, folder, finish, tmp_path):
        (folder / "sweep.yaml").write_text(LAYOUT)
        finish("a", **SCORES)
        sweep = load_sweep(folder)
        (sentence,) = facts(sweep, read_rows(sweep, tmp_path / "out"))
        assert sentence.endswith("seed 0.")

    def test_other_data_and_another_backbone_are_said(self, folder, finish, tmp_path):
        (folder / "sweep.yaml").write_text(LAYOUT.replace("backbone: residual", "backbone: darknet19"))
        finish("a", **SCORES)
        finish("b", train=1200, **SCORES)
        sweep = load_sweep(folder)
        same, other = facts(sweep, read_rows(sweep, tmp_path / "out"))
        assert "This is not the paper's darknet19: compare" in same
        assert (
            "not the data of the paper (Shapes, 50 images to train) and not its backbone (darknet19)" in other
        )
        assert "1,200 images" in other
