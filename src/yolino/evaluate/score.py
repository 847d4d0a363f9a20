"""Scores of result files against label files: any format on both sides, no model."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Protocol, runtime_checkable

import numpy as np

from yolino.datasets import Dataset
from yolino.datasets.description import NAMES as DESCRIPTIONS
from yolino.datasets.description import arguments_of, build, load_description, open_split
from yolino.datasets.detection import detect_format
from yolino.io import image_size
from yolino.metrics import ClassMetric, Metric, bootstrap_intervals
from yolino.types import Polylines, Sample

Size = tuple[int, int]


@dataclass(frozen=True)
class Side:
    """Predictions, or labels.

    Attributes:
        path: The file or folder.
        samples: What it holds.
    """

    path: Path
    samples: Dataset

    @property
    def classes(self) -> tuple[str, ...]:
        """Names of the classes."""
        return self.samples.classes


def open_side(path: Path, *, format: str | None = None, names: Path | None = None, **changes: Any) -> Side:
    """Opens predictions or labels; their images need not be there.

    Args:
        path: A label file, a folder, or a data.yaml.
        format: Name in `DATASETS`; None finds it out.
        names: A list of the images to take.
        changes: Further arguments of the format; those that it does not take are left out.

    Raises:
        FileNotFoundError: There is no such file or folder.
        ValueError: The format is unknown, or the labels are broken.
    """
    arguments: dict[str, Any] = {"require_images": False, **changes}
    if names is not None:
        arguments["names"] = names.resolve() if names.is_file() else names
    described = path.is_dir() and any((path / name).is_file() for name in DESCRIPTIONS)
    if format is None and (described or path.suffix in (".yaml", ".yml")):
        description = load_description(path)
        return Side(path, open_split(description, **_fitting(description.format, arguments)))
    format = format or detect_format(path)
    if path.is_file():
        arguments |= {"root": path.parent, "labels": path.resolve()}
    else:
        arguments["root"] = path
    return Side(path, build(format, _fitting(format, arguments)))


def _fitting(format: str, arguments: dict[str, Any]) -> dict[str, Any]:
    known = arguments_of(format)
    return {key: value for key, value in arguments.items() if key in known}


def pairs(predictions: Side, labels: Side, *, strict: bool = True) -> Iterator[tuple[Sample | None, Sample]]:
    """Yields each labelled image with its prediction, None where there is no prediction for it.

    Names are compared without suffix. They are the same if one is the end of the other
    (`clips/a/20.jpg` and `a/20`), or, failing that, if the files are called alike and no others are.

    Args:
        predictions: What was found.
        labels: What there is.
        strict: Whether predictions for images that are not labelled are a mistake.

    Raises:
        ValueError: A prediction belongs to no labelled image, or a name fits several.
    """
    matched = _match(_names(predictions), _names(labels), f"{predictions.path} and {labels.path}")
    used = {index for index in matched if index is not None}
    if strict and len(used) < len(predictions.samples):
        extra = next(name for i, name in enumerate(_names(predictions)) if i not in used)
        raise ValueError(
            f"{predictions.path} predicts {len(predictions.samples) - len(used)} images that {labels.path} "
            f"does not label, first {extra!r}: are these the right files?"
        )
    for place, index in enumerate(matched):
        yield None if index is None else predictions.samples[index], labels.samples[place]


def _match(predicted: Sequence[str], labelled: Sequence[str], where: str) -> list[int | None]:
    """Gives the index of the prediction of each label."""
    wholes, tails, stems = (defaultdict[str, list[int]](list) for _ in range(3))
    for index, name in enumerate(predicted):
        keys = _tails(name)
        wholes[keys[0]].append(index)
        stems[keys[-1]].append(index)
        for key in keys:
            tails[key].append(index)
    alike = Counter(_tails(name)[-1] for name in labelled)
    matched: list[int | None] = []
    for name in labelled:
        keys = _tails(name)
        found = next((wholes[key] for key in keys if key in wholes), None) or tails.get(keys[0], [])
        if not found and alike[keys[-1]] == 1 and len(stems.get(keys[-1], [])) == 1:
            found = stems[keys[-1]]
        if len(found) > 1 or (found and found[0] in matched):
            raise ValueError(
                f"In {where} several images could be {name}: name the images by their whole paths."
            )
        matched.append(found[0] if found else None)
    return matched


def _names(side: Side) -> list[str]:
    annotations = getattr(side.samples, "annotations", None)
    if annotations is not None:
        return [one.image for one in annotations]
    return [side.samples[i].name for i in range(len(side.samples))]  # drawn scenes


def _tails(name: str) -> list[str]:
    """Gives the ends of a path without its suffix, the longest first."""
    path = PurePosixPath(name.replace("\\", "/").lstrip("/"))
    parts = [part for part in path.parts[:-1] if part not in ("", ".", "..")] + [path.name.split(".")[0]]
    return ["/".join(parts[i:]) for i in range(len(parts))]


@dataclass(frozen=True)
class Scores:
    """What `score` found.

    Attributes:
        values: The scores by name, the counts that some metrics have (`tp`, `fp`, `fn`), and `images`.
        categories: The scores of each list of images, by the name of the list, where there are several.
        missing: Labelled images without a prediction; they count as misses.
        intervals: 95 % confidence intervals of the scores, if asked for.
        classes: Names of the classes that are compared; none where classes do not count.
        confusion: Found samples of each true class (row) and predicted class (column), for the metric of
            classes.
    """

    values: dict[str, float | int]
    categories: dict[str, dict[str, float]]
    missing: int
    intervals: dict[str, tuple[float, float]]
    classes: tuple[str, ...] = ()
    confusion: Sequence[Sequence[int]] = ()


def score(
    make: Callable[[Sequence[str]], Metric],
    predictions: Path,
    labels: Path,
    *,
    lists: Sequence[Path] = (),
    size: Size | None = None,
    format: str | None = None,
    intervals: bool = False,
    progress: Callable[[Iterable[Any]], Iterable[Any]] = iter,
) -> Scores:
    """Gives the scores of predictions in files against labels in files.

    Args:
        make: Gives the metric for the names of the classes (none for labels with a single class).
        predictions: A label file, a folder or a data.yaml.
        labels: Likewise.
        lists: Lists of image names, one per category; predictions for other images are then left aside.
        size: `(height, width)` of the images, where neither the files nor the images tell.
        format: Format of both sides; None finds it out for each.
        intervals: Whether to compute confidence intervals.
        progress: Wraps what is looped over, to show a progress bar.

    Raises:
        FileNotFoundError: A file is missing.
        ValueError: A format is unknown, a file is broken, the sides do not fit each other, or the size of an
            image is not known.
    """
    found = open_side(predictions, format=format, progress=progress)
    sides = [open_side(labels, format=format, names=one, progress=progress) for one in lists or (None,)]
    classes = found.classes if len(sides[0].classes) == 1 else sides[0].classes
    compared = tuple(classes) if len(classes) > 1 and len(sides[0].classes) > 1 else ()
    metric = make(compared)
    missing, counts = 0, []
    for side in sides:
        before = len(metric)
        missing += _add(metric, pairs(found, side, strict=not lists), size, _renaming(found, side), progress)
        counts.append(len(metric) - before)
    values: dict[str, float | int] = {**metric.compute(), "images": len(metric)}
    if isinstance(metric, Counting):
        values = {**metric.counts(), **values}
    member = np.repeat(np.arange(len(counts)), counts)
    categories = {}
    if len(lists) > 1:
        rows = metric.weighted((member[None] == np.arange(len(counts))[:, None]).astype(np.float64))
        categories = {
            one.stem: {name: float(scores[i]) for name, scores in rows.items()} for i, one in enumerate(lists)
        }
    ranges = bootstrap_intervals(metric, np.random.default_rng(0)) if intervals else {}
    confusion = metric.confusion.tolist() if isinstance(metric, ClassMetric) else ()
    return Scores(values, categories, missing, ranges, compared, confusion)


@runtime_checkable
class Counting(Protocol):
    """A metric that also has plain counts."""

    def counts(self) -> dict[str, int]:
        """Gives the counts by name."""


def _add(
    metric: Metric,
    images: Iterator[tuple[Sample | None, Sample]],
    size: Size | None,
    rename: np.ndarray | None,
    progress: Callable[[Iterable[Any]], Iterable[Any]],
) -> int:
    """Adds images to a metric; gives how many have no prediction."""
    missing = 0
    for prediction, label in progress(images):
        missing += prediction is None
        found = Polylines.from_list([]) if prediction is None else _renamed(prediction.polylines, rename)
        truth = label.polylines if rename is not None else _renamed(label.polylines, None)
        metric.update(found, truth, _size(prediction, label, size), label.ignore)
    return missing


def _size(prediction: Sample | None, label: Sample, size: Size | None) -> Size:
    for sample in (label, prediction):
        if sample is not None and sample.size is not None:
            return sample.size
    if size is not None:
        return size
    for sample in (label, prediction):
        if sample is not None and isinstance(sample.image, Path) and sample.image.is_file():
            return image_size(sample.image)
    raise ValueError(
        f"The size of {label.name} is neither in the files nor is its image there: give --size HEIGHTxWIDTH."
    )


def _renaming(predictions: Side, labels: Side) -> np.ndarray | None:
    """Gives the label side's label of each predicted label; None if a side has only one class."""
    predicted, labelled = predictions.classes, labels.classes
    if len(predicted) <= 1 and len(labelled) <= 1:
        return None
    if len(labelled) <= 1 or (len(predicted) == 1 and predicted[0] not in labelled):
        return None
    unknown = [name for name in predicted if name not in labelled]
    if unknown:
        raise ValueError(
            f"The predictions have the class {unknown[0]!r}, which the labels lack; "
            f"they have {', '.join(labelled)}."
        )
    return np.array([labelled.index(name) for name in predicted], np.int64)


def _renamed(polylines: Polylines, rename: np.ndarray | None) -> Polylines:
    labels = np.zeros(len(polylines), np.int64) if rename is None else rename[polylines.labels]
    return Polylines(polylines.vertices, polylines.offsets, polylines.scores, labels)


__all__ = ["Scores", "Side", "open_side", "pairs", "score"]
