"""How good a model is on a labelled dataset: the paper's point metric and the TuSimple benchmark's scores."""

from __future__ import annotations

import heapq
import logging
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from statistics import median
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt8

from yolino.datasets import Dataset, TuSimple
from yolino.datasets.tusimple import Record, polylines_to_record, write_records
from yolino.inference import Predictor, Stages
from yolino.io import read_image, write_image
from yolino.metrics import ClassMetric, PointMatch, PointMetric, TuSimpleMetric
from yolino.metrics.tusimple import TIME_LIMIT_MS
from yolino.types import Polylines, Sample
from yolino.viz import contact_sheet, draw_matches

_log = logging.getLogger(__name__)

SUBMISSION = "predictions.json"
Progress = Callable[[Sequence[int]], Iterable[int]]
Image = UInt8[np.ndarray, "h w 3"]


def evaluate(
    predictor: Predictor,
    dataset: Dataset,
    *,
    save: Path | None = None,
    worst: int = 9,
    progress: Progress = iter,
) -> dict[str, float]:
    """Gives the scores of a model on a dataset.

    Precision, recall and F1 are the paper's point metric over the polylines, which are the result; those that
    begin with `segment_` are the same over the segments that the NMS leaves, as the paper reports them.
    Accuracy, FP and FN are those of the TuSimple benchmark; for other datasets they are alike, at rows
    of their images, and left out if there are ignored regions. An image that takes more than 200 ms is wrong
    by the benchmark's rules; here that is a warning, as it says more about the machine than about the model.

    Args:
        predictor: The model.
        dataset: Labelled images.
        save: Folder for pictures of the worst images (by the F1 of their polylines) and, for TuSimple, the
            benchmark's submission file `predictions.json`.
        worst: Number of such pictures.
        progress: Wraps the indices that are looped over, to show a progress bar.

    Returns:
        `accuracy`, `fp`, `fn`, `precision`, `recall`, `f1`, `segment_precision`, `segment_recall`,
        `segment_f1`, `class_accuracy` (model and dataset with the same classes), `images`, `fps` and
        `ms` (median time from image array to polylines).

    Raises:
        ValueError: The dataset is empty or an image is damaged.
        FileNotFoundError: An image is missing.
    """
    if len(dataset) == 0:
        raise ValueError("The dataset has no samples: check the root and the label files.")
    scores = _Scores(predictor, dataset)
    pictures = _Worst(worst if save is not None else 0)
    predictor.warm_up()
    for index in progress(range(len(dataset))):
        sample = dataset[index]
        image = _pixels(sample)
        start = time.perf_counter()
        stages = predictor.stages(image)
        match = scores.add(index, sample, image, stages, (time.perf_counter() - start) * 1e3)
        pictures.add(sample, match)
    if save is not None:
        if scores.records:
            write_records(save / SUBMISSION, scores.records)
        pictures.write(save)
    return scores.compute()


def _pixels(sample: Sample) -> Image:
    return read_image(sample.image) if isinstance(sample.image, Path) else sample.image


