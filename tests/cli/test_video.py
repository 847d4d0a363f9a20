from __future__ import annotations

import json
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
import typer

from yolino.cli.video import Video, are_videos, find_targets
from yolino.cli.video_run import Targets, VideoRun
from yolino.inference import load
from yolino.inference.frames import Frame, open_frames
from yolino.inference.video_lines import read_lines

from .conftest import Run


def make(
    name: str, *, count: int = 6, size: tuple[int, int] = (64, 128), black: tuple[int, ...] = ()
) -> Path:
    """Writes a bright video, in which the tiny model sees two lines, with some black frames."""
    code = "MJPG" if name.endswith(".avi") else "mp4v"
    writer = cv2.VideoWriter(name, cv2.VideoWriter.fourcc(*code), 10.0, size[::-1])
    for i in range(count):
        writer.write(np.full((*size, 3), 0 if i in black else 200, np.uint8))
    writer.release()
    return Path(name)


def files(folder: Path | str = ".") -> list[str]:
    root = Path(folder)
    return sorted(path.relative_to(root).as_posix() for path in root.rglob("*") if path.is_file())


@pytest.mark.parametrize("name", ["drive.mp4", "drive.avi"])
def test_a_folder_gets_a_video_and_json_lines(run: Run, model: Path, name: str) -> None:
    make(name, black=(2,))
    code, out, err = run("predict", name, "--model", model)
    assert (code, err) == (0, "")
    assert files("yolino-out") == ["drive.jsonl", "drive.mp4"]
    lines = [json.loads(line) for line in Path("yolino-out/drive.jsonl").read_text().splitlines()]
    assert [line["frame"] for line in lines] == list(range(6))
    assert [line["seconds"] for line in lines] == pytest.approx([i / 10 for i in range(6)], abs=1e-3)
    ids = [[one["id"] for one in line["polylines"]] for line in lines]
    assert ids == [[1, 2], [1, 2], [], [1, 2], [1, 2], [1, 2]]
    assert lines[0]["image"] == name
    assert lines[0]["size"] == [64, 128]
    assert lines[0]["model"] == "tiny"
    frames = [frame.image for frame in open_frames("yolino-out/drive.mp4")]
    assert [frame.shape for frame in frames] == [(64, 128, 3)] * 6
    spread = [np.ptp(frame[40].astype(int)) for frame in frames]
    assert all((value > 60) == (i != 2) for i, value in enumerate(spread))  # lines are drawn where they are
    assert "6 frames" in out
    assert "10 polylines, 2 identities -> yolino-out/drive.mp4, yolino-out/drive.jsonl" in out
    for step in ("reading", "network", "linking", "drawing", "encoding"):
        assert step in out


def test_a_file_gets_what_its_suffix_says(run: Run, model: Path) -> None:
    make("drive.mp4")
    for out in ("new/out.mp4", "out.avi", "out.mkv", "out.mov", "out.jsonl"):
        assert run("predict", "drive.mp4", "--model", model, "--out", out)[0] == 0
    assert files() == ["drive.mp4", "new/out.mp4", "out.avi", "out.jsonl", "out.mkv", "out.mov", "tiny.onnx"]
    assert len(list(read_lines("out.jsonl"))) == 6
    for name in ("new/out.mp4", "out.avi", "out.mkv", "out.mov"):
        assert len(list(open_frames(name))) == 6
    assert run("predict", "drive.mp4", "--model", model, "--out", "only", "--no-images")[0] == 0
    assert files("only") == ["drive.jsonl"]


def test_smooth_fills_gaps_and_no_track_gives_no_identities(run: Run, model: Path) -> None:
    make("drive.mp4", black=(2,))
    assert run("predict", "drive.mp4", "-m", model, "--out", "a.jsonl", "--smooth")[0] == 0
    lines = [json.loads(line) for line in Path("a.jsonl").read_text().splitlines()]
    assert [len(line["polylines"]) for line in lines] == [2] * 6
    assert [one.get("seen", True) for one in lines[2]["polylines"]] == [False, False]
    assert run("predict", "drive.mp4", "-m", model, "--out", "b.jsonl", "--no-track")[0] == 0
    assert all(line.ids == () for line in read_lines("b.jsonl"))


def test_frames_stops_early_without_complaint(run: Run, model: Path) -> None:
    make("drive.mp4", count=30)
    code, out, err = run("predict", "drive.mp4", "-m", model, "--frames", 4)
    assert (code, err) == (0, "")
    assert "4 frames" in out
    assert len(list(read_lines("yolino-out/drive.jsonl"))) == 4
    assert len(list(open_frames("yolino-out/drive.mp4"))) == 4


