from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from yolino.inference import video_writer
from yolino.inference.frames import Frame, has_av, open_frames
from yolino.inference.video_writer import CODECS, VideoWriter

needs_av = pytest.mark.skipif(not has_av(), reason="PyAV (extra video) is not installed")
ENCODERS = ["opencv", pytest.param("pyav", marks=needs_av)]


@pytest.fixture(params=ENCODERS)
def encoder(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Both encoders, one after the other: as if PyAV were not installed, and with it."""
    monkeypatch.setattr(video_writer, "has_av", lambda: request.param == "pyav")
    return str(request.param)


def frame(number: int, seconds: float, size: tuple[int, int] = (48, 64)) -> Frame:
    image = np.full((*size, 3), 20 + 8 * number, np.uint8)
    image[: size[0] // 2, : size[1] // 2] = (220, 30, 30)
    return Frame(number, seconds, image)


def write(path: Path, frames: list[Frame], rate: float | None = 10.0) -> None:
    add_all(VideoWriter(path, rate), frames)


def read(path: Path) -> list[Frame]:
    return list(open_frames(path))


def level(one: Frame) -> int:
    """The number that a picture shows."""
    return round((int(one.image[36, 48, 0]) - 20) / 8)


def add_all(writer: VideoWriter, frames: list[Frame]) -> None:
    with writer:
        for one in frames:
            writer.add(one)


def leftovers(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir() if path.name.startswith(".")]


@pytest.mark.parametrize("suffix", sorted(CODECS))
def test_what_is_written_can_be_read(tmp_path: Path, encoder: str, suffix: str) -> None:
    path = tmp_path / "new" / f"out{suffix}"
    write(path, [frame(i, i / 10) for i in range(8)])
    video = open_frames(path, reader="opencv")
    assert video.rate == pytest.approx(10)
    frames = list(video)
    assert len(frames) == 8
    for i, one in enumerate(frames):
        np.testing.assert_allclose(one.image[36, 48], 20 + 8 * i, atol=8)
        np.testing.assert_allclose(one.image[12, 16], (220, 30, 30), atol=30)
    assert leftovers(path.parent) == []


@pytest.mark.parametrize("suffix", [".mp4", ".avi"])
def test_odd_sizes_get_a_copy_of_the_last_row_and_column(tmp_path: Path, encoder: str, suffix: str) -> None:
    path = tmp_path / f"odd{suffix}"
    write(path, [frame(i, i / 10, (49, 65)) for i in range(3)])
    images = [one.image for one in open_frames(path)]
    assert [image.shape for image in images] == [(50, 66, 3)] * 3
    np.testing.assert_allclose(images[0][-1, -1], 20, atol=8)


def test_pictures_are_shown_at_their_times(tmp_path: Path, encoder: str) -> None:
    write(tmp_path / "out.mp4", [frame(i, s) for i, s in enumerate((0.0, 0.1, 0.5, 0.6))])
    shown = {level(one): one.seconds for one in reversed(read(tmp_path / "out.mp4"))}
    assert shown == pytest.approx({0: 0.0, 1: 0.1, 2: 0.5, 3: 0.6}, abs=0.01)


def test_frames_faster_than_the_rate_are_all_kept(tmp_path: Path, encoder: str) -> None:
    write(tmp_path / "out.mp4", [frame(i, i / 40) for i in range(8)])
    levels = [level(one) for one in read(tmp_path / "out.mp4")]
    assert levels == list(range(8))


def test_a_wrong_clock_gives_no_endless_video(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(video_writer, "has_av", lambda: False)
    write(tmp_path / "out.avi", [frame(0, 0.0), frame(1, 1e6), frame(2, 1e6 + 0.1)])
    assert len(read(tmp_path / "out.avi")) == 3 + 100


def test_the_file_appears_when_it_is_whole(tmp_path: Path, encoder: str) -> None:
    path = tmp_path / "out.mp4"
    path.write_text("what was there before")
    writer = VideoWriter(path, 10.0)
    writer.add(frame(0, 0.0))
    assert path.read_text() == "what was there before"
    writer.close()
    assert len(read(path)) == 1
    writer.close()  # twice does no harm
    assert leftovers(tmp_path) == []


def test_what_was_written_before_a_failure_is_a_video(tmp_path: Path, encoder: str) -> None:
    writer = VideoWriter(tmp_path / "out.mp4", 10.0)
    frames = [*(frame(i, i / 10) for i in range(3)), frame(3, 0.3, (24, 64))]
    with pytest.raises(ValueError, match=r"Frame 3 has another size .* \(24, 64\) after \(48, 64\)"):
        add_all(writer, frames)
    assert len(read(tmp_path / "out.mp4")) == 3


def test_without_frames_there_is_no_file(tmp_path: Path, encoder: str) -> None:
    (tmp_path / "out.mp4").write_text("before")
    write(tmp_path / "out.mp4", [])
    assert (tmp_path / "out.mp4").read_text() == "before"
    assert leftovers(tmp_path) == []


def test_an_unknown_rate_is_assumed(tmp_path: Path, encoder: str) -> None:
    write(tmp_path / "out.mp4", [frame(i, i / 30) for i in range(4)], None)
    assert open_frames(tmp_path / "out.mp4").rate == pytest.approx(30)


def test_what_cannot_be_written_is_refused_at_once(tmp_path: Path, encoder: str) -> None:
    with pytest.raises(ValueError, match=r"use a name in \.mp4"):
        VideoWriter(tmp_path / "out.gif", 10.0)
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match="cannot be written"):
        VideoWriter(tmp_path / "file" / "out.mp4", 10.0)


@needs_av
def test_pyav_writes_what_browsers_play(tmp_path: Path) -> None:
    av: Any = pytest.importorskip("av")
    write(tmp_path / "out.mp4", [frame(i, i / 10) for i in range(4)])
    with av.open(str(tmp_path / "out.mp4")) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.name == ("h264" if "libx264" in av.codecs_available else "mpeg4")
        assert stream.codec_context.pix_fmt == "yuv420p"
        assert stream.average_rate == 10


def test_opencv_tells_that_the_disk_is_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(video_writer, "has_av", lambda: False)
    writer = VideoWriter(tmp_path / "out.mp4", 10.0)
    writer.add(frame(0, 0.0))
    (broken,) = tmp_path.glob(".*.mp4")
    assert isinstance(writer._encoder, video_writer.OpenCVEncoder)
    writer._encoder._writer.release()
    broken.write_bytes(broken.read_bytes()[:40])
    with pytest.raises(OSError, match="is the disk full"):
        writer.close()
    assert list(tmp_path.iterdir()) == []