class _Scores:
    """The metrics of one evaluation."""

    def __init__(self, predictor: Predictor, dataset: Dataset) -> None:
        directed = predictor.header.directed and dataset.directed
        self.dataset = dataset
        self.segments, self.polylines = PointMetric(directed=directed), PointMetric(directed=directed)
        self.tusimple = TuSimpleMetric()
        self.records: list[Record] = []
        self.milliseconds: list[float] = []
        self.labels = _label_map(dataset.classes, predictor.header.classes)
        self.classes = (
            ClassMetric(predictor.header.classes, directed=directed) if self.labels is not None else None
        )
        self.ignored = False

    def add(
        self, index: int, sample: Sample, image: Image, stages: Stages, milliseconds: float
    ) -> PointMatch:
        """Adds one image; gives how its polylines match."""
        size = (image.shape[0], image.shape[1])
        self.milliseconds.append(milliseconds)
        self.segments.update(stages.segments, sample.polylines, size, sample.ignore)
        self.polylines.update(stages.polylines, sample.polylines, size, sample.ignore)
        if self.classes is not None and self.labels is not None:
            truth = sample.polylines
            renamed = Polylines(truth.vertices, truth.offsets, truth.scores, self.labels[truth.labels])
            self.classes.update(stages.polylines, renamed, size, sample.ignore)
        self._add_tusimple(index, sample, stages.polylines, size)
        return self.polylines.match(stages.polylines, sample.polylines, size, sample.ignore)

    def _add_tusimple(self, index: int, sample: Sample, polylines: Polylines, size: tuple[int, int]) -> None:
        if isinstance(self.dataset, TuSimple):
            label, taken = self.dataset.record(index), round(self.milliseconds[-1], 3)
            rows = label["h_samples"]
            record = polylines_to_record(label["raw_file"], polylines, rows, size=size, run_time=taken)
            self.tusimple.update_lanes(record["lanes"], label["lanes"], rows)
            self.records.append(record)
        elif len(sample.ignore):
            self.ignored = True
        else:
            self.tusimple.update(polylines, sample.polylines, size)

    def compute(self) -> dict[str, float]:
        """Gives the scores by name."""
        scores: dict[str, float] = {}
        if not self.ignored:
            official = self.tusimple.compute()
            scores |= {name: official[name] for name in ("accuracy", "fp", "fn")}
        scores |= self.polylines.compute()
        scores |= {f"segment_{name}": value for name, value in self.segments.compute().items()}
        if self.classes is not None:
            scores |= self.classes.compute()
        typical = median(self.milliseconds)
        late = sum(taken > TIME_LIMIT_MS for taken in self.milliseconds)
        if late and self.records:
            _log.warning(
                "%d of %d images took more than %.0f ms on this machine: the benchmark's own script will "
                "count them as wrong, the scores here do not.",
                late,
                len(self.milliseconds),
                TIME_LIMIT_MS,
            )
        return scores | {"images": len(self.milliseconds), "fps": 1e3 / typical, "ms": typical}


def _label_map(labelled: tuple[str, ...], predicted: tuple[str, ...]) -> np.ndarray | None:
    """Gives the model's label for each label of the dataset; None if the model lacks one of them."""
    if not predicted or any(name not in predicted for name in labelled):
        return None
    return np.array([predicted.index(name) for name in labelled], np.int64)


class _Candidate(NamedTuple):
    """An image that is among the worst so far; ordered by goodness, then by place."""

    badness: float
    place: int
    sample: Sample
    match: PointMatch


class _Worst:
    """Remembers the worst images and draws them."""

    def __init__(self, count: int) -> None:
        self.count, self.seen = count, 0
        self.heap: list[_Candidate] = []

    def add(self, sample: Sample, match: PointMatch) -> None:
        """Takes note of one image."""
        self.seen += 1
        candidate = _Candidate(1 - match.scores()["f1"], -self.seen, sample, match)
        if len(self.heap) < self.count:
            heapq.heappush(self.heap, candidate)
        elif self.heap:
            heapq.heappushpop(self.heap, candidate)

    def write(self, folder: Path) -> None:
        """Writes a picture of each, and all of them on one sheet."""
        pictures, titles = [], []
        for rank, (badness, _, sample, match) in enumerate(sorted(self.heap, reverse=True), 1):
            found, truth = match.prediction.points, match.truth.points
            picture = draw_matches(
                _pixels(sample),
                hits=found[match.true_positives],
                false_alarms=found[match.false_positives],
                misses=truth[match.false_negatives],
            )
            name = Path(sample.name).with_suffix("").as_posix().replace("/", "-")
            write_image(folder / "worst" / f"{rank:02d}-{name}.png", picture)
            pictures.append(picture)
            titles.append(f"F1 {1 - badness:.2f}  {sample.name}")
        if pictures:
            write_image(folder / "worst.png", contact_sheet(pictures, titles))


__all__ = ["evaluate"]
