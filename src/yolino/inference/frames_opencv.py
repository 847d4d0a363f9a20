"""Frames through OpenCV, which every installation has."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np

from yolino.inference.frames import ASSUMED_RATE, CAMERA, Frame, camera_number, plausible_rate, public_name
from yolino.io import quiet


class OpenCVFrames:
    """Reads with OpenCV; see `FrameReader`.

    Args:
        source: Path of a file, `camera:N`, or the address of a stream.
        live: Whether the frames come when they happen: the clock then gives their time.

    Raises:
        ValueError: If OpenCV cannot open it.
    """

    def __init__(self, source: str, *, live: bool = False) -> None:
        self.name, self.live, self.damaged = public_name(source), live, 0
        with quiet():
            self._capture = _open(source)
        if not self._capture.isOpened():
            raise ValueError(_refusal(self.name, live))
        self.rate = plausible_rate(self._capture.get(cv2.CAP_PROP_FPS))
        count = self._capture.get(cv2.CAP_PROP_FRAME_COUNT)
        self.count = int(count) if count >= 1 and not live else None

    def __iter__(self) -> Iterator[Frame]:
        """Yields the frames in their order, then closes the source."""
        begin: float | None = None
        last, rate = -1.0, self.rate or ASSUMED_RATE
        try:
            index = 0
            while True:
                grabbed, bgr = self._capture.read()
                if not grabbed:
                    return
                now = self._now()
                begin = now if begin is None else begin
                # Some containers carry no times: all frames would be at 0.
                seconds = now - begin if now - begin > last else last + 1 / rate
                yield Frame(index, seconds, np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)))
                index, last = index + 1, seconds
        finally:
            self.close()

    def close(self) -> None:
        """Gives the source back; in the thread that iterates, or where none does."""
        self._capture.release()

    def _now(self) -> float:
        if self.live:
            return time.monotonic()
        return float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) / 1e3


def _open(source: str) -> Any:
    # Read once, when FFmpeg is loaded: what it has to say would stand beside our one sentence.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    if not source.lower().startswith(CAMERA):
        return cv2.VideoCapture(source, cv2.CAP_FFMPEG)
    capture = cv2.VideoCapture(camera_number(source))
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
    return capture


def _refusal(source: str, live: bool) -> str:
    if source.lower().startswith(CAMERA):
        return f"{source} does not answer: check that it is connected and that no other program uses it."
    if live or "://" in source:
        return f"The stream {source} cannot be opened: check its address and the network."
    return f"{source} is damaged or not a video of a known kind."


__all__ = ["OpenCVFrames"]
