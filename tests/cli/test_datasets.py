from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from yolino.io import read_image

from .conftest import Run

ROWS = list(range(160, 720, 10))


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Three frames with two upright lanes each."""
    records = []
    for i in range(3):
        path = tmp_path / f"data/clips/{i}/20.png"
        path.parent.mkdir(parents=True)
        cv2.imwrite(str(path), np.full((720, 1280, 3), 200, np.uint8))
        lanes = [[x] * len(ROWS) for x in (400, 880)]
        records.append({"raw_file": f"clips/{i}/20.png", "lanes": lanes, "h_samples": ROWS, "classes": "1 2"})
    (tmp_path / "data/label_data_x.json").write_text("".join(json.dumps(record) + "\n" for record in records))
    return tmp_path / "data"


def test_a_sound_dataset_is_counted(run: Run, root: Path) -> None:
    code, out, err = run("datasets", "check", "--dataset", "tusimple", "--root", root, "--stride", "16")
    assert (code, err) == (0, "")
    assert "720x1280 (3)" in out
    assert "Nothing is wrong." in out


def test_classes_are_counted_by_name(run: Run, root: Path) -> None:
    code, out, _ = run("datasets", "check", "--root", root, "--option", "classes=true")
    assert code == 0
    assert "polylines of class continuous yellow" in out


def test_mistakes_are_found_to_the_end(run: Run, root: Path) -> None:
    (root / "clips/0/20.png").unlink()
    (root / "clips/2/20.png").write_bytes(b"nonsense")
    code, out, err = run("datasets", "check", "--root", root)
    assert code == 2
    assert "missing image" in out
    lines = err.splitlines()
    assert len(lines) == 2
    assert "clips/0/20.png" in lines[0]
    assert "clips/2/20.png" in lines[1]


def test_labels_are_drawn(run: Run, root: Path) -> None:
    arguments = ["--root", root, "--count", "2", "--columns", "1", "--out", "labels.png"]
    code, out, err = run("datasets", "show", *arguments)
    assert (code, err) == (0, "")
    assert "2 of 3 images are drawn in labels.png." in out
    sheet = read_image("labels.png")
    assert sheet.shape == (2 * (360 + 28 + 4) + 4, 648, 3)
    assert (sheet[200, 190:220] != 200).any()


def test_the_deviation_of_upright_lines_is_small(run: Run, root: Path) -> None:
    code, out, err = run("datasets", "deviation", "--root", root, "--size", "320", "640", "--stride", "32")
    assert (code, err) == (0, "")
    row = next(line for line in out.splitlines() if " 32 " in line)
    assert all(float(cell) < 2 for cell in row.replace("│", " ").split()[1:3])


@pytest.mark.parametrize("command", ["check", "show", "deviation"])
def test_a_dataset_that_is_not_there_is_told(run: Run, command: str) -> None:
    code, out, err = run("datasets", command, "--root", "nowhere")
    assert (code, out) == (2, "")
    assert "nowhere" in err
    assert err.count("\n") == 1


def test_a_wrong_frame_is_told(run: Run, root: Path) -> None:
    code, _, err = run("datasets", "check", "--root", root, "--size", "320", "640", "--fit", "top")
    assert code == 2
    assert "fit is 'top'" in err
    code, _, err = run("datasets", "check", "--root", root, "--size", "330", "640")
    assert code == 2
    assert err.startswith("Error: ")
