"""`yolino predict` on images: a result and a picture for each, in a folder."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from yolino.cli.results import Found, ResultWriter, Tally, UnreadableError
    from yolino.cli.stopping import Stop
    from yolino.inference import EngineChoice, Predictor

    Job = tuple[Path, str]

_FEW = 8  # images for which the network gets all threads; of more, several are predicted at once


def predict_images(
    sources: Sequence[str],
    *,
    model: str,
    threshold: float | None,
    flip: bool | None,
    out: Path,
    format: str,
    choice: EngineChoice,
    pictures: bool,
    view: str,
) -> None:
    """Finds the polylines in images; writes their results into a folder."""
    from yolino.cli.results import ResultWriter
    from yolino.cli.screen import busy, report_problems
    from yolino.cli.sources import find_images, result_names
    from yolino.compiled import are_kept, expected
    from yolino.inference import Predictor
    from yolino.inference.engine import usable_cores
    from yolino.inference.stream import MOST

    began = time.perf_counter()
    writer = ResultWriter(out, format, pictures=pictures, view=view)
    paths, problems = find_images(sources, excluded=out)
    names = result_names(paths)
    writer.refuse_overwriting(paths, names)
    streams = 1 if len(paths) <= _FEW else max(min(usable_cores(), MOST), choice.streams)
    with expected(len(paths)) as compiled:
        cold = compiled and not are_kept()
        once = " (once after an installation, kernels are compiled: up to a minute)" if cold else ""
        with busy(f"loading the model{once}", long=cold):
            opened = replace(choice, streams=streams).open(model)
            predictor = Predictor(opened, threshold=threshold, flip=flip)
            if compiled:
                predictor.warm_up()
        start = _start(time.perf_counter() - began, cold=cold)
        with report_problems(problems):
            jobs = list(zip(paths, names, strict=True))
            _predict_all(_Prediction(predictor, writer, streams), jobs, problems, start)


def _start(seconds: float, *, cold: bool) -> str:
    """Gives what the rate of images leaves out, where that was a second or more."""
    return f"after {seconds:.0f} s of {'compiling' if cold else 'loading'}" if seconds >= 1 else ""


class _Prediction:
    """What a worker does with an image, until the user stops it.

    Args:
        predictor: What finds the polylines.
        writer: Writes the results.
        streams: How many threads may run the network at once.
    """

    def __init__(self, predictor: Predictor, writer: ResultWriter, streams: int) -> None:
        from yolino.inference.stream import limited

        # One more reads and writes while all streams are busy.
        self.workers = 1 if streams == 1 else streams + 1
        self.predictor = predictor if self.workers == streams else limited(predictor, streams)
        self.writer = writer
        self.stop: Stop | None = None
        writer.directed = predictor.header.directed

    def __call__(self, job: Job) -> Found | UnreadableError | None:
        """Gives what was found, why the image cannot be read, or None if there is to be an end."""
        from yolino.cli.results import UnreadableError, predict_one

        if self.stop is not None and self.stop.number:
            return None
        try:
            return predict_one(self.predictor, *job, self.writer)
        except UnreadableError as error:
            return error


def _predict_all(prediction: _Prediction, jobs: Sequence[Job], problems: list[str], before: str) -> None:
    """Predicts the images, several at once; tells at the end, also of a part that was finished.

    Raises:
        typer.Exit: The user stopped it.
    """
    from yolino.cli.results import Tally
    from yolino.cli.screen import SHOWN_ROWS
    from yolino.cli.stopping import stopped_by_signals

    tally, start = Tally(SHOWN_ROWS), time.perf_counter()
    with stopped_by_signals() as stop, _progress(len(jobs)) as advance:
        prediction.stop = stop
        _take(prediction, _until(jobs, stop), tally, problems, advance)
    _tell(tally, prediction.writer.out, time.perf_counter() - start, before)
    if stop.number:
        typer.echo(f"Stopped after {tally.images} of {len(jobs)} images.", err=True)
        raise typer.Exit(stop.exit_code)


def _take(
    prediction: _Prediction,
    jobs: Iterable[Job],
    tally: Tally,
    problems: list[str],
    advance: Callable[[], None],
) -> None:
    """Takes the results in the order of the images."""
    from yolino.cli.results import UnreadableError
    from yolino.inference.stream import in_order

    try:
        for one in in_order(prediction, jobs, workers=prediction.workers):
            advance()
            if isinstance(one, UnreadableError):
                problems.append(str(one))
            elif one is not None:
                prediction.writer.add(one)
                tally.add(one)
    finally:  # whatever ends it, what was found is kept
        prediction.writer.finish()


def _until(jobs: Sequence[Job], stop: Stop) -> Iterator[Job]:
    for job in jobs:
        if stop.number:
            return
        yield job


def _tell(tally: Tally, out: Path, seconds: float, before: str) -> None:
    from yolino.cli.screen import print_table

    if tally.images:
        more = tally.images - len(tally.rows)
        print_table(("image", "polylines", "ms"), tally.rows, more=more)
        typer.echo(tally.summary(out, seconds, before))


@contextlib.contextmanager
def _progress(total: int) -> Iterator[Callable[[], None]]:
    """Shows how far it is and how fast, on stderr, if there are more than a few and somebody watches."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from yolino.cli.screen import FEW

    console = Console(stderr=True)
    if total <= FEW or not console.is_terminal:
        yield lambda: None
        return
    columns = (TextColumn("predicting"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    rate = TextColumn("{task.fields[rate]}")
    start = time.perf_counter()
    with Progress(*columns, rate, console=console, transient=True) as progress:
        task = progress.add_task("", total=total, rate="")

        def advance() -> None:
            done = progress.tasks[0].completed + 1
            speed = done / max(time.perf_counter() - start, 1e-9)
            progress.update(task, advance=1, rate=f"{speed:.1f} images/s")

        yield advance


__all__ = ["predict_images"]
