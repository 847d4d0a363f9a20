"""Runs the experiments of a sweep, one after the other, and remembers what came of each."""

from __future__ import annotations

import gc
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

from yolino.io import write_atomic
from yolino.sweep.curves import last_step
from yolino.sweep.description import METRICS, Sweep
from yolino.sweep.jobs import Job, Shelf, check_parts
from yolino.sweep.progress import Progress, Say, duration, listening
from yolino.sweep.result import PROBLEM, Part, Result, read_result, write_problem
from yolino.sweep.scoring import score_checkpoint
from yolino.sweep.writing import write_tables
from yolino.training.callbacks import BEST, LAST
from yolino.training.run import train

CLOCK = "time.json"


class Prospect(NamedTuple):
    """What can be said about a run before it begins.

    Attributes:
        job: The run.
        finished: Whether it has a result already.
        rescored: What of its post-processing has changed since, and is scored anew.
        step: The step that it goes on behind; 0 begins.
        missing: Which of its data is not there; "" if all is.
        parts: What it trains on and what it is scored on; None if unknown.
        error: What else is wrong with it.
    """

    job: Job
    finished: bool = False
    rescored: tuple[str, ...] = ()
    step: int = 0
    missing: str = ""
    parts: tuple[tuple[Part, ...], tuple[Part, ...]] | None = None
    error: Exception | None = None

    @property
    def state(self) -> str:
        """What will be done, in a few words."""
        if self.finished and self.rescored:
            return f"finished before, to score anew with other {', '.join(self.rescored)}"
        if self.finished:
            return "finished before"
        if self.missing:
            return f"not run: {self.missing}"
        if self.error is not None:
            return f"will fail: {reason(self.error)}"
        return f"goes on from step {self.step}" if self.step else "to run"


@dataclass(frozen=True)
class Outcome:
    """What came of a sweep: the runs that were not made for want of data, and those that failed, and why."""

    missing: dict[str, str]
    failed: dict[str, str]


def reason(error: BaseException) -> str:
    """Gives what went wrong in one line."""
    text = " ".join(str(error).split())
    return text if text and isinstance(error, ValueError | OSError) else f"{type(error).__name__}: {text}"


def prospects(jobs: Sequence[Job], *, skip_broken: bool = False) -> list[Prospect]:
    """Gives what can be said about each run before the first begins: whether it is done, and has its data."""
    shelf, found = Shelf(skip_broken=skip_broken), []
    for job in jobs:
        if job.finished:
            found.append(Prospect(job, finished=True, rescored=tuple(job.other_postprocess)))
            continue
        step = last_step(job.folder) if (job.folder / LAST).is_file() else 0
        try:
            check_parts(job.experiment)
        except Exception as error:  # told with the others, when it is its turn
            found.append(Prospect(job, error=error))
            continue
        try:
            found.append(Prospect(job, step=step, parts=shelf.parts(job)))
        except FileNotFoundError as error:
            found.append(Prospect(job, missing=reason(error)))
        except (ValueError, OSError, ImportError) as error:
            found.append(Prospect(job, error=error))
    return found


