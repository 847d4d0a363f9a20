"""Scores the best checkpoint of a run, with torch and as `yolino evaluate` does."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from yolino.datasets import Dataset, TuSimple
from yolino.evaluate import Evaluation, evaluate
from yolino.header import Header
from yolino.inference import Predictor
from yolino.model.engine import TorchEngine
from yolino.sweep.jobs import Job, open_source
from yolino.types import Sample

# The benchmark's scores; `evaluate` has alike ones for others, which are no one's official ones.
_TUSIMPLE = ("accuracy", "fp", "fn", "fn_strict")


class Scored(NamedTuple):
    """What was found about a checkpoint."""

    evaluation: Evaluation
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
    """Gives the scores of a checkpoint on what its run is scored on.

    Accuracy, FP and FN are those of the TuSimple benchmark, and left out for data in other formats.

    Raises:
        FileNotFoundError: The checkpoint or the data is not there.
        ValueError: One of them is broken.
    """
    sources = job.score_on or job.experiment.data.val
    parts = [open_source(source, job.experiment, "val", skip_broken=skip_broken) for source in sources]
    dataset = parts[0] if len(parts) == 1 else Joined(parts)
    training = job.experiment.training
    device = "cpu" if training.accelerator == "cpu" else "auto"
    engine = TorchEngine(path, device=device, threads=training.threads or None)
    found = evaluate(Predictor(engine), dataset)
    if not isinstance(dataset, TuSimple):
        for name in _TUSIMPLE:
            found.scores.pop(name, None)
            found.intervals.pop(name, None)
    parameters = sum(weights.numel() for weights in engine.graph.parameters())
    return Scored(found, engine.header, parameters, engine.device)


__all__ = ["Joined", "Scored", "score_checkpoint"]
