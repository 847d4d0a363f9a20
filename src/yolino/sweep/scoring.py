"""Scores the best checkpoint of a run, with torch and as `yolino evaluate` does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from yolino.config import Experiment, Source
from yolino.datasets import Dataset, TuSimple
from yolino.evaluate import Evaluation, evaluate
from yolino.header import Header
from yolino.inference import Predictor
from yolino.model.engine import TorchEngine
from yolino.sweep.jobs import Job, open_source
from yolino.sweep.thresholds import Thresholds, choose_thresholds
from yolino.training.callbacks import header_postprocess
from yolino.types import Sample

# The benchmark's scores; `evaluate` has alike ones for others, which are no one's official ones.
_TUSIMPLE = ("accuracy", "fp", "fn", "fn_strict")


class Scored(NamedTuple):
    """What was found about a checkpoint."""

    evaluation: Evaluation
    thresholds: Thresholds
    header: Header
    parameters: int
    device: str


class Joined:
    """Several datasets as one.

    Args:
        datasets: Datasets with the same classes, all with directions or all without.

    Raises:
        ValueError: They are not alike.
    """

    def __init__(self, datasets: Sequence[Dataset]) -> None:
        self.datasets = datasets
        self.classes, self.directed = datasets[0].classes, datasets[0].directed
        if any((d.classes, d.directed) != (self.classes, self.directed) for d in datasets):
            raise ValueError(
                "The validation data has parts with other classes or directions, which have no common score: "
                f"name one in score_on of sweep.yaml; the first has the classes {', '.join(self.classes)}."
            )

    def __len__(self) -> int:
        return sum(map(len, self.datasets))

    def __getitem__(self, index: int, /) -> Sample:
        for dataset in self.datasets:
            if index < len(dataset):
                return dataset[index]
            index -= len(dataset)
        raise IndexError(index)


def score_checkpoint(path: Path, job: Job, *, skip_broken: bool = False) -> Scored:
    """Gives the scores of a checkpoint on what its run is scored on, with the post-processing of the run.

    Accuracy, FP and FN are those of the TuSimple benchmark, and left out for data in other formats. Where the
    experiment has no threshold, those of segments and of lines are chosen on its validation data.

    Raises:
        FileNotFoundError: The checkpoint or the data is not there.
        ValueError: One of them is broken.
    """
    experiment = job.experiment
    val = _open(experiment.data.val, experiment, skip_broken=skip_broken)
    dataset = _open(job.score_on, experiment, skip_broken=skip_broken) if job.score_on else val
    training = experiment.training
    device = "cpu" if training.accelerator == "cpu" else "auto"
    engine = TorchEngine(path, device=device, threads=training.threads or None)
    header = engine.header
    settings = header_postprocess(experiment, header.postprocess["threshold"])
    header = replace(header, postprocess=settings)
    given = experiment.postprocess.threshold
    chosen = (
        Thresholds(given, given) if given is not None else choose_thresholds(Predictor(engine, header), val)
    )
    found = evaluate(Predictor(engine, header, threshold=chosen.lines), dataset)
    if chosen.segments != chosen.lines:
        _take_segments(found, evaluate(Predictor(engine, header, threshold=chosen.segments), dataset))
    if not isinstance(dataset, TuSimple):
        for name in _TUSIMPLE:
            found.scores.pop(name, None)
            found.intervals.pop(name, None)
    parameters = sum(weights.numel() for weights in engine.graph.parameters())
    return Scored(found, chosen, engine.header, parameters, engine.device)


def _open(sources: Sequence[Source], experiment: Experiment, *, skip_broken: bool) -> Dataset:
    parts = [open_source(source, experiment, "val", skip_broken=skip_broken) for source in sources]
    return parts[0] if len(parts) == 1 else Joined(parts)


def _take_segments(found: Evaluation, other: Evaluation) -> None:
    """Puts the scores of the segments from another evaluation into one."""
    for name in found.scores:
        if name.startswith("segment_"):
            found.scores[name] = other.scores[name]
    for name in found.intervals:
        if name.startswith("segment_"):
            found.intervals[name] = other.intervals[name]


__all__ = ["Joined", "Scored", "score_checkpoint"]
