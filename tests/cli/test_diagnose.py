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
    """A data.yaml with two frames: in the first a line lies beside its label; each is a split."""
    root = tmp_path / "data"
    for name, columns in (("a", (340, 880)), ("b", (400, 880))):
        path = root / f"clips/{name}/20.png"
        path.parent.mkdir(parents=True)
        cv2.imwrite(str(path), np.full((720, 1280, 3), 200, np.uint8))
        lanes = [[x] * len(ROWS) for x in columns]
        record = {"raw_file": f"clips/{name}/20.png", "lanes": lanes, "h_samples": ROWS}
        (root / f"label_data_{name}.json").write_text(json.dumps(record) + "\n")
    text = "format: tusimple\nroot: .\nsplits: {train: [label_data_b.json], val: [label_data_a.json]}\n"
    (root / "data.yaml").write_text(text)
    return root / "data.yaml"


def test_the_tables_end_with_what_limits_the_model(run: Run, model: Path, dataset: Path) -> None:
    arguments = ["--data", dataset, "--split", "val", "--prior", "train", "--save", "why"]
    code, out, err = run("diagnose", model, *arguments)
    assert (code, err) == (0, "")
    assert "no image" in out
    assert "What limits the accuracy of this model on this image: misplaced segments" in out
    assert "Details are in why/report.html." in out
    assert "No image: the lines of clips/b/20.png everywhere" in Path("why/report.md").read_text()
    assert Path("why/worst/01-clips-a-20.png").is_file()


def test_json_is_one_object_and_nothing_else(run: Run, model: Path, dataset: Path) -> None:
    prior = dataset.parent / "label_data_b.json"
    arguments = ["--root", dataset.parent, "--labels", "label_data_a.json", "--prior", prior, "--json"]
    code, out, err = run("diagnose", model, *arguments)
    assert (code, err) == (0, "")
    assert out.count("\n") == 1
    found = json.loads(out)
    assert found["headline"] == "accuracy"
    assert found["rows"]["labels"]["accuracy"] == 1
    assert found["losses"]["misplaced segments"]["fn"] > 0
    assert set(found["rows"]["no_image"]["intervals"]["f1"]) <= {found["rows"]["no_image"]["f1"]}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--prior", "tarin"], "--prior 'tarin' is no file or folder, and no split of"),
        (["--groups", "drive"], "The grouping 'drive' is unknown; use auto, image"),
        (["--split", "test"], "has no split 'test'"),
    ],
)
def test_mistakes_are_told(run: Run, model: Path, dataset: Path, arguments: list[str], message: str) -> None:
    code, out, err = run("diagnose", model, "--data", dataset, *arguments)
    assert (code, out) == (2, "")
    assert message in err
    assert err.count("\n") == 1
