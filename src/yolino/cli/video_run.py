"""One run of `yolino predict` over a video: its files, its progress, its summary."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import NamedTuple

import typer
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from yolino.inference import Predictor
from yolino.inference.frames import ASSUMED_RATE, FrameReader
from yolino.inference.tracking import Tracker
from yolino.inference.video import FrameResult, VideoPrediction, draw_frame
from yolino.inference.video_lines import LinesWriter, frame_json
from yolino.inference.video_pipeline import Step
from yolino.inference.video_writer import VideoWriter

_SLACK = 0.005  # share of the frames that may be missing: containers count with a small error


class Targets(NamedTuple):
    """Where the results of one source go; None for what is not wanted."""

    source: str
    video: Path | None
    lines: Path | None


class VideoRun:
    """Goes through one video and writes its results.

    Args:
        predictor: What finds the polylines.
        reader: The open video; the run closes it.
        target: Where the results go.
        tracker: What gives identities; None for none.
        frames: Stop after so many frames.

    Raises:
        OSError: If the video cannot be written.
    """

    def __init__(
        self,
        predictor: Predictor,
        reader: FrameReader,
        target: Targets,
        *,
        tracker: Tracker | None,
        frames: int | None,
    ) -> None:
        self._reader, self._target, self._tracker = reader, target, tracker
        self._header, self._limit = predictor.header, frames
        self._video = None if target.video is None else VideoWriter(target.video, reader.rate)
        finish = [] if self._video is None else [Step("drawing", self._draw), Step("encoding", self._encode)]
        self._prediction = VideoPrediction(predictor, reader, tracker=tracker, finish=finish, frames=frames)
        self._frames = self._polylines = self._signal = 0
        self._started = time.perf_counter()

    def __call__(self) -> list[str]:
        """Runs; gives a sentence if there was nothing to see. Says on stderr what was odd.

        Raises:
            OSError: If a result cannot be written.
            typer.Exit: If a signal ended it before the end of a file.
        """
        files = contextlib.ExitStack()
        with self._stopped_by_signals(), files:
            if self._video is not None:
                files.enter_context(self._video)
            self._started = time.perf_counter()
            with self._progress() as advance:
                self._follow(files, advance)
        name = self._reader.name
        if self._frames == 0 and not self._signal:
            return [f"{name} has no frame that can be decoded."]
        if oddities := self._oddities():
            typer.echo(f"Warning: {name} {'; it '.join(oddities)}.", err=True)
        typer.echo(self._summary())
        if self._signal and not self._reader.live:
            raise typer.Exit(128 + self._signal)
        return []

    def _follow(self, files: contextlib.ExitStack, advance: Callable[[], None]) -> None:
        lines: LinesWriter | None = None
        for result in self._prediction:
            if self._target.lines is not None:
                if lines is None:  # only now: an older file stays if there is nothing to put in its place
                    lines = files.enter_context(LinesWriter(self._target.lines))
                name, header = self._reader.name, self._header
                lines.add(frame_json(result, name, header.classes, header.name))
            self._frames += 1
            self._polylines += len(result.polylines)
            advance()

    def _draw(self, result: FrameResult) -> FrameResult:
        by_label = self._tracker is None and len(self._header.classes) > 1
        color_by = "label" if by_label else "identity"
        return draw_frame(result, color_by=color_by, directed=self._header.directed)

    def _encode(self, result: FrameResult) -> FrameResult:
        assert self._video is not None
        self._video.add(result.frame, result.picture)
        return result

    @contextlib.contextmanager
    def _stopped_by_signals(self) -> Iterator[None]:
        """Lets the first Ctrl-C (or `kill`) end the run properly; a second one ends it at once."""
        if threading.current_thread() is not threading.main_thread():  # Python lets no other set handlers
            yield
            return
        kinds = (signal.SIGINT, signal.SIGTERM)
        before = {kind: signal.getsignal(kind) or signal.SIG_DFL for kind in kinds}

        def stop(number: int, frame: FrameType | None) -> None:
            self._signal = number
            self._prediction.stop()
            for kind in kinds:
                signal.signal(kind, before[kind])

        for kind in kinds:
            signal.signal(kind, stop)
        try:
            yield
        finally:
            for kind in kinds:
                signal.signal(kind, before[kind])

    @contextlib.contextmanager
    def _progress(self) -> Iterator[Callable[[], None]]:
        """Shows how far it is, on stderr and if somebody watches; yields what counts a frame."""
        console = Console(stderr=True)
        if not console.is_terminal:
            yield lambda: None
            return
        total = self._limit or self._reader.count
        if self._limit and self._reader.count:
            total = min(self._limit, self._reader.count)
        head: tuple[ProgressColumn, ...] = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        if total is None:
            head = (SpinnerColumn(), TextColumn("{task.completed:.0f}"), TimeElapsedColumn())
        title = self._reader.name + (" (Ctrl-C ends it)" if self._reader.live else "")
        with Progress(
            TextColumn("{task.description}", markup=False), *head, _Rate(), console=console, transient=True
        ) as progress:
            task = progress.add_task(title, total=total)
            yield lambda: progress.advance(task)

    def _oddities(self) -> list[str]:
        """Gives what the user should know about the video: parts of a sentence."""
        reader, odd = self._reader, []
        whole = not self._signal and (self._limit is None or self._frames < self._limit)
        if whole and reader.count is not None:
            missing = reader.count - self._frames
            if missing > max(1, _SLACK * reader.count):
                odd.append(f"ends early: {self._frames} of {reader.count} frames could be read")
        elif whole and reader.live:
            odd.append(f"gave no more frames after {self._frames}")
        if reader.damaged:
            odd.append(f"has {reader.damaged} damaged part{'s' * (reader.damaged != 1)}")
        if reader.rate is None:
            odd.append(f"does not state its frame rate: {ASSUMED_RATE:g} per second are assumed")
        return odd

    def _summary(self) -> str:
        """Gives the lines at the end: what there was, how fast it went, and what took the time."""
        rate = self._frames / max(time.perf_counter() - self._started, 1e-9)
        parts = [
            f"{self._frames} frame{'s' * (self._frames != 1)}",
            f"{rate:.1f} fps",
            f"{self._polylines} polyline{'s' * (self._polylines != 1)}",
        ]
        if self._tracker is not None:
            parts.append(f"{self._tracker.born} identit{'y' if self._tracker.born == 1 else 'ies'}")
        if self._prediction.dropped:
            parts.append(f"{self._prediction.dropped} dropped")
        if self._frames == 0:
            return "0 frames: nothing is written"
        files = [str(path) for path in (self._target.video, self._target.lines) if path is not None]
        busy = self._prediction.seconds
        shares = ", ".join(f"{name} {1e3 * busy[name] / self._frames:.1f}" for name in busy)
        return f"{', '.join(parts)} -> {', '.join(files)}\nms per frame, all at once: {shares}"


class _Rate(ProgressColumn):
    """Frames per second of the last while."""

    def render(self, task: Task) -> Text:
        """Gives the text of the column."""
        speed = task.finished_speed or task.speed
        return Text("" if speed is None else f"{speed:.1f} fps")


__all__ = ["Targets", "VideoRun"]
