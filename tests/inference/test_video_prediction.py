from __future__ import annotations

import dataclasses
import json
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from yolino.header import Header
from yolino.inference import Predictor, load
from yolino.inference.frames import Frame, open_frames
from yolino.inference.tracking import Tracker
from yolino.inference.video import FrameResult, VideoPrediction, draw_frame, link_segments
from yolino.inference.video_lines import LinesWriter, frame_json, read_lines
from yolino.inference.video_pipeline import Step
from yolino.io import from_json
from yolino.types import Polylines
from yolino.viz import palette

BRIGHT, BLACK = 200, 0


class MadeUp:
    """Frames of one brightness each; a live source waits between them."""

    name, rate, damaged = "made up", 10.0, 0

    def __init__(self, levels: list[int], *, live: bool = False, pause: float = 0.0) -> None:
        self.levels, self.live, self.pause = levels, live, pause
        self.count = None if live else len(levels)
        self.closed = 0

    def __iter__(self) -> Iterator[Frame]:
        try:
            for i, level in enumerate(self.levels):
                time.sleep(self.pause)
                yield Frame(i, i / 10, np.full((256, 256, 3), level, np.uint8))
        finally:
            self.close()

    def close(self) -> None:
        self.closed += 1


@pytest.fixture
def predictor(tiny_model: Path) -> Predictor:
    return load(tiny_model, device="cpu")


def test_every_frame_is_predicted_in_order(predictor: Predictor) -> None:
    source = MadeUp([BRIGHT, BLACK] * 6)
    results = list(VideoPrediction(predictor, source))
    assert [result.frame.index for result in results] == list(range(12))
    assert [len(result.polylines) for result in results] == [2, 0] * 6
    assert all(result.ids is None for result in results)
    expected = predictor(results[0].frame.image)
    np.testing.assert_allclose(results[0].polylines.vertices, expected.vertices, atol=1e-6)
    np.testing.assert_array_equal(results[0].polylines.scores, expected.scores)
    assert source.closed


@pytest.mark.parametrize("fit", ["bottom", "letterbox", "stretch", "window"])
def test_linking_apart_gives_what_the_predictor_gives(
    make_model: Callable[..., Path], header: Header, tmp_path: Path, fit: str
) -> None:
    if fit == "window":
        pytest.importorskip("yolino.inference.windows")
        changed = dataclasses.replace(header, fit=fit, size=(64, 128), scale=0.5)
        endpoints = np.zeros((32, 2, 2), np.float32)
        rows, columns = np.divmod(np.arange(32), 8)
        endpoints[:, :, 0] = 16 * columns[:, None] + 8
        endpoints[:, :, 1] = 16 * rows[:, None] + np.array([16, 0])
        model = make_model(tmp_path / "window.onnx", header=changed, endpoints=endpoints)
    else:
        model = make_model(tmp_path / f"{fit}.onnx", header=dataclasses.replace(header, fit=fit))
    predictor = load(model, device="cpu")
    image = np.full((180, 300, 3), BRIGHT, np.uint8)
    expected = predictor(image)
    found = link_segments(predictor, predictor.segments(image), (180, 300))
    assert len(found) == len(expected) > 0
    np.testing.assert_allclose(found.vertices, expected.vertices, atol=1e-6)
    np.testing.assert_array_equal(found.offsets, expected.offsets)
    np.testing.assert_allclose(found.scores, expected.scores)


def test_identities_last_while_the_picture_is_black(predictor: Predictor) -> None:
    source = MadeUp([BRIGHT] * 3 + [BLACK] * 4 + [BRIGHT] * 2)
    results = list(VideoPrediction(predictor, source, tracker=Tracker()))
    ids = [[] if result.ids is None else result.ids.tolist() for result in results]
    assert ids == [[1, 2]] * 3 + [[]] * 4 + [[1, 2]] * 2
    held = list(VideoPrediction(predictor, MadeUp([BRIGHT, BLACK]), tracker=Tracker(smooth=True)))[1]
    assert held.seen is not None
    assert held.seen.tolist() == [False, False]
    assert len(held.polylines) == 2


def test_it_stops_after_the_frames_that_are_wanted(predictor: Predictor) -> None:
    drawn: list[int] = []

    def draw(result: FrameResult) -> FrameResult:
        drawn.append(result.frame.index)
        return result

    for live in (False, True):
        drawn.clear()
        source = MadeUp([BRIGHT] * 1000, live=live, pause=0.001)
        prediction = VideoPrediction(predictor, source, frames=5, finish=[Step("drawing", draw)])
        results = list(prediction)
        assert len(results) == 5
        assert drawn == [result.frame.index for result in results]
        assert source.closed
    with pytest.raises(ValueError, match="at least 1"):
        VideoPrediction(predictor, MadeUp([]), frames=0)


def test_a_camera_drops_what_there_is_no_time_for(predictor: Predictor) -> None:
    def slow(result: FrameResult) -> FrameResult:
        time.sleep(0.03)
        return result

    source = MadeUp([BRIGHT] * 60, live=True, pause=0.004)
    prediction = VideoPrediction(predictor, source, finish=[Step("drawing", slow)])
    shown = [result.frame.index for result in prediction]
    assert shown == sorted(set(shown))
    assert len(shown) < 40
    assert prediction.dropped == 60 - len(shown)
    assert set(prediction.seconds) == {"reading", "network", "linking", "drawing"}


def test_a_failure_in_a_step_reaches_the_caller(predictor: Predictor) -> None:
    def fail(result: FrameResult) -> FrameResult:
        raise OSError("the disk is full")

    with pytest.raises(OSError, match="the disk is full"):
        list(VideoPrediction(predictor, MadeUp([BRIGHT] * 100), finish=[Step("encoding", fail)]))
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("yolino-")]


