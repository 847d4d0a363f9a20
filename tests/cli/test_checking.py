from __future__ import annotations

import json
from pathlib import Path
from zlib import crc32

import cv2
import numpy as np
import pytest

from .conftest import Run

ROWS = list(range(160, 720, 10))


def write_frames(root: Path, labels: str, frames: list[str], *extra: str, classes: str | None = None) -> None:
    """Frames of even gray with two upright lanes each, and further lines."""
    records = []
    for frame in frames:
        path = root / frame
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), np.full((720, 1280, 3), crc32(frame.encode()) % 251, np.uint8))
        record = {"raw_file": frame, "lanes": [[x] * len(ROWS) for x in (400, 880)], "h_samples": ROWS}
        records.append(json.dumps(record | ({"classes": classes} if classes else {})))
    (root / labels).write_text("".join(f"{line}\n" for line in (*records, *extra)))


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    """Two splits without anything in common."""
    root = tmp_path / "drive"
    write_frames(root, "label_data_a.json", ["clips/a/1.png", "clips/a/2.png"])
    write_frames(root, "label_data_b.json", ["clips/b/1.png"])
    text = "format: tusimple\nsplits: {train: label_data_a.json, val: label_data_b.json}\n"
    (root / "data.yaml").write_text(text)
    return root


def numbers(out: str, row: str) -> list[str]:
    """Gives the cells of the row of a table that begins so."""
    line = next(line for line in out.splitlines() if line.lstrip("│ ").startswith(row))
    return [cell.strip() for cell in line.strip("│ ").split("│")][1:]


def test_all_splits_are_examined_side_by_side(run: Run, drive: Path) -> None:
    code, out, err = run("datasets", "check", "--data", drive, "--stride", "16")
    assert (code, err) == (0, "")
    assert numbers(out, "samples") == ["2", "1"]
    assert numbers(out, "polylines of class lane") == ["4", "2"]
    assert numbers(out, "16 train")[1:] == ["140", "140", "1", "0"]
    assert "Nothing is wrong." in out
    assert "Nothing leaks: no image, no nearly identical one and no clip is in two splits." in out


def test_one_split_can_be_chosen(run: Run, drive: Path) -> None:
    code, out, _ = run("datasets", "check", "--data", drive, "--split", "val")
    assert code == 0
    assert numbers(out, "samples") == ["1"]
    assert "leak" not in out.lower()


def test_labels_chosen_by_hand_are_no_splits(run: Run, drive: Path) -> None:
    code, out, _ = run("datasets", "check", "--data", drive, "--labels", "label_data_a.json")
    assert code == 0
    assert numbers(out, "samples") == ["2"]


def test_an_image_in_two_splits_is_an_error(run: Run, drive: Path) -> None:
    write_frames(drive, "label_data_b.json", ["clips/a/2.png", "clips/b/1.png"])
    code, out, err = run("datasets", "check", "--data", drive)
    assert code == 2
    assert err.count("\n") == 1
    assert err.startswith("Error: train clips/a/2.png, val clips/a/2.png: same name, ")
    assert numbers(out, "same name")[::2] == ["error", "1"]
    assert numbers(out, "same group")[::2] == ["notice", "1"]
    assert "clips/a: 2 images in train, 1 in val" in out


def test_what_leaks_by_folder_is_a_notice_and_depends_on_the_folder(run: Run, drive: Path) -> None:
    code, out, err = run("datasets", "check", "--data", drive, "--by", "1")
    assert (code, err) == (0, "")
    assert "clips: 2 images in train, 1 in val" in out
    code, _, err = run("datasets", "check", "--data", drive, "--by", "clip")
    assert code == 2
    assert err.startswith("Error: The grouping 'clip' is unknown; use auto, image")


def test_images_that_are_cut_are_found_even_where_pixels_are_not_looked_at(run: Run, drive: Path) -> None:
    cv2.imwrite(str(drive / "whole.jpg"), np.random.default_rng(0).integers(0, 255, (720, 1280, 3), np.uint8))
    (drive / "clips/b/1.png").write_bytes((drive / "whole.jpg").read_bytes()[:-9])
    code, out, err = run("datasets", "check", "--data", drive)
    assert code == 2
    assert err.startswith("Error: val: clips/b/1.png: unreadable image, ")
    assert numbers(out, "unreadable image")[2:] == ["0", "1"]
    code, out, err = run("datasets", "check", "--data", drive, "--no-images")
    assert code == 2
    assert err.startswith("Error: val: clips/b/1.png: unreadable image, ")
    assert "Nothing leaks: no image and no clip is in two splits." in out


