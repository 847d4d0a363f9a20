from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from .conftest import Run

ROWS = list(range(160, 720, 10))


def scene(seed: int) -> np.ndarray:
    coarse = np.random.default_rng(seed).uniform(0, 255, (7, 11, 3)).astype(np.uint8)
    return cv2.resize(coarse, (320, 180), interpolation=cv2.INTER_CUBIC)


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """Two drives of four and one frames, with two lanes each."""
    root = tmp_path / "data"
    records = []
    for i, frame in enumerate(["monday/1", "monday/2", "monday/3", "monday/4", "tuesday/1"]):
        path = root / f"clips/{frame}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), scene(i))
        lanes = [[x] * len(ROWS) for x in (40, 80)]
        records.append(
            {"raw_file": f"clips/{frame}.png", "lanes": lanes, "h_samples": ROWS, "classes": "1 3"}
        )
    (root / "label_data_x.json").write_text("".join(json.dumps(record) + "\n" for record in records))
    return root


def lines(path: str) -> list[str]:
    return Path(path).read_text().splitlines()


def cells(out: str, row: str) -> list[str]:
    line = next(line for line in out.splitlines() if line.lstrip("│ ").startswith(row))
    return [cell.strip() for cell in line.strip("│ ").split("│")][1:]


def test_drives_stay_together_and_the_lists_work(run: Run, data: Path) -> None:
    code, out, err = run("datasets", "split", "--data", data, "--out", "lists")
    assert (code, err) == (0, "")
    assert "Split by the first 2 folders, e.g. clips/monday" in out
    assert cells(out, "train") == ["4", "80.0%", "1", "8"]
    assert cells(out, "val") == ["1", "20.0%", "1", "2"]
    assert "train.txt, val.txt and data.yaml are in lists." in out
    assert lines("lists/val.txt") == ["clips/tuesday/1.png"]
    assert lines("lists/train.txt") == [f"clips/monday/{i}.png" for i in (1, 2, 3, 4)]
    code, out, err = run("datasets", "check", "--data", "lists")
    assert (code, err) == (0, "")
    assert cells(out, "samples") == ["4", "1"]
    assert "Nothing leaks" in out


def test_classes_are_counted_in_each_split(run: Run, data: Path) -> None:
    arguments = [
        "--root",
        data,
        "--option",
        "classes=true",
        "--shares",
        "train=3,val=1,test=1",
        "--by",
        "image",
    ]
    code, out, _ = run("datasets", "split", *arguments, "--out", "lists")
    assert code == 0
    assert cells(out, "dashed") == ["3", "1", "1"]
    assert cells(out, "double dashed") == ["0", "0", "0"]
    written = yaml.safe_load(Path("lists/data.yaml").read_text())
    assert written == {
        "format": "tusimple",
        "root": "../data",
        "splits": {name: f"../lists/{name}.txt" for name in ("train", "val", "test")},
        "options": {"classes": True},
    }


def test_nothing_is_overwritten_without_force(run: Run, data: Path) -> None:
    arguments = ["datasets", "split", "--root", data, "--out", "lists", "--by", "image"]
    assert run(*arguments)[0] == 0
    before = lines("lists/train.txt")
    code, out, err = run(*arguments, "--seed", "3")
    assert (code, out) == (2, "")
    assert err == (
        "Error: lists/train.txt is there already: choose another folder (--out), or replace it (--force).\n"
    )
    assert lines("lists/train.txt") == before
    assert run(*arguments, "--seed", "3", "--force")[0] == 0
    assert lines("lists/train.txt") != before