def run_sweep(
    sweep: Sweep,
    found: Sequence[Prospect],
    out: Path,
    *,
    say: Say,
    bar: bool = False,
    skip_broken: bool = False,
) -> Outcome:
    """Makes the runs that are not finished, and writes the table after each.

    A run whose data is not there is left out, a run that fails does not stop the others. A killed sweep goes
    on with the run that it was at.

    Args:
        sweep: The sweep.
        found: What `prospects` gave for its runs.
        out: Folder of the results.
        say: Takes lines that tell how far it is.
        bar: Whether each training shows a bar, too.
        skip_broken: Whether to leave out labels that cannot be read.

    Raises:
        OSError: The table cannot be written.
    """
    ready = [each.job for each in found if not each.finished and not each.missing and each.error is None]
    progress, outcome = Progress(ready, len(found), say), Outcome({}, {})
    for number, each in enumerate(found, 1):
        job, name = each.job, each.job.experiment.name
        if each.finished:
            progress.tell(number, job, each.state)
            if each.rescored:
                try:
                    result = _score_anew(job, skip_broken=skip_broken)
                    progress.tell(number, job, f"scored anew: {_scores(result)}")
                except Exception as error:  # its earlier result stays
                    outcome.failed[name] = f"could not be scored anew: {reason(error)}"
                    progress.tell(number, job, outcome.failed[name])
                    write_problem(job.folder, outcome.failed[name], error)
        elif each.missing:
            progress.tell(number, job, each.state)
            outcome.missing[name] = each.state
            write_problem(job.folder, each.state)
        elif each.error is not None:
            outcome.failed[name] = f"failed: {reason(each.error)}"
            progress.tell(number, job, outcome.failed[name])
            write_problem(job.folder, outcome.failed[name], each.error)
        else:
            try:
                progress.begin(number, job, each.step)
                result = _run(each, progress, bar=bar, skip_broken=skip_broken)
                progress.end(job, f"finished in {duration(result.seconds)}: {_scores(result)}")
            except Exception as error:  # a night's other runs are worth more: all are told at the end
                outcome.failed[name] = f"failed: {reason(error)}"
                write_problem(job.folder, outcome.failed[name], error)
                progress.end(job, outcome.failed[name])
        write_tables(sweep, out)
    return outcome


def _run(each: Prospect, progress: Progress, *, bar: bool, skip_broken: bool) -> Result:
    """Trains, scores, and writes the result."""
    assert each.parts is not None
    job = each.job
    (job.folder / PROBLEM).unlink(missing_ok=True)
    start = _begin_clock(job.folder)
    gc.collect()  # networks are in circles of references, and a GPU has no room for those of earlier runs
    with listening(progress, job):
        best = train(job.path, job.changes, progress=bar, skip_broken=skip_broken)
    seconds = time.time() - start
    scored = score_checkpoint(best, job, skip_broken=skip_broken)
    result = Result(
        row=job.row,
        seed=job.seed,
        settings=job.experiment.model_dump(mode="json"),
        scores={name: float(value) for name, value in scored.evaluation.scores.items()},
        intervals=scored.evaluation.intervals,
        threshold=scored.thresholds.segments,
        line_threshold=scored.thresholds.lines,
        train=each.parts[0],
        scored=each.parts[1],
        step=int(scored.header.metrics["step"]),
        steps=last_step(job.folder) or job.experiment.training.steps,
        seconds=seconds,
        parameters=scored.parameters,
        device=scored.device,
        version=version("yolino"),
        commit=scored.header.commit,
    )
    result.write(job.folder)
    return result


def _score_anew(job: Job, *, skip_broken: bool) -> Result:
    """Scores a finished run with another post-processing; its training stays as it was."""
    before = read_result(job.folder)
    assert before is not None
    scored = score_checkpoint(job.folder / BEST, job, skip_broken=skip_broken)
    result = before.model_copy(
        update={
            "settings": before.settings | {"postprocess": job.experiment.postprocess.model_dump(mode="json")},
            "scores": {name: float(value) for name, value in scored.evaluation.scores.items()},
            "intervals": scored.evaluation.intervals,
            "threshold": scored.thresholds.segments,
            "line_threshold": scored.thresholds.lines,
        }
    )
    result.write(job.folder)
    return result


def _begin_clock(folder: Path) -> float:
    """Gives the time at which the run would have begun had it never been stopped.

    Of an earlier part counts what its last checkpoint kept; so a kill without warning loses no count.
    """
    file, now, before = folder / CLOCK, time.time(), 0.0
    if file.is_file() and (folder / LAST).is_file():
        start = float(json.loads(file.read_text(encoding="utf-8"))["start"])
        before = max((folder / LAST).stat().st_mtime - start, 0.0)
    write_atomic(file, json.dumps({"start": now - before}) + "\n")
    return now - before


def _scores(result: Result) -> str:
    scores = [f"{METRICS[name]} {result.scores[name]:.3f}" for name in METRICS if name in result.scores]
    return ", ".join(scores)


__all__ = ["CLOCK", "Outcome", "Prospect", "prospects", "reason", "run_sweep"]
