from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from .conftest import Run

ROWS = list(range(160, 720, 10))


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    """Two frames with the lanes that the tiny model sees; the second is labelled with classes."""
    root = tmp_path / "data"
    for name, extra in (("a", {}), ("b", {"classes": "3 3"})):
        path = root / f"clips/{name}/20.png"
        path.parent.mkdir(parents=True)
        cv2.imwrite(str(path), np.full((720, 1280, 3), 200, np.uint8))
        lanes = [[x] * len(ROWS) for x in (400, 880)]
        record = {"raw_file": f"clips/{name}/20.png", "lanes": lanes, "h_samples": ROWS} | extra
        (root / f"label_data_{name}.json").write_text(json.dumps(record) + "\n")
    return root


def test_json_is_one_object_and_nothing_else(run: Run, model: Path, dataset: Path) -> None:
    code, out, err = run("evaluate", "--model", model, "--dataset", "tusimple", "--root", dataset, "--json")
    assert (code, err) == (0, "")
    assert out.count("\n") == 1
    scores = json.loads(out)
    assert {"accuracy", "fp", "fn", "fn_strict", "precision", "recall", "f1", "images", "fps"} <= set(scores)
    assert scores["images"] == 2
    assert scores["accuracy"] > 0.95


def test_labels_choose_files_and_save_writes_the_submission(run: Run, model: Path, dataset: Path) -> None:
    arguments = ["--root", dataset, "--labels", "label_data_a.json", "--save", "scores"]
    code, out, err = run("evaluate", "--model", model, *arguments)
    assert (code, err) == (0, "")
    assert "accuracy" in out
    assert "Details are in scores" in out
    records = Path("scores/predictions.json").read_text().splitlines()
    assert [json.loads(record)["raw_file"] for record in records] == ["clips/a/20.png"]
    assert Path("scores/worst.png").is_file()


def test_classes_are_printed_and_in_the_report(
    run: Run, class_model: Path, dataset: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Both lines of frame b are dashed, and so says the model; it knows no other types of the benchmark."""
    arguments = ["--model", class_model, "--root", dataset, "--labels", "label_data_b.json"]
    names = ["--option", "classes=[dashed]"]
    code, out, err = run("evaluate", *arguments, *names, "--save", "scores")
    assert (code, err) == (0, "")
    for text in (
        "fn strict",
        "class accuracy lines",
        "Classes",
        "Lines that were found",
        "Points that were",
    ):
        assert text in out
    assert Path("scores/confusion.svg").is_file()
    code, out, err = run("evaluate", *arguments, *names, "--json")
    scores = json.loads(out)
    assert scores["classes"] == ["solid", "dashed"]
    assert scores["line_confusion"] == [[0, 0], [0, 2]]
    assert scores["confusion"][1][1] > 100
    code, out, err = run("evaluate", *arguments, "--json")
    assert code == 0
    assert "class_accuracy" not in json.loads(out)
    assert "classes are not compared" in caplog.text


def test_the_report_says_that_the_mirrored_image_was_seen(run: Run, model: Path, dataset: Path) -> None:
    command = ("evaluate", "--model", model, "--root", dataset, "--save", "report")
    assert run(*command)[0] == 0
    assert "mirror" not in Path("report/report.md").read_text()
    assert run(*command, "--flip")[0] == 0
    assert "each image and its mirror image" in Path("report/report.md").read_text()


def test_intervals_come_from_clips_where_asked_for(run: Run, model: Path, dataset: Path) -> None:
    command = ("evaluate", "--model", model, "--root", dataset, "--save", "report")
    assert run(*command, "--groups", "regex:(.)")[0] == 0
    assert "1,000 draws of groups of images (regex:(.))" in Path("report/report.md").read_text()
    code, _, err = run(*command, "--groups", "regex:(drive)")
    assert (code, "does not match" in err) == (2, True)
    code, _, err = run(*command, "--groups", "drive")
    assert (code, "The grouping 'drive' is unknown; use auto, image" in err) == (2, True)


def test_synthetic_data_needs_no_root(run: Run, model: Path) -> None:
    arguments = ["--dataset", "synthetic", "--option", "length=2", "--json"]
    code, out, _ = run("evaluate", "--model", model, *arguments)
    assert code == 0
    assert json.loads(out)["images"] == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["--dataset", "tusimpel", "--root", "data"],
            "The dataset 'tusimpel' is unknown; use one of tusimple, ",
        ),
        ([], "The dataset 'tusimple' needs --root."),
        (["--root", "nowhere"], "nowhere"),
        (["--root", "data", "--labels", "none.json"], "none.json"),
        (["--root", "data", "--option", "length"], "The option 'length' is not of the form key=value"),
        (
            ["--root", "data", "--option", "length=3"],
            "The dataset 'tusimple' takes no length; it takes root, labels",
        ),
        (["--dataset", "synthetic", "--root", "data"], "The dataset 'synthetic' takes no root"),
        (["--root", "data", "--model", "nothing.onnx"], "nothing.onnx does not exist"),
    ],
)
def test_mistakes_are_told(run: Run, model: Path, dataset: Path, arguments: list[str], message: str) -> None:
    if "--model" not in arguments:
        arguments = [*arguments, "--model", str(model)]
    code, out, err = run("evaluate", *arguments, "--json")
    assert (code, out) == (2, "")
    assert err.startswith("Error: ")
    assert message in err
    assert err.count("\n") == 1
