"""`yolino predict` on many images: several at a time, with the same results."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from yolino.cli.results import Found, Tally
from yolino.datasets.tusimple import benchmark_rows, polylines_to_record
from yolino.inference import load
from yolino.io import Result, read_image, to_json
from yolino.types import Polylines

from .conftest import Run

MANY = 30


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Images of different sizes; every fifth is black, where the model sees nothing."""
    path = tmp_path / "drive"
    path.mkdir()
    for i in range(MANY):
        size = (64 + 2 * (i % 7), 128 + 4 * (i % 3), 3)
        cv2.imwrite(str(path / f"{i:02d}.png"), np.full(size, 200 * (i % 5 > 0), np.uint8))
    return path


def results(folder: str = "yolino-out") -> dict[str, str]:
    return {path.name: path.read_text() for path in sorted(Path(folder).glob("*.json"))}


def test_each_result_is_that_of_the_image_alone(run: Run, model: Path, folder: Path) -> None:
    code, out, err = run("predict", "drive", "--model", model, "--no-images")
    assert (code, err) == (0, "")
    predictor = load(model)
    wanted = {}
    for path in sorted(folder.glob("*.png")):
        image = read_image(path)
        result = Result(f"drive/{path.name}", image.shape[:2], predictor(image), (), "tiny")
        wanted[f"{path.stem}.json"] = to_json(result)
    assert results() == wanted
    assert f"{MANY} images, {2 * (MANY - 6)} polylines, " in out
    assert re.search(
        r", \d+\.\d images per second(?: after \d+ s of loading)?, \d+\.\d ms per image -> yolino-out", out
    )


def test_the_table_is_short_and_in_order(run: Run, model: Path, folder: Path) -> None:
    _, out, _ = run("predict", "drive", "--model", model, "--no-images")
    assert re.findall(r"\d\d\.png", out) == [f"{i:02d}.png" for i in range(20)]
    assert f"... and {MANY - 20} more" in out


def test_pictures_are_those_of_the_images_alone(run: Run, model: Path, folder: Path) -> None:
    assert run("predict", "drive", "--model", model)[0] == 0
    for name in ("00", "07", "29"):
        assert run("predict", folder / f"{name}.png", "--model", model, "--out", "alone")[0] == 0
        assert Path(f"alone/{name}.png").read_bytes() == Path(f"yolino-out/{name}.png").read_bytes()


def test_the_submission_is_in_the_order_of_the_images(run: Run, model: Path, folder: Path) -> None:
    assert run("predict", "drive", "--model", model, "--format", "tusimple", "--no-images")[0] == 0
    assert [path.name for path in Path("yolino-out").iterdir()] == ["predictions.json"]
    records = [json.loads(line) for line in Path("yolino-out/predictions.json").read_text().splitlines()]
    paths = sorted(folder.glob("*.png"))
    assert [record["raw_file"] for record in records] == [f"drive/{path.name}" for path in paths]
    predictor = load(model)
    for path, record in zip(paths, records, strict=True):
        image = read_image(path)
        rows = benchmark_rows(image.shape[0])
        wanted = polylines_to_record("", predictor(image), rows, size=image.shape[:2], run_time=1.0)
        assert (record["lanes"], record["h_samples"]) == (wanted["lanes"], wanted["h_samples"])


def test_labels_are_in_the_order_of_the_images(run: Run, model: Path, folder: Path) -> None:
    assert run("predict", "drive", "--model", model, "--format", "cvat", "--no-images")[0] == 0
    text = Path("yolino-out/annotations.xml").read_text()
    assert re.findall(r'name="[^"]*?(\d\d\.png)"', text) == [f"{i:02d}.png" for i in range(MANY)]


def test_one_bad_image_does_not_stop_the_others(run: Run, model: Path, folder: Path) -> None:
    whole = (folder / "11.png").read_bytes()
    (folder / "11.png").write_bytes(whole[:-20])
    (folder / "17.png").write_bytes(b"")
    code, out, err = run("predict", "drive", "--model", model, "--no-images")
    assert code == 2
    assert [line.split(" is ")[0] for line in err.splitlines()] == [
        "Error: drive/11.png",
        "Error: drive/17.png",
    ]
    assert f"{MANY - 2} images, " in out
    assert len(results()) == MANY - 2


