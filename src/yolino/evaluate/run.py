"""How good a model is on a labelled dataset."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np

from yolino.datasets import Dataset, TuSimple
from yolino.datasets.tusimple import Record, polylines_to_record, write_records
from yolino.evaluate.kinds import label_map
from yolino.evaluate.worst import BadImage, Image, WorstImages, pixels_of
from yolino.header import Header
from yolino.inference import Predictor, Stages
from yolino.metrics import (
    ClassMetric,
    Metric,
    PointMatch,
    PointMetric,
    TuSimpleMetric,
    bootstrap_intervals,
)
from yolino.metrics.tusimple import TIME_LIMIT_MS
from yolino.types import Polylines, Sample

_log = logging.getLogger(__name__)

SUBMISSION = "predictions.json"
RADIUS_CELLS = 0.8
_OFFICIAL = ("accuracy", "fp", "fn", "fn_strict")  # the last is ours
Progress = Callable[[Sequence[int]], Iterable[int]]
Interval = tuple[float, float]


@dataclass(frozen=True)
class Evaluation:
    """What an evaluation found.

    Attributes:
        scores: The scores by name, `images`, and the speed: `fps` and `ms` (median).
        intervals: 95 % confidence intervals of the scores, `(low, high)`.
        worst: The worst images, the worst first, if pictures were asked for.
        classes: Names of the classes, if they were compared.
        confusion: Found samples of each true class (row) and predicted class (column), see `ClassMetric`.
        line_confusion: Found lines, likewise.
    """

    scores: dict[str, float | int]
    intervals: dict[str, Interval]
    worst: Sequence[BadImage] = ()
    classes: tuple[str, ...] = ()
    confusion: Sequence[Sequence[int]] = ()
    line_confusion: Sequence[Sequence[int]] = ()


def evaluate(
    predictor: Predictor,
    dataset: Dataset,
    *,
    metrics: Mapping[str, Metric] | None = None,
    groups: Callable[[str], str] | None = None,
    save: Path | None = None,
    worst: int = 9,
    progress: Progress = iter,
) -> Evaluation:
    """Gives the scores of a model on a dataset, and how sure they are.

    Without `metrics` these are the paper's and the TuSimple benchmark's. Precision, recall and F1 are the
    paper's point metric over the polylines, which are the result; those that begin with `segment_` are the
    same over the segments that the NMS leaves, as the paper reports them. Accuracy, FP and FN are those of
    the TuSimple benchmark, `fn_strict` is the FN without its rule that forgives the worst lane where more
    than four are labelled; for other datasets they are alike, at rows of their images, and left out if there
    are ignored regions or the model goes over the image in windows. If the model knows the dataset's classes
    (`label_map`), there are also the scores of `ClassMetric` (`class_accuracy`), and the point metric of each
    class (`f1_way`). `radius` is that of the point metric, see `point_radius`.

    An image that takes more than 200 ms is wrong by the TuSimple benchmark's rules; here that is a warning,
    as it says more about the machine than about the model.

    Args:
        predictor: The model.
        dataset: Labelled images.
        metrics: Metrics over the polylines by name. The scores of a single one keep their names, those of
            several begin with the name of the metric: `chamfer_ap`.
        groups: From the name of an image to that of its group, its clip say: intervals come from drawing
            groups, not images.
        save: Folder for pictures of the worst images (by the F1 of their polylines) and, for TuSimple, the
            benchmark's submission file `predictions.json`.
        worst: Number of such pictures.
        progress: Wraps the indices that are looped over, to show a progress bar.

    Raises:
        ValueError: The dataset is empty, an image is damaged, or a metric compares classes that the model
            does not know.
        FileNotFoundError: An image is missing.
    """
    if len(dataset) == 0:
        raise ValueError("The dataset has no samples: check the root and the label files.")
    scores = _Scores(predictor, dataset, metrics)
    pictures = WorstImages(worst if save is not None else 0)
    members: list[str] = []
    predictor.warm_up()
    for index in progress(range(len(dataset))):
        sample = dataset[index]
        image = pixels_of(sample)
        start = time.perf_counter()
        stages = predictor.stages(image)
        match = scores.add(index, sample, image, stages, (time.perf_counter() - start) * 1e3)
        pictures.add(sample, match)
        if groups is not None:
            members.append(groups(sample.name))  # now: what is wrong with it must not cost the work
    written: Sequence[BadImage] = ()
    if save is not None:
        if scores.records:
            write_records(save / SUBMISSION, scores.records)
        written = pictures.write(save)
    found, intervals = scores.compute(None if groups is None else members)
    return Evaluation(found, intervals, written, *scores.confusions())


def point_radius(header: Header) -> float | None:
    """Gives the radius of the point metric in pixels of the image for a model; None for the metric's own.

    The paper's radius, a fiftieth of the width of its input of 640 px, is 0.8 of its cells of 16 px. A model
    that goes over images in windows has no image width to take a part of; its radius is as many cells.
    """
    return RADIUS_CELLS * header.stride / header.scale if header.fit == "window" else None


def _listed(classes: Sequence[str]) -> str:
    return ", ".join(classes) or "none"


class _Scores:
    """The metrics of one evaluation."""

    def __init__(self, predictor: Predictor, dataset: Dataset, metrics: Mapping[str, Metric] | None) -> None:
        directed = predictor.header.directed and dataset.directed
        self.dataset, self.radius = dataset, point_radius(predictor.header)
        self.points = PointMetric(directed=directed, radius=self.radius)
        self.tusimple = TuSimpleMetric()
        self.records: list[Record] = []
        self.milliseconds: list[float] = []
        self.labels = label_map(dataset.classes, predictor.header.classes)
        if self.labels is None and min(len(dataset.classes), len(predictor.header.classes)) > 1:
            _log.warning(
                "classes are not compared: the model knows %s, the labels %s",
                ", ".join(predictor.header.classes),
                ", ".join(dataset.classes),
            )
        if self.labels is None and any(isinstance(one, ClassMetric) for one in (metrics or {}).values()):
            raise ValueError(
                f"Classes cannot be compared: the model knows {_listed(predictor.header.classes)}, the "
                f"labels {_listed(dataset.classes)}. Leave out the metric of classes."
            )
        self.ignored = False
        self.chosen = metrics
        self.segments: Metric | None = None
        self.lines = dict(metrics or {})
        if metrics is None:
            names = predictor.header.classes if self.labels is not None else ()
            self.segments = PointMetric(directed=directed, radius=self.radius)
            self.lines["points"] = PointMetric(directed=directed, radius=self.radius, classes=names)
            if names:
                self.lines["classes"] = ClassMetric(names, directed=directed, radius=self.radius)
        self.official = self.radius is None if metrics is None else "tusimple" in metrics
        self.lines.pop("tusimple", None)

    def add(
        self, index: int, sample: Sample, image: Image, stages: Stages, milliseconds: float
    ) -> PointMatch:
        """Adds one image; gives how its polylines match."""
        size = (image.shape[0], image.shape[1])
        self.milliseconds.append(milliseconds)
        truth = sample.polylines
        if self.labels is not None:
            truth = Polylines(truth.vertices, truth.offsets, truth.scores, self.labels[truth.labels])
        if self.segments is not None:
            self.segments.update(stages.segments, truth, size, sample.ignore)
        for metric in self.lines.values():
            metric.update(stages.polylines, truth, size, sample.ignore)
        if self.official or isinstance(self.dataset, TuSimple):
            self._add_tusimple(index, sample, stages.polylines, size)
        return self.points.match(stages.polylines, sample.polylines, size, sample.ignore)

    def _add_tusimple(self, index: int, sample: Sample, polylines: Polylines, size: tuple[int, int]) -> None:
        if isinstance(self.dataset, TuSimple):
            label, taken = self.dataset.record(index), round(self.milliseconds[-1], 3)
            rows = label["h_samples"]
            record = polylines_to_record(label["raw_file"], polylines, rows, size=size, run_time=taken)
            self.tusimple.update_lanes(record["lanes"], label["lanes"], rows)
            self.records.append(record)
        elif len(sample.ignore) and self.chosen is None:
            self.ignored = True
        else:
            self.tusimple.update(polylines, sample.polylines, size, sample.ignore)

    def _metrics(self) -> list[tuple[str, Metric, tuple[str, ...] | None]]:
        """Gives what begins the names of the scores, the metric, and which of its scores to take (all)."""
        found: list[tuple[str, Metric, tuple[str, ...] | None]] = []
        several = self.chosen is not None and len(self.chosen) > 1
        if self.official and not self.ignored:
            found.append(("tusimple_" * several, self.tusimple, _OFFICIAL))
        found += [(f"{name}_" * several, metric, None) for name, metric in self.lines.items()]
        if self.segments is not None:
            found.insert(len(found) - ("classes" in self.lines), ("segment_", self.segments, None))
        return found

    def compute(self, groups: Sequence[str] | None) -> tuple[dict[str, float | int], dict[str, Interval]]:
        """Gives the scores and their intervals by name."""
        scores: dict[str, float | int] = {}
        intervals: dict[str, Interval] = {}
        for prefix, metric, wanted in self._metrics():
            values = metric.compute()
            ranges = bootstrap_intervals(metric, np.random.default_rng(0), groups=groups)
            for name in wanted or values:
                scores[prefix + name], intervals[prefix + name] = values[name], ranges[name]
        self._warn_if_late()
        typical = median(self.milliseconds)
        if self.segments is not None and self.radius is not None:
            scores["radius"] = self.radius
        scores |= {"images": len(self.milliseconds), "fps": 1e3 / typical, "ms": typical}
        return scores, intervals

    def confusions(self) -> tuple[tuple[str, ...], Sequence[Sequence[int]], Sequence[Sequence[int]]]:
        """Gives the classes with their confusion matrices of samples and of lines, if they were compared."""
        for metric in self.lines.values():
            if isinstance(metric, ClassMetric) and metric.classes:
                return metric.classes, metric.confusion.tolist(), metric.line_confusion.tolist()
        return (), (), ()

    def _warn_if_late(self) -> None:
        late = sum(taken > TIME_LIMIT_MS for taken in self.milliseconds)
        if late and self.records:
            _log.warning(
                "%d of %d images took more than %.0f ms on this machine: the benchmark's own script will "
                "count them as wrong, the scores here do not.",
                late,
                len(self.milliseconds),
                TIME_LIMIT_MS,
            )


__all__ = ["RADIUS_CELLS", "SUBMISSION", "Evaluation", "evaluate", "point_radius"]
