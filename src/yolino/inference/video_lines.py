"""JSON lines: a line of text for each frame, written as soon as it is known."""

from __future__ import annotations

import contextlib
import json
import logging
import os
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import NamedTuple

from yolino.inference.video import FrameResult
from yolino.io import Result, from_json, to_json

_LOG = logging.getLogger(__name__)


class FrameLine(NamedTuple):
    """One line of such a file.

    Attributes:
        frame: How many frames came before it.
        seconds: Time since the first frame.
        result: The polylines, as of an image.
        ids: Identity of each polyline; empty without a tracker.
    """

    frame: int
    seconds: float
    result: Result
    ids: tuple[int, ...]


def frame_json(found: FrameResult, source: str, classes: tuple[str, ...] = (), model: str = "") -> str:
    """Gives the result of a frame as one line: that of an image (`yolino.io.to_json`) with number and time.

    Polylines have an `id` if a tracker gave one, and `"seen": false` where it is only expected.

    Args:
        found: The frame and what was found in it.
        source: Name of the video.
        classes: Names of the classes.
        model: Name of the model.

    Raises:
        ValueError: A point or score is infinite or not a number.
    """
    height, width = found.frame.image.shape[:2]
    document = json.loads(to_json(Result(source, (height, width), found.polylines, classes, model)))
    for i, line in enumerate(document["polylines"]):
        if found.ids is not None:
            line["id"] = int(found.ids[i])
        if found.seen is not None and not found.seen[i]:
            line["seen"] = False
    head = {"frame": found.frame.index, "seconds": round(found.frame.seconds, 4)}
    return json.dumps({**head, **document}, allow_nan=False) + "\n"


class LinesWriter:
    """Writes lines of text; what is written stays if the program is killed.

    Each line goes to the system in one call. A line that is cut because the disk is full is taken back; one
    that is cut because the system kills the program at that moment is the last and has no line end.

    Args:
        path: The file; an older one is emptied.

    Raises:
        OSError: If it cannot be written.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self._length = 0
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._stream = open(self.path, "wb", buffering=0)  # noqa: SIM115
        except OSError as error:
            raise OSError(f"{path} cannot be written: {error.strerror or error}.") from None

    def __enter__(self) -> LinesWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def add(self, line: str) -> None:
        """Writes one line.

        Raises:
            OSError: If the disk is full; the lines before are there.
        """
        data = memoryview(line.encode())
        try:
            written = 0
            while written < len(data):
                written += self._stream.write(data[written:])
        except OSError as error:
            with contextlib.suppress(OSError):  # what is no file, a pipe, say, cannot be cut back
                os.ftruncate(self._stream.fileno(), self._length)
            reason = error.strerror or error
            raise OSError(f"{self.path} cannot be written: {reason}. The lines before are there.") from None
        self._length += len(data)

    def close(self) -> None:
        """Ends the file."""
        self._stream.close()


def read_lines(path: Path | str) -> Iterator[FrameLine]:
    """Yields the frames in a file of JSON lines.

    A last line without its end, as a program that was killed may leave one, is left out.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: A line is not one of those that `frame_json` gives.
    """
    if not Path(path).is_file():
        raise FileNotFoundError(f"There is no file of JSON lines {path}.")
    with open(path, encoding="utf-8") as stream:
        for number, line in enumerate(stream, 1):
            if not line.endswith("\n"):
                _LOG.warning("%s, line %d is cut and left out.", path, number)
                return
            try:
                document = json.loads(line)
                ids = tuple(int(one["id"]) for one in document["polylines"] if "id" in one)
                yield FrameLine(int(document["frame"]), float(document["seconds"]), from_json(line), ids)
            except KeyError as error:
                raise ValueError(f"{path}, line {number}: the key {error} is missing.") from None
            except (TypeError, ValueError) as error:
                raise ValueError(f"{path}, line {number} is not the result of a frame: {error}.") from None


__all__ = ["FrameLine", "LinesWriter", "frame_json", "read_lines"]
