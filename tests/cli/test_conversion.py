"""`yolino datasets convert` on the command line."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from .conftest import Run


@pytest.fixture
def labels(tmp_path: Path) -> Path:
    """Two images with a lane each."""
    root = tmp_path / "culane"
    (root / "a").mkdir(parents=True)
    (root / "list").mkdir()
    for name in ("0", "1"):
        cv2.imwrite(str(root / f"a/{name}.jpg"), np.zeros((64, 96, 3), np.uint8))
        (root / f"a/{name}.lines.txt").write_text("1 60 20 30 40 2\n")
    (root / "list/val.txt").write_text("/a/1.jpg\n")
    return root


def test_a_split_becomes_a_dataset_of_another_format(run: Run, labels: Path) -> None:
    code, out, err = run(
        "datasets", "convert", "--data", labels, "--split", "val", "--to", "cvat", "--out", "new"
    )
    assert (code, err) == (0, "")
    assert out.startswith("1 images as cvat -> new (its description: new/data.yaml)")
    assert Path("new/a/1.jpg").is_file()
    assert not Path("new/a/0.jpg").exists()
    code, out, _ = run("datasets", "check", "--data", "new")
    assert code == 0
    assert "polylines of class lane" in out


def test_what_a_format_cannot_hold_is_said(run: Run, labels: Path) -> None:
    arguments = ["--dataset", "culane", "--root", labels, "--images", "none"]
    code, _, err = run("datasets", "convert", *arguments, "--to", "curvelanes", "--out", "new")
    assert code == 0
    assert err == "The format curvelanes does not hold classes, ignored regions, scores, sizes.\n"


def test_broken_labels_stop_or_are_skipped_and_counted(run: Run, labels: Path) -> None:
    (labels / "a/0.lines.txt").write_text("1 2\n3 4 5\n")
    convert = ["datasets", "convert", "--data", labels, "--to", "coco", "--out", "new"]
    code, _, err = run(*convert)
    assert (code, Path("new").exists()) == (2, False)
    assert err.count("\n") == 1
    assert "0.lines.txt, line 2 has 3 values, but pairs x y are needed." in err
    code, out, err = run(*convert, "--skip-broken")
    assert code == 0
    assert "1 images as coco" in out
    assert "Skipped: " in err
    assert "1 broken part left out." in err


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--to", "word"], "The format 'word' cannot be written; use one of tusimple, culane"),
        (["--to", "cvat", "--images", "move"], "images is 'move'; use one of link, copy, none."),
        (["--to", "cvat", "--split", "test"], "has no split 'test'; it has val."),
        (["--to", "cvat", "--root", "."], "--data names the whole dataset: leave out --dataset and --root."),
        (["--to", "cvat", "--option", "colour=3"], "takes no colour; it takes root"),
    ],
)
def test_mistakes_are_told(run: Run, labels: Path, arguments: list[str], reason: str) -> None:
    code, out, err = run("datasets", "convert", "--data", labels, "--out", "new", *arguments)
    assert (code, out) == (2, "")
    assert reason in err
    assert err.count("\n") == 1


def test_a_split_needs_a_description(run: Run, labels: Path) -> None:
    arguments = ["--dataset", "culane", "--root", labels, "--split", "val", "--to", "cvat", "--out", "new"]
    code, _, err = run("datasets", "convert", *arguments)
    assert code == 2
    assert "--split needs --data" in err


def test_licence_stays_and_labels_are_not_replaced(run: Run, labels: Path) -> None:
    (labels / "data.yaml").write_text("format: culane\nsplits: {val: list/val.txt}\nlicence: research only\n")
    convert = ["datasets", "convert", "--data", labels, "--split", "val", "--to", "cvat", "--out", "new"]
    assert run(*convert)[0] == 0
    assert "licence: research only" in Path("new/data.yaml").read_text()
    code, _, err = run(*convert)
    assert code == 2
    assert "new holds labels already, which would be replaced" in err
    assert run(*convert, "--force")[0] == 0


def test_a_sheet_does_not_replace_an_image(run: Run, labels: Path) -> None:
    image = labels / "a/0.jpg"
    before = image.read_bytes()
    code, _, err = run("datasets", "show", "--data", labels, "--out", image)
    assert code == 2
    assert "would replace an image of the dataset: give another name." in err
    assert image.read_bytes() == before
