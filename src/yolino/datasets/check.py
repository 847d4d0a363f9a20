"""What is wrong with a dataset, how full its cells are, and the error that cells cause (paper, Tab. 6)."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from yolino.datasets.batch import Batch
from yolino.datasets.dataset import Dataset
from yolino.datasets.faults import polyline_findings
from yolino.datasets.files import FileDataset
from yolino.datasets.occupancy import Frame, Matrix, occupancy
from yolino.datasets.report import DeviationRow, Finding, Occupancy, Picture, Report, Size
from yolino.grid import Grid, cells_to_pixels, deviation, discretize
from yolino.io import image_size
from yolino.types import Polylines, Sample

_log = logging.getLogger(__name__)
# Samples that are examined together: enough for arrays to pay, few enough to see progress.
_TOGETHER = 256

Progress = Callable[[Sequence[int]], Iterable[int]]


def check(
    dataset: Dataset,
    strides: Sequence[int] = (32, 16, 8),
    predictors: int = 8,
    *,
    matrix: Matrix | Callable[[Size], Matrix] | None = None,
    size: Size | None = None,
    progress: Progress = iter,
) -> Report:
    """Gives what is wrong with a dataset. Of JPEGs only the header is read.

    Where an image is missing, the size that its labels state counts.

    Args:
        dataset: The dataset; one that does not insist on its images and leaves out what is broken
            (`FileDataset`: `require_images=False`, `skip_broken=True`) is examined to its end.
        strides: Sides of the cells, in pixels of the network frame.
        predictors: Predictors per cell that the cells are compared with.
        matrix: From the image frame to the network frame, or what gives it for an image size; None: they are
            the same.
        size: `(height, width)` of the network frame; None: the image, filled up to whole cells.
        progress: Wraps the indices that are looped over, to show a progress bar.

    Raises:
        ValueError: The dataset is empty, or only one of `matrix` and `size` is given.
    """
    frame = _frame(matrix, size)
    errors, left_out = (dataset.broken, dataset.left_out) if isinstance(dataset, FileDataset) else ((), {})
    broken = [Finding("broken label", error.where, error.reason) for error in errors]
    if not broken:
        _require_samples(dataset)
    indices = iter(progress(range(len(dataset))))
    parts = []
    while group := [_look(dataset[i]) for i in islice(indices, _TOGETHER)]:
        parts.append(_examine(group, dataset, frame, strides, predictors))
    sizes = Counter(one.size for part in parts for one in part.looks if one.size is not None)
    labels = sum((part.labels for part in parts), Counter[int]())
    empty = (Occupancy(stride, predictors) for stride in strides)
    full = zip(empty, *(part.occupancy for part in parts), strict=True)
    return Report(
        samples=sum(len(part.looks) for part in parts),
        polylines=labels.total(),
        vertices=sum(part.vertices for part in parts),
        sizes=dict(sizes.most_common()),
        class_counts={name: labels[i] for i, name in enumerate(dataset.classes)},
        findings=(*broken, *_findings(parts, sizes)),
        occupancy=tuple(sum(rest, first) for first, *rest in full),
        left_out=dict(left_out),
        pictures=tuple(Picture(one.name, one.file) for part in parts for one in part.looks),
    )


def deviation_table(
    dataset: Dataset,
    strides: Sequence[int] = (32, 16, 8),
    *,
    matrix: Matrix | Callable[[Size], Matrix] | None = None,
    size: Size | None = None,
    progress: Progress = iter,
) -> tuple[DeviationRow, ...]:
    """Gives for each stride how far the discretized polylines lie from the labels (paper, Tab. 6).

    Labels are cut off at the border of the network frame before. Samples without any label in it do not
    count.

    Args:
        dataset: The dataset.
        strides: Sides of the cells, in pixels of the network frame.
        matrix: From the image frame to the network frame, or what gives it for an image size; None: they are
            the same.
        size: `(height, width)` of the network frame; None: the image, filled up to whole cells.
        progress: Wraps the indices that are looped over, to show a progress bar.

    Raises:
        ValueError: The dataset is empty, a vertex is not finite, or only one of `matrix` and `size` is given.
        FileNotFoundError: An image is missing.
    """
    frame = _frame(matrix, size)
    _require_samples(dataset)
    rows: list[list[tuple[float, float, int, int]]] = [[] for _ in strides]
    for i in progress(range(len(dataset))):
        sample = dataset[i]
        image = _size_of(sample)
        polylines = frame.place(sample.polylines, image)
        for stride, row in zip(strides, rows, strict=True):
            if len(polylines):
                row.append(_deviations(polylines, frame.grid(image, stride)))
    return tuple(_average(stride, row) for stride, row in zip(strides, rows, strict=True))


class _Look(NamedTuple):
    """What there is to know of a sample without its polylines.

    `size` is that of the image, None where it cannot be read; `stated` what the labels say it is.
    """

    name: str
    file: Path | None
    size: Size | None
    stated: Size | None
    findings: list[Finding]


class _Part(NamedTuple):
    """What some samples add to the report; `findings` has a list for each of them."""

    looks: list[_Look]
    findings: list[list[Finding]]
    labels: Counter[int]
    vertices: int
    occupancy: tuple[Occupancy, ...]


def _frame(matrix: Matrix | Callable[[Size], Matrix] | None, size: Size | None) -> Frame:
    if (matrix is None) != (size is None):
        raise ValueError("A network frame needs both matrix and size: give both or none.")
    return Frame(matrix, size)


def _require_samples(dataset: Dataset) -> None:
    if len(dataset) == 0:
        raise ValueError("The dataset has no samples: check the root and the label files.")


def _size_of(sample: Sample) -> Size:
    if isinstance(sample.image, Path):
        return image_size(sample.image)
    return sample.image.shape[0], sample.image.shape[1]


def _look(sample: Sample) -> tuple[_Look, Polylines]:
    """Gives what there is to know of a sample; its pixels are let go."""
    file = sample.image if isinstance(sample.image, Path) else None
    size, findings = None, []
    try:
        size = _size_of(sample)
    except FileNotFoundError:
        findings.append(Finding("missing image", sample.name, str(sample.image)))
    except ValueError as error:
        findings.append(Finding("unreadable image", sample.name, str(error)))
    if size is not None and sample.size is not None and size != tuple(sample.size):
        findings.append(Finding("wrong size", sample.name, f"{size}, its labels state {sample.size}"))
    return _Look(sample.name, file, size, sample.size, findings), sample.polylines


def _examine(
    group: Sequence[tuple[_Look, Polylines]],
    dataset: Dataset,
    frame: Frame,
    strides: Sequence[int],
    predictors: int,
) -> _Part:
    """Gives what some samples add to the report."""
    looks = [look for look, _ in group]
    names, sizes = [one.name for one in looks], [one.size or one.stated for one in looks]
    batch = Batch.of(names, sizes, [lines for _, lines in group])
    findings = [list(one.findings) for one in looks]
    for i, finding in polyline_findings(batch, len(dataset.classes), directed=dataset.directed):
        findings[i].append(finding)
    counted = occupancy(batch, frame, strides, predictors)
    labels = Counter(batch.lines.labels.tolist())
    return _Part(looks, findings, labels, len(batch.lines.vertices), counted)


def _findings(parts: Sequence[_Part], sizes: Counter[Size]) -> Iterator[Finding]:
    """Yields the findings of all samples, with those that only show beside the other samples."""
    names: set[str] = set()
    usual = sizes.most_common(1)[0][0] if sizes else None
    for part in parts:
        for one, findings in zip(part.looks, part.findings, strict=True):
            if one.name in names:
                yield Finding("duplicate name", one.name, "")
            names.add(one.name)
            if one.size not in (None, usual):
                yield Finding("other size", one.name, f"{one.size}, most have {usual}")
            yield from findings


def _deviations(polylines: Polylines, grid: Grid) -> tuple[float, float, int, int]:
    """Gives the deviation with ends on the border and with loose ends, segments and lost polylines."""
    border = discretize(polylines, grid, border=True)
    points = discretize(polylines, grid, border=False)
    lost = len(polylines) - len(np.unique(border.owners))
    return (
        deviation(polylines, cells_to_pixels(border, grid)),
        deviation(polylines, cells_to_pixels(points, grid)),
        len(border),
        lost,
    )


def _average(stride: int, found: Sequence[tuple[float, float, int, int]]) -> DeviationRow:
    """Gives the row of one stride; samples that lost every polyline are infinitely far and do not count."""
    values = np.array(found, np.float64).reshape(-1, 4)
    border, points = (column[np.isfinite(column)] for column in (values[:, 0], values[:, 1]))
    if len(border) < len(values):
        _log.warning("%d samples have no segment at all at stride %d.", len(values) - len(border), stride)
    return DeviationRow(
        stride,
        float(border.mean()) if len(border) else float("nan"),
        float(points.mean()) if len(points) else float("nan"),
        int(values[:, 2].sum()),
        int(values[:, 3].sum()),
    )


__all__ = ["check", "deviation_table"]
