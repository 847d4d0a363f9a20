from __future__ import annotations

import functools
import http.server
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from yolino.inference.frames import has_av, is_live, names_video, open_frames, public_name

READERS = [
    "opencv",
    pytest.param(
        "pyav", marks=pytest.mark.skipif(not has_av(), reason="PyAV (extra video) is not installed")
    ),
]
needs_av = pytest.mark.skipif(not has_av(), reason="PyAV (extra video) is not installed")
Make = Callable[..., Path]


def picture(number: int, size: tuple[int, int]) -> np.ndarray:
    """Gray of a brightness that says the number, red in the upper left quarter, as RGB."""
    image = np.full((*size, 3), 20 + 8 * number, np.uint8)
    image[: size[0] // 2, : size[1] // 2] = (220, 30, 30)
    return image


@pytest.fixture
def make(tmp_path: Path) -> Make:
    def write(name: str, *, count: int = 10, size: tuple[int, int] = (48, 64), code: str = "mp4v") -> Path:
        writer = cv2.VideoWriter(str(tmp_path / name), cv2.VideoWriter.fourcc(*code), 12.5, size[::-1])
        for i in range(count):
            writer.write(picture(i, size)[:, :, ::-1])
        writer.release()
        return tmp_path / name

    return write


def mux(path: Path, *, rotation: int = 0, ticks: tuple[int, ...] = (0, 100, 150, 400), gop: int = 12) -> None:
    """Writes a video with PyAV: one picture at each time in milliseconds."""
    av: Any = pytest.importorskip("av", reason="PyAV (extra video) is not installed")
    base = Fraction(1, 1000)
    with av.open(str(path), "w", options={"movflags": "faststart"}) as container:
        stream = container.add_stream("mpeg4", rate=10, options={"qscale": "2", "g": str(gop)})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        stream.codec_context.time_base = base
        if rotation:
            if not hasattr(stream, "set_display_rotation"):
                pytest.skip("this version of PyAV writes no rotation")
            stream.set_display_rotation(rotation)
        for i, tick in enumerate(ticks):
            frame = av.VideoFrame.from_ndarray(picture(i, (48, 64)), format="rgb24")
            frame.pts, frame.time_base = tick, base
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize(
    ("name", "code"), [("a.mp4", "mp4v"), ("a.avi", "MJPG"), ("a.mkv", "mp4v"), ("a.mov", "mp4v")]
)
def test_frames_come_in_order_as_rgb_with_their_times(make: Make, reader: str, name: str, code: str) -> None:
    path = make(name, code=code)
    video = open_frames(path, reader=reader)
    assert (video.rate, video.count, video.live, video.name) == (12.5, 10, False, str(path))
    frames = list(video)
    assert [frame.index for frame in frames] == list(range(10))
    np.testing.assert_allclose([frame.seconds for frame in frames], np.arange(10) / 12.5, atol=1e-3)
    for i, frame in enumerate(frames):
        assert frame.image.shape == (48, 64, 3)
        assert frame.image.dtype == np.uint8
        np.testing.assert_allclose(frame.image[36, 48], 20 + 8 * i, atol=6)
        np.testing.assert_allclose(frame.image[12, 16], (220, 30, 30), atol=25)
    assert video.damaged == 0


@pytest.mark.parametrize("reader", READERS)
def test_rotation_is_applied(tmp_path: Path, reader: str) -> None:
    corners = {0: (0, 0), 90: (-1, 0), 180: (-1, -1), -90: (0, -1)}  # where red goes, counter-clockwise
    for rotation, (row, column) in corners.items():
        mux(tmp_path / "turned.mp4", rotation=rotation)
        image = next(iter(open_frames(tmp_path / "turned.mp4", reader=reader))).image
        assert image.shape == ((48, 64, 3) if rotation in (0, 180) else (64, 48, 3))
        red = [(y, x) for y in (0, -1) for x in (0, -1) if np.ptp(image[_in(y), _in(x)].astype(int)) > 100]
        assert red == [(row, column)]


def _in(corner: int) -> int:
    return 4 if corner == 0 else -5


@pytest.mark.parametrize("reader", READERS)
def test_times_of_a_variable_frame_rate_are_kept(tmp_path: Path, reader: str) -> None:
    mux(tmp_path / "variable.mp4", ticks=(0, 100, 150, 400, 1400))
    seconds = [frame.seconds for frame in open_frames(tmp_path / "variable.mp4", reader=reader)]
    np.testing.assert_allclose(seconds, [0, 0.1, 0.15, 0.4, 1.4], atol=2e-3)


@pytest.mark.parametrize("reader", READERS)
def test_a_video_that_ends_early_gives_the_frames_that_are_there(make: Make, reader: str) -> None:
    whole = make("whole.avi", count=20, code="MJPG")
    cut = whole.with_name("cut.avi")
    data = whole.read_bytes()
    cut.write_bytes(data[: (data.index(b"movi") + data.rindex(b"idx1")) // 2])
    video = open_frames(cut, reader=reader)
    frames = list(video)
    assert video.count == 20
    assert 5 <= len(frames) < 15
    for i, frame in enumerate(frames[:-1]):
        np.testing.assert_allclose(frame.image[36, 48], 20 + 8 * i, atol=6)


@needs_av
def test_damage_in_the_middle_is_counted(tmp_path: Path) -> None:
    path = tmp_path / "damaged.mp4"
    mux(path, ticks=tuple(range(0, 2000, 100)), gop=1)
    data = bytearray(path.read_bytes())
    middle = data.index(b"mdat") + (len(data) - data.index(b"mdat")) // 2
    data[middle : middle + 1500] = bytes(1500)
    path.write_bytes(data)
    video = open_frames(path, reader="pyav")
    assert len(list(video)) + video.damaged >= 15
    assert video.damaged > 0


@pytest.mark.parametrize("reader", READERS)
def test_what_is_no_video_is_refused_in_one_sentence(tmp_path: Path, make: Make, reader: str) -> None:
    (tmp_path / "text.mp4").write_text("no video\n" * 50)
    (tmp_path / "empty.mp4").touch()
    make("whole.mp4")
    (tmp_path / "headless.mp4").write_bytes((tmp_path / "whole.mp4").read_bytes()[:-700])
    for name, sentence in (
        ("text.mp4", "damaged or not a video"),
        ("headless.mp4", "damaged or not a video"),
        ("empty.mp4", r"empty \(0 bytes\)"),
        (".", "is a folder"),
        ("camera:7", "does not answer"),
        ("camera:", "is no camera"),
        ("camera:one", "is no camera"),
        ("rtsp://user:secret@127.0.0.1:9/x", r"rtsp://127.0.0.1:9/x cannot be opened"),
    ):
        source = name if ":" in name else tmp_path / name
        with pytest.raises(ValueError, match=sentence) as told:
            open_frames(source, reader=reader)
        assert "\n" not in str(told.value)
        assert "secret" not in str(told.value)
    with pytest.raises(FileNotFoundError, match="There is no video file"):
        open_frames(tmp_path / "missing.mp4", reader=reader)
    with pytest.raises(ValueError, match="must be one of auto, pyav, opencv"):
        open_frames(tmp_path / "whole.mp4", reader="gstreamer")


def test_nothing_is_written_beside_the_sentence(tmp_path: Path) -> None:
    (tmp_path / "text.mp4").write_text("no video\n" * 50)
    code = (
        "from yolino.inference.frames import open_frames\n"
        "for source in ('text.mp4', 'camera:9'):\n"
        "    for reader in ('opencv', 'auto'):\n"
        "        try: open_frames(source, reader=reader)\n"
        "        except ValueError: pass\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, timeout=60, check=True
    )
    assert (done.stdout, done.stderr) == (b"", b"")


@needs_av
def test_sound_alone_is_no_video(tmp_path: Path) -> None:
    av: Any = pytest.importorskip("av")
    with av.open(str(tmp_path / "sound.mp4"), "w") as container:
        stream = container.add_stream("aac", rate=8000)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), format="fltp", layout="mono")
        frame.sample_rate = 8000
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    with pytest.raises(ValueError, match="has no pictures"):
        open_frames(tmp_path / "sound.mp4", reader="pyav")


@pytest.fixture
def web(tmp_path: Path) -> Iterator[str]:
    """The folder of the test as a web page."""

    class Silent(http.server.SimpleHTTPRequestHandler):
        def log_message(self, format: str, *args: object) -> None:
            pass

    handler = functools.partial(Silent, directory=str(tmp_path))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


@pytest.mark.parametrize("reader", READERS)
def test_a_video_on_the_web_is_read(make: Make, web: str, reader: str) -> None:
    make("a.avi", code="MJPG")
    assert len(list(open_frames(f"{web}/a.avi", reader=reader))) == 10


def test_the_name_says_what_is_a_video() -> None:
    for name in (
        "a.mp4",
        "b/C.MOV",
        "camera:0",
        "rtsp://x/y",
        "https://x/y.m3u8",
        "http://cam/live",
        "x.avi",
    ):
        assert names_video(name), name
    for name in ("a.jpg", "folder", "*.png", "https://x/a.png", "http://x/a.JPG?size=1", "scene.tif", "mp4"):
        assert not names_video(name), name
    assert is_live("camera:0")
    assert is_live("RTSP://x")
    assert not is_live("https://x/a.mp4")
    assert public_name("rtsp://me:pass@word@cam/x?a=b@c") == "rtsp://cam/x?a=b@c"
    assert public_name("a@b.mp4") == "a@b.mp4"


def test_the_source_is_given_back(make: Make) -> None:
    path = make("a.avi", code="MJPG")
    video = open_frames(path, reader="opencv")
    frames = iter(video)
    next(frames)
    frames.close()  # type: ignore[attr-defined]
    video.close()
    assert list(open_frames(shutil.copy(path, path.with_name("b.avi")), reader="opencv"))