def result(*, ids: list[int] | None = None, seen: list[bool] | None = None) -> FrameResult:
    lines = Polylines.from_list([[(10, 50), (90, 50)], [(10.006, 80), (90, 80)]], [0.9, 0.81234], [0, 1])
    frame = Frame(7, 0.28, np.zeros((1000, 1001, 3), np.uint8))
    return FrameResult(
        frame,
        lines,
        None if ids is None else np.array(ids),
        None if seen is None else np.array(seen),
    )


def test_colors_follow_the_identities() -> None:
    for ids in ([1, 2], [3, 1]):
        drawn = draw_frame(result(ids=ids), directed=False).picture
        assert drawn is not None
        for row, number in zip((50, 80), ids, strict=True):
            np.testing.assert_array_equal(drawn[row, 50], palette(np.array([number - 1]))[0])
    assert (result().frame.image == 0).all()
    by_label = draw_frame(result(ids=[8, 9]), color_by="label", directed=False).picture
    assert by_label is not None
    np.testing.assert_array_equal(by_label[50, 50], palette(np.array([0]))[0])


def test_a_line_of_json_by_hand() -> None:
    text = frame_json(result(ids=[3, 5], seen=[True, False]), "drive.mp4", ("a", "b"), "tiny")
    assert text.count("\n") == 1
    document = json.loads(text)
    assert list(document)[:2] == ["frame", "seconds"]
    assert (document["frame"], document["seconds"], document["image"]) == (7, 0.28, "drive.mp4")
    assert document["size"] == [1000, 1001]
    assert document["polylines"] == [
        {"points": [[10.0, 50.0], [90.0, 50.0]], "score": 0.9, "label": 0, "id": 3},
        {"points": [[10.01, 80.0], [90.0, 80.0]], "score": 0.8123, "label": 1, "id": 5, "seen": False},
    ]
    assert document["classes"] == ["a", "b"]
    assert from_json(text).size == (1000, 1001)
    assert "id" not in json.loads(frame_json(result(), "drive.mp4"))["polylines"][0]
    empty = FrameResult(Frame(0, 0.0, np.zeros((2, 3, 3), np.uint8)), Polylines.from_list([]))
    assert json.loads(frame_json(empty, "x"))["polylines"] == []


def test_lines_are_read_again(tmp_path: Path) -> None:
    path = tmp_path / "new" / "out.jsonl"
    with LinesWriter(path) as writer:
        for ids in ([1, 2], [2, 3]):
            writer.add(frame_json(result(ids=ids), "drive.mp4"))
            assert path.read_bytes().endswith(b"}\n")  # at once
    lines = list(read_lines(path))
    assert [line.ids for line in lines] == [(1, 2), (2, 3)]
    assert (lines[0].frame, lines[0].seconds) == (7, 0.28)
    np.testing.assert_allclose(lines[0].result.polylines.vertices, result().polylines.vertices, atol=0.01)


def test_a_last_line_that_is_cut_is_left_out(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    line = frame_json(result(), "drive.mp4")
    (tmp_path / "out.jsonl").write_text(line + line[:50])
    assert len(list(read_lines(tmp_path / "out.jsonl"))) == 1
    assert "line 2 is cut" in caplog.text


def test_broken_lines_are_named(tmp_path: Path) -> None:
    path = tmp_path / "out.jsonl"
    good = frame_json(result(), "drive.mp4")
    for bad, told in (("{", "line 2 is not"), ('{"frame": 1}', "line 2: the key"), ("[]", "line 2 is not")):
        path.write_text(good + bad + "\n")
        with pytest.raises(ValueError, match=told):
            list(read_lines(path))
    with pytest.raises(FileNotFoundError, match="There is no file"):
        list(read_lines(tmp_path / "missing.jsonl"))


def test_what_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match="cannot be written"):
        LinesWriter(tmp_path / "file" / "out.jsonl")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_a_full_disk_is_told() -> None:
    with pytest.raises(OSError, match="The lines before are there"), LinesWriter("/dev/full") as writer:
        writer.add("{}\n")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signal")
def test_a_killed_run_leaves_whole_lines(tmp_path: Path) -> None:
    code = (
        "from yolino.inference.video_lines import LinesWriter\n"
        "with LinesWriter('out.jsonl') as writer:\n"
        "    while True:\n"
        "        writer.add('{\"long\": \"' + 9999 * 'x' + '\"}\\n')\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path)
    path, deadline = tmp_path / "out.jsonl", time.monotonic() + 30
    while not (path.exists() and path.stat().st_size > 1e6) and time.monotonic() < deadline:
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    lines = path.read_text().splitlines(keepends=True)
    assert len(lines) > 90
    whole = len('{"long": ""}\n') + 9999
    assert {len(line) for line in lines[:-1]} == {whole}
    assert (len(lines[-1]) == whole) == lines[-1].endswith("\n")


def test_a_real_video_from_the_file_to_the_lines(predictor: Predictor, tmp_path: Path) -> None:
    writer = cv2.VideoWriter(str(tmp_path / "a.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10, (128, 64))
    for _ in range(5):
        writer.write(np.full((64, 128, 3), BRIGHT, np.uint8))
    writer.release()
    results = list(VideoPrediction(predictor, open_frames(tmp_path / "a.avi"), tracker=Tracker()))
    assert [len(one.polylines) for one in results] == [2] * 5
    assert sorted({round(float(line[0, 0])) for one in results for line in one.polylines}) == [40, 88]