def test_the_first_findings_are_shown_and_all_with_details(run: Run, drive: Path) -> None:
    write_frames(drive, "label_data_a.json", [f"clips/a/{i}.png" for i in range(5)])
    for i in range(5):
        (drive / f"clips/a/{i}.png").unlink()
    code, out, err = run("datasets", "check", "--root", drive, "--labels", "label_data_a.json")
    assert code == 2
    assert out.count("clips/a/") == 2 * 3  # name and file
    assert "... and 2 more: --details lists them." in out
    assert err.count("\n") == 5
    _, out, _ = run("datasets", "check", "--root", drive, "--labels", "label_data_a.json", "--details")
    assert [line.split(": ")[0] for line in out.splitlines() if line.startswith("clips")] == [
        f"clips/a/{i}.png" for i in range(5)
    ]
    assert "more" not in out


def test_very_many_errors_are_counted(run: Run, drive: Path) -> None:
    broken = ["nonsense"] * 30
    write_frames(drive, "label_data_a.json", ["clips/a/1.png"], *broken)
    code, out, err = run("datasets", "check", "--root", drive)
    assert code == 2
    assert numbers(out, "broken label")[2] == "30"
    lines = err.splitlines()
    assert lines[0] == "30 errors, the first 20 below."
    assert len(lines) == 21
    assert "label_data_a.json, line 2: broken label, is not valid JSON" in lines[1]


def test_json_is_one_object_and_nothing_else(run: Run, drive: Path) -> None:
    write_frames(drive, "label_data_b.json", ["clips/a/2.png"], "nonsense")
    code, out, err = run("datasets", "check", "--data", drive, "--json", "--stride", "32")
    assert code == 2
    assert err.count("Error: ") == 2
    assert out.count("\n") == 1
    found = json.loads(out)
    assert set(found) == {"splits", "leaks", "errors"}
    assert found["errors"] == 2
    assert list(found["splits"]) == ["train", "val"]
    assert found["splits"]["train"]["polylines"] == 4
    assert found["splits"]["val"]["counts"] == {"broken label": 1}
    assert found["splits"]["val"]["findings"][0]["sample"] == f"{drive}/label_data_b.json, line 2"
    assert found["splits"]["val"]["occupancy"][0]["stride"] == 32
    assert found["leaks"]["counts"] == {"same name": 1, "same group": 1}
    assert found["leaks"]["found"][0]["samples"] == ["clips/a/2.png", "clips/a/2.png"]
    assert found["leaks"]["not_compared"] == []


def test_json_of_a_dataset_without_splits_has_one_named_all(run: Run, drive: Path) -> None:
    (drive / "data.yaml").unlink()
    code, out, _ = run("datasets", "check", "--data", drive, "--json")
    assert code == 0
    assert list(json.loads(out)["splits"]) == ["all"]


def test_polylines_that_are_left_out_are_counted(run: Run, drive: Path) -> None:
    write_frames(drive, "label_data_a.json", ["clips/a/1.png"], classes="1 3")
    code, out, _ = run(
        "datasets", "check", "--root", drive, "--labels", "label_data_a.json", "--option", "classes=[dashed]"
    )
    assert code == 0
    assert numbers(out, "polylines of class dashed") == ["1"]
    assert numbers(out, "polylines of continuous yellow, left out") == ["1"]


def test_classes_that_differ_between_splits_are_told(run: Run, tmp_path: Path) -> None:
    shape = {"label": "solid", "points": [[1, 1], [9, 9]], "shape_type": "linestrip"}
    for name, label in (("a", "solid"), ("b", "dashed")):
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.full((32, 64, 3), ord(name), np.uint8))
        document = {"imagePath": f"{name}.png", "shapes": [shape | {"label": label}]}
        (tmp_path / f"{name}.json").write_text(json.dumps(document))
    text = "format: labelme\nsplits: {train: [a.json], val: [b.json]}\n"
    (tmp_path / "data.yaml").write_text(text)
    code, out, err = run("datasets", "check", "--data", tmp_path)
    assert code == 0
    assert err == "The splits have different classes: name them under `classes:` in data.yaml.\n"
    assert numbers(out, "polylines of class solid") == ["1", "0"]
    (tmp_path / "data.yaml").write_text(text + "classes: [solid, dashed]\n")
    assert run("datasets", "check", "--data", tmp_path)[2] == ""