def test_several_videos_and_globs(run: Run, model: Path) -> None:
    for name in ("a/drive.mp4", "b/drive.mp4", "c.avi"):
        Path(name).parent.mkdir(exist_ok=True)
        make(name, count=2)
    Path("broken.mp4").write_text("no video")
    code, out, err = run("predict", "*/*.mp4", "c.avi", "broken.mp4", "-m", model)
    assert code == 2
    assert err == "Error: broken.mp4 is damaged or not a video of a known kind.\n"
    names = ["a/drive", "b/drive", "c"]
    assert files("yolino-out") == sorted(f"{name}.{end}" for name in names for end in ("jsonl", "mp4"))
    assert out.count("2 frames") == 3


def test_a_video_that_ends_early_is_worth_a_warning(run: Run, model: Path) -> None:
    whole = make("whole.avi", count=20)
    data = whole.read_bytes()
    Path("cut.avi").write_bytes(data[: (data.index(b"movi") + data.rindex(b"idx1")) // 2])
    code, out, err = run("predict", "cut.avi", "-m", model)
    assert code == 0
    frames = len(list(read_lines("yolino-out/cut.jsonl")))
    assert 5 <= frames < 15
    assert err.startswith(f"Warning: cut.avi ends early: {frames} of 20 frames could be read")
    assert err.count("\n") == 1
    assert f"{frames} frames" in out
    assert len(list(open_frames("yolino-out/cut.mp4"))) == frames


def test_odd_sizes_keep_their_coordinates(run: Run, model: Path) -> None:
    writer = cv2.VideoWriter("odd.avi", cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (128, 64))
    writer.release()
    make("even.mp4", count=2, size=(66, 130))
    assert run("predict", "even.mp4", "-m", model)[0] == 0
    (line, _) = read_lines("yolino-out/even.jsonl")
    assert line.result.size == (66, 130)
    code, _, err = run("predict", "odd.avi", "-m", model)
    assert code == 2
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["missing.mp4"], "There is no video file missing.mp4."),
        (["text.mp4"], "text.mp4 is damaged or not a video of a known kind."),
        (["empty.mp4"], "empty.mp4 is empty (0 bytes), not a video."),
        (["camera:9"], "camera:9 does not answer"),
        (["camera:front"], "camera:front is no camera: give camera:0"),
        (["nothing*.mp4"], "The pattern nothing*.mp4 names no video."),
        (["drive.mp4", "photo.jpg"], "photo.jpg is no video, but others are"),
        (
            ["drive.mp4", "--out", "drive.mp4"],
            "drive.mp4 would replace a source video: choose another --out.",
        ),
        (["drive.mp4", "--out", "."], "drive.mp4 would replace a source video: choose another --out."),
        (["drive.mp4", "--out", "out.gif"], "--out out.gif has the unknown ending .gif; a scene goes into"),
        (["drive.mp4", "text.mp4", "--out", "out.mp4"], "--out out.mp4 is one file for 2 videos"),
        (["drive.mp4", "--out", "out.mp4", "--no-images"], "--no-images wants none"),
        (["drive.mp4", "--out", "text.mp4/out.mp4"], "text.mp4/out.mp4 cannot be written"),
        (["drive.mp4", "--out", "text.mp4/out.jsonl"], "text.mp4/out.jsonl cannot be written"),
        (["drive.mp4", "--format", "tusimple"], "Videos give JSON lines, not the format 'tusimple'"),
        (["drive.mp4", "--view", "stages"], "Videos show lines, not the view 'stages'"),
        (["drive.mp4", "--smooth", "--no-track"], "--smooth needs to know which line is which"),
        (["drive.mp4", "--out", "a.gpkg"], "--out a.gpkg is neither a folder nor a file in .mp4"),
        (
            ["drive.mp4", "--out", "out.mpp4"],
            "unknown ending .mpp4 (did you mean out.mp4?); a scene goes into",
        ),
        (["drive.mp4", "--overlap", "64"], "--overlap is for scenes, but drive.mp4 is a video (by its name)"),
        (["drive.mp4", "--scale", "1", "--out", "vsc"], "--scale is for scenes, but drive.mp4 is a video"),
        (["drive.mp4", "--bands", "1", "--out", "a.gpkg"], "--bands is for scenes, but drive.mp4 is a video"),
        (
            ["drive.mp4", "--out", "there.mp4"],
            "--out there.mp4 exists already and is not replaced: remove it",
        ),
        (["drive.mp4", "--out", "there.jsonl"], "--out there.jsonl exists already and is not replaced"),
        (["photo.jpg", "--out", "out.mp4"], "--out out.mp4 is for a video, but photo.jpg is none"),
        (["photo.jpg", "--smooth"], "--smooth is for videos, but photo.jpg is none"),
        (["photo.jpg", "--frames", "3"], "--frames is for videos, but photo.jpg is none"),
    ],
)
def test_a_mistake_is_told_in_one_sentence(
    run: Run, model: Path, photo: Path, arguments: list[str], told: str
) -> None:
    make("drive.mp4", count=2)
    Path("text.mp4").write_text("no video\n" * 30)
    Path("empty.mp4").touch()
    for name in ("there.mp4", "there.jsonl"):
        Path(name).write_text("mine")
    before = {name: Path(name).read_bytes() for name in files()}
    code, out, err = run("predict", *arguments, "--model", model)
    assert code == 2
    assert out == ""
    assert err.startswith("Error: ")
    assert err.count("\n") == 1
    assert told in err
    assert {name: Path(name).read_bytes() for name in files()} == before  # nothing is left, nothing replaced