def test_one_split_is_divided_and_the_others_stay(run: Run, data: Path) -> None:
    assert run("datasets", "split", "--data", data, "--out", "lists", "--shares", "train=4,test=1")[0] == 0
    arguments = ["--data", "lists", "--split", "train", "--by", "image", "--shares", "fit=0.75,val=0.25"]
    code, out, _ = run("datasets", "split", *arguments, "--out", "finer")
    assert code == 0
    assert cells(out, "fit")[0] == "3"
    written = yaml.safe_load(Path("finer/data.yaml").read_text())["splits"]
    assert list(written) == ["test", "fit", "val"]
    assert sorted(lines("finer/fit.txt") + lines("finer/val.txt")) == lines("lists/train.txt")
    assert run("datasets", "check", "--data", "finer")[0] == 0
    clash = ["--data", "lists", "--split", "train", "--shares", "test=0.5,val=0.5", "--out", "other"]
    code, _, err = run("datasets", "split", *clash)
    assert code == 2
    assert "There is a split test already" in err


def test_label_files_named_by_hand_are_written_down(run: Run, data: Path) -> None:
    (data / "label_data_x.json").rename(data / "mine.json")
    for labels in ("mine.json", data / "mine.json"):
        arguments = ["--root", data, "--labels", labels, "--out", "lists", "--force", "--no-leak-check"]
        assert run("datasets", "split", *arguments)[0] == 0
        assert yaml.safe_load(Path("lists/data.yaml").read_text())["options"] == {"labels": ["mine.json"]}
        assert run("datasets", "check", "--data", "lists")[0] == 0


def test_of_a_list_of_names_only_these_are_split(run: Run, data: Path) -> None:
    (data / "some.txt").write_text("clips/monday/1.png\nclips/tuesday/1.png\n")
    arguments = ["--root", data, "--option", "names=some.txt", "--shares", "train=1,val=1"]
    assert run("datasets", "split", *arguments, "--out", "lists")[0] == 0
    assert len(lines("lists/train.txt")) == len(lines("lists/val.txt")) == 1
    code, out, _ = run("datasets", "check", "--data", "lists")
    assert code == 0
    assert cells(out, "samples") == ["1", "1"]


def test_images_that_look_alike_in_two_splits_are_a_warning(run: Run, data: Path) -> None:
    for i in (2, 3, 4):
        image = (scene(0) * 0.95).astype(np.uint8)
        cv2.imwrite(str(data / f"clips/monday/{i}.png"), image + i)
    arguments = ["datasets", "split", "--root", data, "--by", "image", "--force", "--out", "lists"]
    code, _, err = run(*arguments, "--shares", "train=0.5,val=0.5")
    assert code == 0
    assert "Warning: images that look nearly the same are in both splits" in err
    assert "Warning: images of one clip or folder are in both splits, 1 time: clips/monday" in err
    assert run(*arguments, "--no-leak-check")[2] == ""


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--shares", "train"], "--shares is 'train'; name each split once with a share above 0"),
        (["--shares", "train=0,val=1"], "share above 0"),
        (["--shares", "train=1,train=2"], "name each split once"),
        (["--shares", "train=x"], "share above 0"),
        (["--shares", "train=inf"], "share above 0"),
        (["--shares", "a/b=1"], "'a/b' is no name of a split"),
        (["--shares", "a=1,b=1,c=1", "--by", "2"], "There are 2 groups of images by '2' for 3 splits"),
        (["--by", "clip"], "grouping 'clip' is unknown"),
        (["--by", "regex:(tuesday)"], "does not match clips/monday/1.png"),
        (["--option", "names=gone.txt"], "gone.txt"),
    ],
)
def test_mistakes_are_told_in_one_line(run: Run, data: Path, arguments: list[str], message: str) -> None:
    code, out, err = run("datasets", "split", "--root", data, "--out", "lists", *arguments)
    assert (code, out) == (2, "")
    assert message in err
    assert err.count("\n") == 1
    assert not Path("lists").exists()


def test_what_has_no_label_files_cannot_be_split(run: Run) -> None:
    code, _, err = run("datasets", "split", "--dataset", "synthetic", "--out", "lists")
    assert code == 2
    assert "The format 'synthetic' has no label files" in err


def test_a_dataset_that_is_not_there_is_told(run: Run) -> None:
    code, out, err = run("datasets", "split", "--root", "nowhere", "--out", "lists")
    assert (code, out) == (2, "")
    assert "nowhere" in err
    assert err.count("\n") == 1
