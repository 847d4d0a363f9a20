"""Where frames come from: video files, cameras and streams, behind one small interface."""

from __future__ import annotations

import importlib.util
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

from jaxtyping import UInt8
from numpy import ndarray

from yolino.image import IMAGE_SUFFIXES

VIDEO_SUFFIXES = (
    *(".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi", ".mpg", ".mpeg", ".ts", ".m2ts", ".mts", ".wmv"),
    *(".flv", ".3gp", ".ogv", ".mjpg", ".mjpeg", ".y4m", ".h264", ".h265", ".hevc", ".m3u8"),
)
"""Suffixes of files that are taken for videos, in lower case."""

CAMERA = "camera:"
_LIVE = ("rtsp://", "rtsps://", "rtmp://", "udp://", "srt://", "tcp://")
_WEB = ("http://", "https://")
READERS = ("auto", "pyav", "opencv")
ASSUMED_RATE = 30.0


@dataclass(frozen=True, eq=False)
class Frame:
    """One picture of a video.

    Attributes:
        index: How many frames came before it, including those that a camera's reader had no time for.
        seconds: Time since the first frame.
        image: RGB pixels, upright.
    """

    index: int
    seconds: float
    image: UInt8[ndarray, "h w 3"]


@runtime_checkable
class FrameReader(Protocol):
    """An open video, camera or stream, whose frames can be iterated once.

    Attributes:
        name: What the user called it.
        rate: Frames per second as the source states them; None where it does not.
        count: Number of frames that the source promises; None where it does not, as with cameras.
        live: Whether frames come when they happen, so that late ones are worth nothing.
        damaged: How many pieces of the source could not be decoded so far.
    """

    name: str
    rate: float | None
    count: int | None
    live: bool
    damaged: int

    def __iter__(self) -> Iterator[Frame]:
        """Yields the frames in their order, then closes the source."""
        ...

    def close(self) -> None:
        """Gives the source back; in the thread that iterates, or where none does."""
        ...


def names_video(source: str) -> bool:
    """Tells whether `source` is a video file, a camera or a stream, by its name alone."""
    low = source.lower()
    if low.startswith(_WEB):
        return not low.split("?")[0].endswith(IMAGE_SUFFIXES)
    return low.startswith((CAMERA, *_LIVE)) or low.endswith(VIDEO_SUFFIXES)


def public_name(source: str) -> str:
    """Gives the name of a source without the user and password that the address of a stream may have."""
    return re.sub(r"(?<=://)[^/?#]*@", "", source)


def is_live(source: str) -> bool:
    """Tells whether `source` is a camera or a live stream, by its name alone."""
    return source.lower().startswith((CAMERA, *_LIVE))


def open_frames(source: str | Path, *, reader: str = "auto") -> FrameReader:
    """Opens a video file, a camera (`camera:0`) or a stream (`rtsp://...`).

    Args:
        source: Its path, or its name.
        reader: "pyav", "opencv", or "auto": PyAV where it is installed, but OpenCV for cameras.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If it is no video, the camera does not answer, or `reader` is unknown.
        ModuleNotFoundError: If PyAV is asked for and not installed.
    """
    if reader not in READERS:
        raise ValueError(f"reader is {reader!r}, but must be one of {', '.join(READERS)}.")
    name = os.fspath(source)
    camera = name.lower().startswith(CAMERA)
    if not camera and "://" not in name:
        _check_file(Path(name))
    if camera or reader == "opencv" or (reader == "auto" and not has_av()):
        from yolino.inference.frames_opencv import OpenCVFrames

        return OpenCVFrames(name, live=is_live(name))
    from yolino.inference.frames_av import AvFrames

    return AvFrames(name, live=is_live(name))


def has_av() -> bool:
    """Tells whether PyAV is installed (the extra `video`)."""
    return importlib.util.find_spec("av") is not None


def camera_number(source: str) -> int:
    """Gives the number in `camera:N`.

    Raises:
        ValueError: If there is none.
    """
    number = source[len(CAMERA) :]
    if not (number.isascii() and number.isdigit()):
        raise ValueError(f"{source} is no camera: give camera:0 for the first one, camera:1 for the next.")
    return int(number)


def plausible_rate(rate: float) -> float | None:
    """Gives a stated frame rate, or None where no camera has such a one."""
    return float(rate) if 0.01 <= rate <= 1000 else None


def _check_file(path: Path) -> None:
    if path.is_dir():
        raise ValueError(f"{path} is a folder, not a video file.")
    if not path.exists():
        raise FileNotFoundError(f"There is no video file {path}.")
    try:
        with open(path, "rb") as stream:
            empty = not stream.read(1)
    except OSError as error:
        raise ValueError(f"{path} cannot be read: {error.strerror or error}.") from None
    if empty:
        raise ValueError(f"{path} is empty (0 bytes), not a video.")


__all__ = [
    "ASSUMED_RATE",
    "CAMERA",
    "READERS",
    "VIDEO_SUFFIXES",
    "Frame",
    "FrameReader",
    "camera_number",
    "has_av",
    "is_live",
    "names_video",
    "open_frames",
    "plausible_rate",
    "public_name",
]
