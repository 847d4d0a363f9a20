"""What is wrong with a dataset, how full its cells are, and the error that cells cause (paper, Tab. 6)."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from yolino.datasets.dataset import Dataset
from yolino.datasets.report import DeviationRow, Finding, Occupancy, Report, Size
from yolino.geometry import clip_polylines, transform_points
from yolino.grid import Grid, cells_to_pixels, deviation, discretize, surplus
from yolino.io import image_size
from yolino.types import Polylines, Sample

_log = logging.getLogger(__name__)

Matrix = Float[np.ndarray, "3 3"]
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
    """Gives what is wrong with a dataset. Images are not decoded, only their size is read.

    Args:
        dataset: The dataset; one that does not insist on its images is examined to its end.
        strides: Sides of the cells, in pixels of the network frame.
        predictors: Predictors per cell that the cells are compared with.
        matrix: From the image frame to the network frame, or what gives it for an image size; None: they are
            the same.
        size: `(height, width)` of the network frame; None: the image, filled up to whole cells.
        progress: Wraps the indices that are looped over, to show a progress bar.

    Raises:
        ValueError: The dataset is empty, or only one of `matrix` and `size` is given.
    """
    _require_samples(dataset, matrix, size)
    examined = [_examine(dataset[i], dataset) for i in progress(range(len(dataset)))]
    sizes = Counter(e.size for e in examined if e.size is not None)
    usual = sizes.most_common(1)[0][0] if sizes else None
    labels = np.concatenate([e.labels for e in examined])
    return Report(
        samples=len(examined),
        polylines=len(labels),
        vertices=sum(e.vertices for e in examined),
        sizes=dict(sizes.most_common()),
        class_counts={name: int((labels == i).sum()) for i, name in enumerate(dataset.classes)},
        findings=tuple(_findings(examined, usual)),
        occupancy=tuple(_occupancy(examined, stride, predictors, matrix, size) for stride in strides),
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
    _require_samples(dataset, matrix, size)
    rows: list[list[tuple[float, float, int, int]]] = [[] for _ in strides]
    for i in progress(range(len(dataset))):
        sample = dataset[i]
        image = _size_of(sample)
        for stride, row in zip(strides, rows, strict=True):
            polylines, grid = _in_frame(sample.polylines, image, stride, matrix, size)
            if len(polylines):
                row.append(_deviations(polylines, grid))
    return tuple(_average(stride, row) for stride, row in zip(strides, rows, strict=True))


@dataclass(frozen=True)
class _Examined:
    name: str
    size: Size | None
    usable: Polylines
    labels: NDArray[np.int64]
    vertices: int
    findings: list[Finding]


def _require_samples(dataset: Dataset, matrix: object, size: Size | None) -> None:
    if len(dataset) == 0:
        raise ValueError("The dataset has no samples: check the root and the label files.")
    if (matrix is None) != (size is None):
        raise ValueError("A network frame needs both matrix and size: give both or none.")


def _size_of(sample: Sample) -> Size:
    if isinstance(sample.image, Path):
        return image_size(sample.image)
    return sample.image.shape[0], sample.image.shape[1]


def _examine(sample: Sample, dataset: Dataset) -> _Examined:
    """Gives what one sample adds to the report."""
    findings: list[Finding] = []
    size = None
    try:
        size = _size_of(sample)
    except FileNotFoundError:
        findings.append(Finding("missing image", sample.name, str(sample.image)))
    except ValueError as error:
        findings.append(Finding("unreadable image", sample.name, str(error)))
    lines = sample.polylines
    finite = np.array([bool(np.isfinite(line).all()) for line in lines], np.bool_)
    findings += _polyline_findings(sample, finite, size, len(dataset.classes))
    return _Examined(sample.name, size, lines[finite], lines.labels, len(lines.vertices), findings)


def _polyline_findings(
    sample: Sample, finite: NDArray[np.bool_], size: Size | None, classes: int
) -> Iterator[Finding]:
    """Yields what is wrong with the polylines of one sample."""
    seen: dict[bytes, int] = {}
    for i, line in enumerate(sample.polylines):
        where = f"polyline {i}"
        label = int(sample.polylines.labels[i])
        if not 0 <= label < max(classes, 1):
            yield Finding("unknown label", sample.name, f"{where} has label {label} of {classes} classes")
        if len(line) < 2:
            yield Finding("one vertex", sample.name, f"{where} has {len(line)}")
        if not finite[i]:
            yield Finding("not finite", sample.name, where)
            continue
        if len(line) > 1 and not np.ptp(line, axis=0).any():
            yield Finding("zero length", sample.name, f"{where} at {line[0].tolist()}")
        earlier = seen.setdefault(line.tobytes(), i)
        if earlier != i:
            yield Finding("duplicate polyline", sample.name, f"{where} is polyline {earlier}")
        if size is not None and len(line):
            yield from _outside(line, size, sample.name, where)


def _outside(line: Float[np.ndarray, "v 2"], size: Size, name: str, where: str) -> Iterator[Finding]:
    beyond = ((line < 0) | (line > (size[1], size[0]))).any(axis=1)
    if not beyond.any():
        return
    if beyond.all() and len(clip_polylines(Polylines.from_list([line]), size)) == 0:
        yield Finding("outside", name, where)
    else:
        yield Finding("partly outside", name, f"{where}: {int(beyond.sum())} of {len(line)} vertices")


def _findings(examined: Sequence[_Examined], usual: Size | None) -> Iterator[Finding]:
    """Yields the findings of all samples, with those that only show beside the other samples."""
    names: set[str] = set()
    for one in examined:
        if one.name in names:
            yield Finding("duplicate name", one.name, "")
        names.add(one.name)
        if one.size not in (None, usual):
            yield Finding("other size", one.name, f"{one.size}, most have {usual}")
        yield from one.findings


def _in_frame(
    polylines: Polylines,
    image: Size,
    stride: int,
    matrix: Matrix | Callable[[Size], Matrix] | None,
    size: Size | None,
) -> tuple[Polylines, Grid]:
    """Gives the polylines in the network frame, cut off at its border, and its grid."""
    if matrix is None or size is None:
        filled = (-(-image[0] // stride) * stride, -(-image[1] // stride) * stride)
        return clip_polylines(polylines, image), Grid(filled, stride)
    matrix = matrix(image) if callable(matrix) else matrix
    moved = polylines.with_vertices(transform_points(polylines.vertices, matrix))
    return clip_polylines(moved, size), Grid(size, stride)


def _occupancy(
    examined: Sequence[_Examined],
    stride: int,
    predictors: int,
    matrix: Matrix | Callable[[Size], Matrix] | None,
    size: Size | None,
) -> Occupancy:
    segments = filled = fullest = left = 0
    for one in examined:
        if one.size is not None:
            polylines, grid = _in_frame(one.usable, one.size, stride, matrix, size)
            found = discretize(polylines, grid, border=False)
            counts = np.unique(found.cells, axis=0, return_counts=True)[1]
            segments += len(found)
            filled += len(counts)
            fullest = max(fullest, int(counts.max(initial=0)))
            left += surplus(found, grid, predictors)
    return Occupancy(stride, predictors, segments, filled, fullest, left)


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
