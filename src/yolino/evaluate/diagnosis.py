"""What limits a model: its scores with each step of the pipeline replaced by the truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from yolino.datasets import Dataset, TuSimple
from yolino.evaluate.diagnosis_rows import CAUSES, lost_in_image
from yolino.evaluate.diagnosis_scores import Columns, Scoreboard, columns_of, draw_weights, interval, lost
from yolino.evaluate.kinds import label_map
from yolino.evaluate.oracles import LADDER, ORACLES, Found, Oracle
from yolino.evaluate.oracles_case import make_case, see_everything
from yolino.evaluate.prior import Prior, no_image
from yolino.evaluate.run import Progress, point_radius
from yolino.evaluate.worst import pixels_of
from yolino.inference import Predictor
from yolino.types import Polylines, Sample

Interval = tuple[float, float]
_SLACK_ROWS = 0.25  # spacings of the rows by which labels go on for the oracles
_WORTH_NAMING = 0.0005


@dataclass(frozen=True)
class Row:
    """One row of a diagnosis.

    Attributes:
        name: Name of the oracle.
        title: What people read.
        scores: Scores by name.
        intervals: 95 % confidence intervals of the scores.
        gain: By how much the headline score is better than the model's.
    """

    name: str
    title: str
    scores: dict[str, float]
    intervals: dict[str, Interval]
    gain: float


@dataclass(frozen=True)
class Loss:
    """What one stage costs, given that all stages before it in the ladder are repaired.

    Attributes:
        stage: Name of the stage.
        values: By how much each score is worse than with the stage repaired.
        intervals: 95 % confidence intervals; both sides are drawn together.
        images: The same for each image, of the headline score alone.
    """

    stage: str
    values: dict[str, float]
    intervals: dict[str, Interval]
    images: Sequence[float]


@dataclass(frozen=True)
class Diagnosis:
    """What a diagnosis found.

    Attributes:
        headline: The score whose loss is attributed: `accuracy` where the data has it, else `f1`.
        rows: The rows in the order of the pipeline.
        losses: What each stage costs, from the model up to the labels; they add up.
        causes: How the accuracy is lost along the labels, by `CAUSES`; empty without accuracy.
        names: Names of the images.
        lines: The lines of each image, by the name of the oracle.
    """

    headline: str
    rows: Sequence[Row]
    losses: Sequence[Loss]
    causes: Mapping[str, float]
    names: Sequence[str]
    lines: Mapping[str, Sequence[Polylines]]

    @property
    def dominant(self) -> Loss:
        """The stage that costs most."""
        return max(self.losses, key=lambda loss: loss.values[self.headline])

    @property
    def verdict(self) -> str:
        """One sentence: what limits the model on these images."""
        ranked = sorted(self.losses, key=lambda loss: -loss.values[self.headline])
        parts = [
            f"{loss.stage} ({_short(loss.values[self.headline])})"
            for loss in ranked
            if loss.values[self.headline] > _WORTH_NAMING
        ]
        images = "this image" if len(self.names) == 1 else f"these {len(self.names)} images"
        if not parts:
            return f"Nothing limits this model on {images}: its {self.headline} is that of the labels."
        then = f", then {' and '.join(parts[1:3])}" if parts[1:] else ""
        return f"What limits the {self.headline} of this model on {images}: {parts[0]}{then}."


def diagnose(
    predictor: Predictor,
    dataset: Dataset,
    *,
    prior: Prior | None = None,
    groups: Callable[[str], str] | None = None,
    progress: Progress = iter,
) -> Diagnosis:
    """Gives what limits a model on a dataset: its scores with each step replaced by the truth.

    The network runs once for each image.

    Args:
        predictor: The model.
        dataset: Labelled images.
        prior: The medoid of training labels, for a row without any image.
        groups: From the name of an image to that of its group, see `yolino.evaluate.evaluate`.
        progress: Wraps the indices that are looped over, to show a progress bar.

    Raises:
        ValueError: The dataset is empty, or has no labelled line, or an image is damaged.
        FileNotFoundError: An image is missing.
    """
    if len(dataset) == 0:
        raise ValueError("The dataset has no samples: check the root and the label files.")
    oracles = ({} if prior is None else {"no_image": no_image(prior)}) | ORACLES
    directed = predictor.header.directed and dataset.directed
    radius = point_radius(predictor.header)
    boards = {name: Scoreboard(dataset, directed=directed, radius=radius) for name in oracles}
    lines: dict[str, list[Polylines]] = {name: [] for name in oracles}
    causes, names, members = _Causes(), list[str](), list[str]()
    for seen in _each_image(predictor, dataset, oracles, progress):
        names.append(seen.sample.name)
        if groups is not None:
            members.append(groups(seen.sample.name))
        for name, found in seen.found.items():
            boards[name].add(seen.place, seen.sample, seen.size, found)
            lines[name].append(found.polylines)
        if boards["model"].tusimple is not None:
            causes.add(columns_of(dataset, seen.place, seen.sample, lines["model"][-1], seen.size))
    if not any(map(len, lines["labels"])):
        raise ValueError(
            f"None of the {len(names)} images has a labelled line, so nothing can be missing: take images "
            "with labels."
        )
    draws = draw_weights(len(names), None if groups is None else members)
    return _diagnosis(
        {name: (each.title, boards[name]) for name, each in oracles.items()},
        draws,
        causes.shares(),
        names,
        lines,
    )


class _Seen(NamedTuple):
    """What all oracles found in one image."""

    place: int
    sample: Sample
    size: tuple[int, int]
    found: Mapping[str, Found]


def _each_image(
    predictor: Predictor, dataset: Dataset, oracles: Mapping[str, Oracle], progress: Progress
) -> Iterator[_Seen]:
    everything = see_everything(predictor)
    renamed = label_map(dataset.classes, predictor.header.classes)
    for index in progress(range(len(dataset))):
        sample = dataset[index]
        case = make_case(
            everything,
            sample,
            pixels_of(sample),
            threshold=predictor.threshold,
            renamed=renamed,
            directed=dataset.directed,
            slack=_slack(dataset, index),
        )
        yield _Seen(index, sample, case.size, {name: each.apply(case) for name, each in oracles.items()})


def _slack(dataset: Dataset, index: int) -> float:
    """Gives by how many pixels labels go on for the oracles: a part of the spacing of their rows."""
    if not isinstance(dataset, TuSimple):
        return 0.0
    rows = np.unique(dataset.record(index)["h_samples"])
    return _SLACK_ROWS * float(np.diff(rows).min()) if len(rows) > 1 else 0.0


class _Causes:
    """How the accuracy of the model is lost, summed over the images."""

    def __init__(self) -> None:
        self.sums: Float[np.ndarray, " c"] = np.zeros(len(CAUSES))
        self.images = 0

    def add(self, columns: Columns) -> None:
        """Adds one image."""
        self.sums = self.sums + lost_in_image(*columns)
        self.images += 1

    def shares(self) -> dict[str, float]:
        """Gives the mean loss by cause."""
        return dict(zip(CAUSES, (self.sums / max(self.images, 1)).tolist(), strict=True))


def _diagnosis(
    boards: Mapping[str, tuple[str, Scoreboard]],
    draws: Float[np.ndarray, "b n"],
    causes: Mapping[str, float],
    names: Sequence[str],
    lines: Mapping[str, Sequence[Polylines]],
) -> Diagnosis:
    """Gives the diagnosis of scores; draws say how often each image counts, for the intervals."""
    whole = {name: board.weighted(np.ones((1, len(names)))) for name, (_, board) in boards.items()}
    drawn = {name: board.weighted(draws) for name, (_, board) in boards.items()}
    alone = {name: board.weighted(np.eye(len(names))) for name, (_, board) in boards.items()}
    headline = "accuracy" if "accuracy" in whole["model"] else "f1"
    rows = [
        Row(
            name,
            title,
            {score: float(value[0]) for score, value in whole[name].items()},
            {score: interval(values) for score, values in drawn[name].items()},
            float(whole[name][headline][0] - whole["model"][headline][0]),
        )
        for name, (title, _) in boards.items()
    ]
    losses = [
        Loss(
            step.stage,
            {score: float(v[0]) for score, v in lost(whole[step.below], whole[step.above]).items()},
            {score: interval(v) for score, v in lost(drawn[step.below], drawn[step.above]).items()},
            lost(alone[step.below], alone[step.above])[headline].tolist(),
        )
        for step in LADDER
    ]
    return Diagnosis(headline, rows, losses, causes if headline == "accuracy" else {}, names, lines)


def _short(value: float) -> str:
    return f"{value:.3f}".lstrip("0")


__all__ = ["Diagnosis", "Loss", "Row", "diagnose"]