def test_a_failure_keeps_what_is_finished_and_leaves_no_thread(
    run: Run, model: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flush, calls = os.fsync, []

    def full(descriptor: int) -> None:
        calls.append(descriptor)
        if len(calls) > 12:
            raise OSError(28, "No space left on device")
        flush(descriptor)

    monkeypatch.setattr(os, "fsync", full)
    code, _, err = run("predict", "drive", "--model", model, "--no-images")
    assert code == 2
    assert "No space left on device" in err
    assert len(results()) == 12
    assert not [path for path in Path("yolino-out").iterdir() if path.suffix == ".tmp"]
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("yolino-")]


# Tests that run in the background inherit that Ctrl-C is ignored; a user's terminal does not ignore it.
IN_A_TERMINAL = (
    "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
    "from yolino.cli import main; sys.exit(main(sys.argv[1:]))"
)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_ctrl_c_keeps_what_was_finished(run: Run, model: Path, folder: Path, number: int) -> None:
    image = np.full((256, 512, 3), 90, np.uint8)
    for i in range(400):
        cv2.imwrite(str(folder / f"more{i:03d}.png"), image)
    command = [sys.executable, "-c", IN_A_TERMINAL, "predict", "drive", "--model", str(model)]
    process = subprocess.Popen(
        [*command, "--format", "tusimple"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    until = time.monotonic() + 100
    while len(list(Path("yolino-out").glob("*.png"))) < MANY + 5:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < until
        time.sleep(0.005)
    process.send_signal(number)
    out, err = process.communicate(timeout=100)
    assert process.returncode == 128 + number
    lines = Path("yolino-out/predictions.json").read_text().splitlines()
    names = [json.loads(line)["raw_file"] for line in lines]
    finished = len(names)
    assert MANY <= finished < MANY + 400
    assert names == [f"drive/{path.name}" for path in sorted(folder.iterdir())[:finished]]
    assert err.decode().splitlines()[-1] == f"Stopped after {finished} of {MANY + 400} images."
    assert f"{finished} images, " in out.decode()
    made = sorted(path.stem for path in Path("yolino-out").glob("*.png"))
    assert made == [Path(name).stem for name in names]  # no picture without its line


def test_what_is_told_at_the_end_takes_little_memory() -> None:
    tally = Tally(2)
    nothing = Polylines.from_list([])
    for i in range(1000):
        result = Result(f"{i}.jpg", (4, 8), nothing if i else Polylines.from_list([[(0, 0), (1, 1)]]))
        tally.add(Found(str(i), Path(f"{i}.jpg"), result, float(i)))
    assert tally.rows == [("0.jpg", 1, "0.0"), ("1.jpg", 0, "1.0")]
    assert tally.summary(Path("out"), 4.0) == (
        "1000 images, 1 polyline, 250.0 images per second, 499.5 ms per image -> out"
    )
    assert ", 250.0 images per second after 35 s of compiling, 499.5 ms" in tally.summary(
        Path("out"), 4.0, "after 35 s of compiling"
    )


def test_a_long_wait_is_told_to_a_file_too(capsys: pytest.CaptureFixture[str]) -> None:
    from yolino.cli.screen import busy

    with busy("loading"):
        assert capsys.readouterr().err == ""
    with busy("compiling", long=True):
        assert capsys.readouterr().err == "compiling ...\n"


def test_one_image_has_no_rate() -> None:
    tally = Tally(2)
    tally.add(Found("a", Path("a.jpg"), Result("a.jpg", (4, 8), Polylines.from_list([])), 3.0))
    assert tally.summary(Path("out"), 9.0) == "1 image, 0 polylines, 3.0 ms per image -> out"


def test_progress_shows_the_rate(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    from yolino.cli import images

    monkeypatch.setenv("FORCE_COLOR", "1")
    with images._progress(5) as advance:
        for _ in range(5):
            advance()
    shown: Any = capsys.readouterr().err
    assert "predicting" in shown
    assert "images/s" in shown
