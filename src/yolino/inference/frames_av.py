"""Frames through PyAV: exact times, rotation, and word of what could not be decoded."""

from __future__ import annotations

import importlib
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from jaxtyping import UInt8

from yolino.inference.frames import ASSUMED_RATE, Frame, plausible_rate, public_name

_TIMEOUT_S = 10.0


class AvFrames:
    """Reads with PyAV; see `FrameReader`.

    Args:
        source: Path of a file, or the address of a stream.
        live: Whether the frames come when they happen: the clock then gives their time.

    Raises:
        ModuleNotFoundError: If PyAV is not installed.
        ValueError: If PyAV cannot open it, or it has no pictures.
    """

    def __init__(self, source: str, *, live: bool = False) -> None:
        self._av = import_av()
        self.name, self.live, self.damaged = public_name(source), live, 0
        timeout = _TIMEOUT_S if "://" in source else None
        # Lost packets smear pictures for seconds.
        options = {"rtsp_flags": "prefer_tcp"} if source.lower().startswith("rtsp") else {}
        try:
            self._container = self._av.open(
                source, timeout=timeout, options=options, metadata_errors="replace"
            )
        except (self._av.error.FFmpegError, OSError) as error:
            raise ValueError(_refusal(self.name, error)) from None
        if not self._container.streams.video:
            sound = len(self._container.streams.audio)
            self._container.close()
            if sound:
                raise ValueError(f"{self.name} has no pictures: it holds sound, but no video.")
            raise ValueError(_refusal(self.name, None))
        self._stream = self._container.streams.video[0]
        self._stream.thread_type = "AUTO"
        rate = self._stream.average_rate or self._stream.guessed_rate
        self.rate = None if rate is None else plausible_rate(float(rate))
        self.count = None if live else self._promised()

    def __iter__(self) -> Iterator[Frame]:
        """Yields the frames in their order, then closes the source."""
        begin: float | None = None
        last, rate = -1.0, self.rate or ASSUMED_RATE
        try:
            for index, frame in enumerate(self._decode()):
                now = time.monotonic() if self.live else frame.time
                begin = now if begin is None else begin
                known = now is not None and begin is not None and now - begin > last
                seconds = float(now - begin) if known else max(last, -1 / rate) + 1 / rate
                yield Frame(index, seconds, _upright(frame))
                last = seconds
        finally:
            self.close()

    def close(self) -> None:
        """Gives the source back; in the thread that iterates, or where none does."""
        self._container.close()

    def _decode(self) -> Iterator[Any]:
        """Yields the frames that can be decoded and counts the packets that cannot."""
        packets = self._container.demux(self._stream)
        while True:
            try:
                packet = next(packets)
            except StopIteration:
                return
            except (self._av.error.FFmpegError, OSError):  # the file ends in the middle, the stream is gone
                self.damaged += 1
                return
            try:
                frames = packet.decode()
            except self._av.error.FFmpegError:
                self.damaged += 1
                continue
            yield from frames

    def _promised(self) -> int | None:
        if self._stream.frames:
            return int(self._stream.frames)
        if self._container.duration is None or self.rate is None:
            return None
        return round(self._container.duration / self._av.time_base * self.rate) or None


def import_av() -> Any:
    """Gives PyAV.

    Raises:
        ModuleNotFoundError: If it is not installed; the message says how to.
    """
    try:
        return importlib.import_module("av")
    except ModuleNotFoundError:
        raise ModuleNotFoundError("PyAV is not installed: pip install 'yolino[video]'.") from None


def _upright(frame: Any) -> UInt8[np.ndarray, "h w 3"]:
    image = np.asarray(frame.to_ndarray(format="rgb24"), np.uint8)
    quarters = round(frame.rotation / 90) % 4
    return np.ascontiguousarray(np.rot90(image, quarters)) if quarters else image


def _refusal(source: str, error: Exception | None) -> str:
    if "://" in source:
        reason = getattr(error, "strerror", None) or str(error)
        return f"The stream {source} cannot be opened ({reason}): check its address and the network."
    return f"{source} is damaged or not a video of a known kind."


__all__ = ["AvFrames", "import_av"]
