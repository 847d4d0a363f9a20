"""Video files out: under a temporary name until they are whole, with the times of the frames kept."""

from __future__ import annotations

import os
import uuid
from fractions import Fraction
from math import ceil
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, runtime_checkable

import cv2
import numpy as np
from jaxtyping import UInt8

from yolino.inference.frames import ASSUMED_RATE, Frame, has_av
from yolino.inference.frames_av import import_av
from yolino.io import quiet

CODECS = {".mp4": "mp4v", ".m4v": "mp4v", ".mov": "mp4v", ".mkv": "mp4v", ".avi": "MJPG"}
"""Suffixes of the videos that can be written, with OpenCV's name of the codec."""

_CLOCK = 90_000  # ticks per second: divides by all usual frame rates
_LONGEST_GAP_S = 10.0


@runtime_checkable
class Encoder(Protocol):
    """Writes pictures of one even size into a file."""

    def add(self, image: UInt8[np.ndarray, "h w 3"], seconds: float) -> None:
        """Adds a picture that is shown from `seconds` on."""
        ...

    def close(self) -> None:
        """Ends the file."""
        ...


class VideoWriter:
    """Writes frames into a video file; the file appears when it is closed.

    Sizes are made even, as the codecs want, by a copy of the last column and row.

    Args:
        path: The file; its suffix is one of `CODECS`.
        rate: Frames per second; None for an unknown rate.

    Raises:
        ValueError: If the suffix is unknown.
        OSError: If the place cannot be written.
    """

    def __init__(self, path: Path | str, rate: float | None) -> None:
        self.path = Path(path)
        self.rate = rate or ASSUMED_RATE
        if self.path.suffix.lower() not in CODECS:
            raise ValueError(f"{path} cannot be written as a video: use a name in {', '.join(CODECS)}.")
        target = Path(os.path.realpath(path))
        self._target = target
        self._temporary = target.with_name(f".{uuid.uuid4().hex[:12]}.tmp{target.suffix.lower()}")
        self._encoder: Encoder | None = None
        self._size: tuple[int, ...] = ()
        self.count = 0
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            self._temporary.open("xb").close()
        except OSError as error:
            raise OSError(f"{path} cannot be written: {error.strerror or error}.") from None

    def __enter__(self) -> VideoWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.close()
        except OSError:
            if kind is None:  # else the first failure says why
                raise

    def add(self, frame: Frame, image: UInt8[np.ndarray, "h w 3"] | None = None) -> None:
        """Adds a frame at its time.

        Args:
            frame: The frame.
            image: What is shown; the frame's own picture by default.

        Raises:
            ValueError: If its size is another than that of the first one.
            OSError: If it cannot be written.
        """
        image = frame.image if image is None else image
        size = (image.shape[0], image.shape[1])
        if self._encoder is None:
            self._size = size
            even = (size[0] + size[0] % 2, size[1] + size[1] % 2)
            self._encoder = _encoder(self._temporary, even, self.rate)
        if size != self._size:
            raise ValueError(
                f"Frame {frame.index} has another size than those before, {size} after {self._size} "
                "(height, width), but a video has one size: write JSON lines (.jsonl) alone."
            )
        self._encoder.add(_even(image), frame.seconds)
        self.count += 1

    def close(self) -> None:
        """Ends the file and gives it its name; without frames there is none.

        Raises:
            OSError: If it could not be written wholly.
        """
        try:
            encoder, self._encoder = self._encoder, None
            if encoder is not None:
                encoder.close()
                os.replace(self._temporary, self._target)
        finally:
            self._temporary.unlink(missing_ok=True)


class OpenCVEncoder:
    """Encodes with OpenCV, at a constant rate: a picture is repeated until the next one's time has come.

    Raises:
        OSError: If the file cannot be written.
    """

    def __init__(self, path: Path, size: tuple[int, int], rate: float) -> None:
        self._path, self._rate = path, rate
        self._frames = self._cut = 0
        self._previous: UInt8[np.ndarray, "h w 3"] | None = None
        code = cv2.VideoWriter.fourcc(*CODECS[path.suffix])
        with quiet():
            self._writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, code, rate, size[::-1])
        if not self._writer.isOpened():
            raise OSError(f"OpenCV cannot write videos of {size} at {rate:g} frames per second.")

    def add(self, image: UInt8[np.ndarray, "h w 3"], seconds: float) -> None:
        """Adds a picture that is shown from `seconds` on."""
        bgr = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
        if self._previous is not None:
            missing = round(seconds * self._rate) - self._cut - self._frames
            longest = ceil(_LONGEST_GAP_S * self._rate)
            if missing > longest:  # a source that stood still, or a wrong clock
                self._cut += missing - longest
                missing = longest
            for _ in range(missing):
                self._writer.write(self._previous)
            self._frames += max(missing, 0)
        self._writer.write(bgr)
        self._previous = bgr
        self._frames += 1

    def close(self) -> None:
        """Ends the file.

        Raises:
            OSError: If OpenCV cannot read it again: it tells of no other failure.
        """
        self._writer.release()
        with quiet():
            capture = cv2.VideoCapture(str(self._path), cv2.CAP_FFMPEG)
            readable = capture.isOpened() and capture.grab()
            capture.release()
        if not readable:
            raise OSError("The video could not be written: is the disk full?")


class AvEncoder:
    """Encodes with PyAV, as H.264 where it can, each picture at its time."""

    def __init__(self, path: Path, size: tuple[int, int], rate: float) -> None:
        self._av: Any = import_av()
        self._last = -1
        self._container = self._av.open(str(path), "w")
        codec, options = "mpeg4", {"qscale": "3"}
        if "libx264" in self._av.codecs_available:
            codec, options = "libx264", {"preset": "veryfast", "crf": "20"}
        stated = Fraction(rate).limit_denominator(1001)
        self._stream = self._container.add_stream(codec, rate=stated, options=options)
        self._stream.height, self._stream.width = size
        self._stream.pix_fmt = "yuv420p"
        self._stream.codec_context.time_base = Fraction(1, _CLOCK)

    def add(self, image: UInt8[np.ndarray, "h w 3"], seconds: float) -> None:
        """Adds a picture that is shown from `seconds` on.

        Raises:
            OSError: If the disk is full.
        """
        frame = self._av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")
        self._last = max(round(seconds * _CLOCK), self._last + 1)
        frame.pts, frame.time_base = self._last, Fraction(1, _CLOCK)
        self._container.mux(self._stream.encode(frame))

    def close(self) -> None:
        """Ends the file.

        Raises:
            OSError: If the disk is full.
        """
        try:
            self._container.mux(self._stream.encode(None))
        finally:
            self._container.close()


def _encoder(path: Path, size: tuple[int, int], rate: float) -> Encoder:
    """Gives PyAV's encoder where it is installed; AVI has no times, which OpenCV's does not need."""
    if has_av() and path.suffix != ".avi":
        return AvEncoder(path, size, rate)
    return OpenCVEncoder(path, size, rate)


def _even(image: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "a b 3"]:
    bottom, right = image.shape[0] % 2, image.shape[1] % 2
    if not (bottom or right):
        return image
    return np.asarray(cv2.copyMakeBorder(image, 0, bottom, 0, right, cv2.BORDER_REPLICATE))


__all__ = ["CODECS", "AvEncoder", "Encoder", "OpenCVEncoder", "VideoWriter"]