def test_a_folder_has_the_results_of_the_last_run(run: Run, model: Path) -> None:
    make("drive.mp4", count=3)
    for out in ("found", "found", "a.mp4/"):  # whose name looks like a video's
        assert run("predict", "drive.mp4", "-m", model, "--out", out)[0] == 0
        assert files(out) == ["drive.jsonl", "drive.mp4"]


def test_sources_are_videos_or_not() -> None:
    assert are_videos(["a.mp4", "camera:0"])
    assert not are_videos(["a.jpg", "folder"])
    assert are_videos(["a.mp4"], Video(True, True, 3))


def test_names_of_results() -> None:
    address = "rtsp://me:secret@10.0.0.7:554/front?x=1"
    (camera, stream) = find_targets(["camera:0", address], Path("new"), pictures=True)
    assert camera == Targets("camera:0", Path("new/camera-0.mp4"), Path("new/camera-0.jsonl"))
    assert stream.source == address
    assert stream.lines == Path("new/rtsp-10-0-0-7-554-front-x-1.jsonl")


class Endless:
    """A source that never ends by itself; after some frames, the user presses Ctrl-C."""

    name, rate, count, damaged = "endless", 10.0, None, 0

    def __init__(self, *, live: bool, number: int = signal.SIGINT) -> None:
        self.live, self.number = live, number

    def __iter__(self) -> Iterator[Frame]:
        index = 0
        while True:
            if index == 8:
                signal.raise_signal(self.number)
            yield Frame(index, index / 10, np.full((64, 128, 3), 200, np.uint8))
            time.sleep(0.02)
            index += 1

    def close(self) -> None:
        pass


@pytest.mark.parametrize("live", [False, True])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_ends_properly(
    tiny_model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], live: bool, number: int
) -> None:
    before = signal.getsignal(number)
    target = Targets("endless", tmp_path / "out.mp4", tmp_path / "out.jsonl")
    predictor = load(tiny_model, device="cpu")
    run = VideoRun(predictor, Endless(live=live, number=number), target, tracker=None, frames=None)
    if live:
        assert run() == []
    else:
        with pytest.raises(typer.Exit) as stopped:
            run()
        assert stopped.value.exit_code == 128 + number
    lines = list(read_lines(tmp_path / "out.jsonl"))
    assert 1 <= len(lines) <= 40
    assert len(list(open_frames(tmp_path / "out.mp4"))) == len(lines)
    assert f"{len(lines)} frame" in capsys.readouterr().out
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.jsonl", "out.mp4"]
    assert signal.getsignal(number) is before
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("yolino-")]


def test_what_was_found_before_a_failure_is_kept(tiny_model: Path, tmp_path: Path) -> None:
    class Unplugged(Endless):
        def __iter__(self) -> Iterator[Frame]:
            for frame in super().__iter__():
                if frame.index == 5:
                    raise OSError("the cable")
                yield frame

    target = Targets("endless", tmp_path / "out.mp4", tmp_path / "out.jsonl")
    run = VideoRun(load(tiny_model, device="cpu"), Unplugged(live=False), target, tracker=None, frames=None)
    with pytest.raises(OSError, match="the cable"):
        run()
    assert len(list(read_lines(tmp_path / "out.jsonl"))) == 5
    assert len(list(open_frames(tmp_path / "out.mp4"))) == 5


def test_oddities_of_a_camera_are_told(
    tiny_model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    class Odd(Endless):
        rate, damaged = None, 2

        def __iter__(self) -> Iterator[Frame]:
            for frame in super().__iter__():
                yield frame
                if frame.index == 3:
                    return

    target = Targets("endless", None, tmp_path / "out.jsonl")
    run = VideoRun(load(tiny_model, device="cpu"), Odd(live=True), target, tracker=None, frames=None)
    assert run() == []
    told = capsys.readouterr().err
    assert told.startswith("Warning: endless gave no more frames after ")
    assert "; it has 2 damaged parts" in told
    assert "30 per second are assumed" in told
    assert told.count("\n") == 1
