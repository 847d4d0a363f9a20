"""What a sweep says while it runs: which run of how many, how far it is, and how long all will take."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from time import monotonic

from yolino.sweep.jobs import Job

Say = Callable[[str], object]
_VALIDATED = "yolino.training.callbacks"


def duration(seconds: float | int) -> str:
    """Gives a time for people: `40 s`, `3 min`, `2 h 05 min`."""
    if seconds < 60:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"


def _work(job: Job) -> float:
    """Gives the pixels that a step of a run goes through: by them the times of other runs are guessed."""
    height, width = job.experiment.data.size
    return float(job.experiment.training.batch_size * height * width)


class Progress:
    """Tells how far a sweep is.

    Args:
        jobs: The runs that are still to be made, in their order; those without data are not among them.
        total: Number of all runs of the sweep.
        say: Takes a line.
        now: A clock, in seconds.
    """

    def __init__(
        self, jobs: Sequence[Job], total: int, say: Say, *, now: Callable[[], float] = monotonic
    ) -> None:
        self._left, self._total, self._say, self._now = list(jobs), total, say, now
        self._finished: list[float] = []  # seconds for a pixel, of each run that ended
        self._rate: float | None = None  # that of this run
        self._title, self._start, self._first = "", 0.0, 0

    def tell(self, number: int, job: Job, what: str) -> None:
        """Says something about a run that is not made now."""
        self._say(f"{self._name(number, job)}: {what}")

    def begin(self, number: int, job: Job, step: int) -> None:
        """Says that a run begins, or goes on behind a step."""
        self._title, self._start, self._first = self._name(number, job), self._now(), step
        self._rate, steps = None, job.experiment.training.steps
        begins = f"goes on from step {step} of {steps}" if step else f"begins, {steps} steps"
        self._say(f"{self._title}: {begins}{self._remaining(step)}")

    def step(self, job: Job, step: int, scores: str) -> None:
        """Says what a validation found."""
        if step > self._first:
            self._rate = (self._now() - self._start) / ((step - self._first) * _work(job))
        steps = job.experiment.training.steps
        self._say(f"{self._title}: step {step} of {steps}, {scores}{self._remaining(step)}")

    def end(self, job: Job, what: str) -> None:
        """Says what came of a run."""
        self._left = [other for other in self._left if other is not job]
        if self._rate is not None:
            self._finished.append(self._rate)
        self._rate = None
        self._say(f"{self._title}: {what}")

    def _name(self, number: int, job: Job) -> str:
        return f"[{number} of {self._total}] {job.row}, seed {job.seed}"

    def _remaining(self, step: int) -> str:
        """Gives how long this run and all will still take, as far as that can be told."""
        rates = [*self._finished, *([] if self._rate is None else [self._rate])]
        if not rates or not self._left:
            return ""
        usual = sum(rates) / len(rates)
        now, *later = self._left
        left = max(now.experiment.training.steps - step, 0) * _work(now) * (self._rate or usual)
        total = left + sum(job.experiment.training.steps * _work(job) * usual for job in later)
        return f"; about {duration(left)} left" + (f", {duration(total)} for all runs" if later else "")


@contextmanager
def listening(progress: Progress, job: Job) -> Iterator[None]:
    """Hands what training logs at each validation to the progress, instead of showing it."""
    source = logging.getLogger(_VALIDATED)
    handler, level, propagate = _Validations(progress, job), source.level, source.propagate
    source.addHandler(handler)
    source.setLevel(logging.INFO)
    source.propagate = False
    try:
        yield
    finally:
        source.removeHandler(handler)
        source.setLevel(level)
        source.propagate = propagate


class _Validations(logging.Handler):
    """Takes `step %d: ...`; everything else goes on as if it were not there."""

    def __init__(self, progress: Progress, job: Job) -> None:
        super().__init__()
        self.progress, self.job = progress, job

    def emit(self, record: logging.LogRecord) -> None:
        """Takes a line of the log."""
        text = record.getMessage()
        first, _, scores = text.partition(": ")
        step = first.removeprefix("step ")
        if record.levelno == logging.INFO and step.isdigit():
            self.progress.step(self.job, int(step), scores)
        elif record.levelno > logging.INFO:
            logging.getLogger("yolino.training").handle(record)


__all__ = ["Progress", "Say", "duration", "listening"]
