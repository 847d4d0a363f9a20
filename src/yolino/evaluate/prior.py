"""The prior: what a score is worth that needs no image at all, because lines are where they always are."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from yolino.datasets import Dataset
from yolino.evaluate.oracles import Found, Oracle
from yolino.evaluate.oracles_case import Case
from yolino.io import image_size
from yolino.metrics import PointMetric
from yolino.postprocess.mapping import map_polylines
from yolino.types import Polylines, Sample, Segments

MOST = 200
"""So many training samples are compared with each other; of more, evenly chosen ones."""
_WIDTH = 640.0  # pixels in which they are compared: an accuracy of 4 px is enough to choose one
_SPACING = 4.0


class Prior(NamedTuple):
    """The medoid of training labels.

    Attributes:
        name: Name of the sample that it is.
        polylines: Its labels.
        size: `(height, width)` of its image.
        f1: Mean F1 of its lines on all the others.
    """

    name: str
    polylines: Polylines
    size: tuple[int, int]
    f1: float


def find_prior(dataset: Dataset, *, progress: Callable[[Sequence[int]], Iterable[int]] = iter) -> Prior:
    """Gives the medoid of training labels: the sample whose lines score best on all the other samples.

    Lines are compared by the F1 of the point metric, all scaled to one image size.

    Args:
        dataset: The training labels; their images are not read where the labels state sizes.
        progress: Wraps what is looped over, to show a progress bar.

    Raises:
        ValueError: There are no samples, or no lines.
    """
    if len(dataset) == 0:
        raise ValueError("The prior needs training labels, but the dataset has no samples: check --prior.")
    chosen = np.unique(np.linspace(0, len(dataset) - 1, min(len(dataset), MOST)).round().astype(np.int64))
    samples = [dataset[int(i)] for i in chosen]
    sizes = [_size(sample) for sample in samples]
    if not any(len(sample.polylines) for sample in samples):
        raise ValueError("The prior needs training labels, but no sample has a line: check --prior.")
    height = round(_WIDTH * float(np.median([h / w for h, w in sizes])))
    common = (height, int(_WIDTH))
    lines = [scaled(sample.polylines, size, common) for sample, size in zip(samples, sizes, strict=True)]
    scores = np.array([_mean_f1(lines, i, common, dataset.directed) for i in progress(range(len(lines)))])
    best = int(scores.argmax())
    return Prior(samples[best].name, samples[best].polylines, sizes[best], float(scores[best]))


def no_image(prior: Prior) -> Oracle:
    """Gives the row that replaces the model by the same lines in every image."""

    def always(case: Case) -> Found:
        lines = scaled(prior.polylines, prior.size, case.size)
        return Found(Segments(lines.endpoints, labels=lines.labels[lines.owners]), lines)

    return Oracle("no image", always)


def scaled(polylines: Polylines, size: tuple[int, int], wanted: tuple[int, int]) -> Polylines:
    """Gives the polylines of an image of `size` (height, width) in one of the wanted size, all of label 0."""
    stretch = np.diag([wanted[1] / size[1], wanted[0] / size[0], 1.0])
    moved: Any = map_polylines(polylines, stretch)
    return Polylines(moved.vertices, moved.offsets)


def _mean_f1(lines: Sequence[Polylines], index: int, size: tuple[int, int], directed: bool) -> float:
    metric = PointMetric(spacing=_SPACING, directed=directed)
    for i, truth in enumerate(lines):
        if i != index or len(lines) == 1:
            metric.update(lines[index], truth, size)
    return float(metric.weighted(np.eye(len(metric)))["f1"].mean())


def _size(sample: Sample) -> tuple[int, int]:
    if sample.size is not None:
        return sample.size
    if isinstance(sample.image, np.ndarray):
        return sample.image.shape[0], sample.image.shape[1]
    return image_size(sample.image)


__all__ = ["MOST", "Prior", "find_prior", "no_image", "scaled"]
