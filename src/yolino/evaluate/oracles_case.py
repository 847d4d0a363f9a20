"""One image as the oracles see it: what each step of a model made of it, and what would have been right."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from yolino.evaluate.run import point_radius
from yolino.grid import Grid, cells_to_pixels, discretize
from yolino.header import Header
from yolino.inference import Predictor, Stages
from yolino.inference.postprocessing import Linker, Suppressor
from yolino.postprocess.mapping import map_polylines
from yolino.postprocess.spline import SmoothingSpline
from yolino.types import Polylines, Sample, Segments

ANGLE_RADIUS = math.pi / 4
_TO_BORDER = ("1d", "eu")  # representations whose segments run from border to border of a cell
_SMOOTHING = 0.05  # squared cells: the linkers' default


@dataclass(frozen=True, eq=False)
class Case:
    """One image as the oracles see it, in pixels of the network's input unless said otherwise.

    Attributes:
        stages: What the model's own steps made of the image.
        unsure: Segments of the network with a score below the threshold.
        truth: The labels.
        chords: The true segments: the labels cut into cells, as the network is trained to see them.
        owners: Label that each chord was cut from, an index of `truth`.
        grid: The cells.
        radius: How far from a label a point still counts as found, that of the point metric.
        directed: Whether the opposite direction is another line.
        nms: The model's.
        linker: The model's.
        smooth: Makes the same curves of points in cell units as the model's linker.
        matrix: From these pixels to those of the image.
        labels: The labels in pixels of the image, as they were read.
        size: `(height, width)` of the image.
    """

    stages: Stages
    unsure: Segments
    truth: Polylines
    chords: Segments
    owners: Int[np.ndarray, " n"]
    grid: Grid
    radius: float
    directed: bool
    nms: Suppressor
    linker: Linker
    smooth: SmoothingSpline
    matrix: Float[np.ndarray, "3 3"]
    labels: Polylines
    size: tuple[int, int]


def see_everything(predictor: Predictor) -> Predictor:
    """Gives the same model without its threshold, so that its unsure segments can be looked at, too."""
    return Predictor(
        predictor.engine,
        predictor.header,
        threshold=0.0,
        nms=predictor.nms,
        linker=predictor.linker,
        overlap=predictor.overlap,
    )


def make_case(
    everything: Predictor,
    sample: Sample,
    image: np.ndarray,
    *,
    threshold: float,
    renamed: Int[np.ndarray, " c"] | None = None,
    directed: bool = True,
    slack: float = 0.0,
) -> Case:
    """Runs a model on an image and gives all that the oracles need.

    Args:
        everything: The model without its threshold, see `see_everything`.
        sample: The image's labels.
        image: Its pixels.
        threshold: The model's own.
        renamed: The model's label for each label of the dataset; None if their classes differ.
        directed: Whether the directions of the labels mean something.
        slack: By how many pixels of the image both ends of a label go on. Labels that are columns at rows
            end exactly at a row, and whether a curve still meets it must not depend on rounding.

    Raises:
        ValueError: The image is damaged.
    """
    header, size = everything.header, (image.shape[0], image.shape[1])
    found, matrix = everything.detect(image)
    sure = found.scores >= threshold
    candidates = found[sure]
    merged = everything.nms(candidates)
    stages = Stages(candidates, merged, everything.linker(merged))
    truth = map_polylines(_labels(sample.polylines, renamed, slack), np.linalg.inv(matrix))
    grid = _grid(header, size)
    cells = discretize(truth, grid, border=header.representation in _TO_BORDER)
    options = header.postprocess.get("linker_options", {})
    return Case(
        stages=stages,
        unsure=found[~sure],
        truth=truth,
        chords=cells_to_pixels(cells, grid),
        owners=cells.owners,
        grid=grid,
        radius=_radius(header, size, matrix),
        directed=directed and header.directed,
        nms=everything.nms,
        linker=everything.linker,
        smooth=SmoothingSpline(float(options.get("smoothing", _SMOOTHING))),
        matrix=matrix,
        labels=sample.polylines,
        size=size,
    )


def _grid(header: Header, size: tuple[int, int]) -> Grid:
    """Gives the cells of the network's input, or of a whole scene that it goes over in windows."""
    if header.fit != "window":
        return Grid(header.size, header.stride)
    height, width = (math.ceil(max(side * header.scale, 1) / header.stride) * header.stride for side in size)
    return Grid((height, width), header.stride)


def _radius(header: Header, size: tuple[int, int], matrix: Float[np.ndarray, "3 3"]) -> float:
    """Gives the radius of the point metric in the network's pixels."""
    given = point_radius(header)
    scale = math.sqrt(abs(float(np.linalg.det(matrix[:2, :2]))))
    return (size[1] / 50 if given is None else given) / scale


def _labels(polylines: Polylines, renamed: Int[np.ndarray, " c"] | None, slack: float) -> Polylines:
    """Gives the labels with the model's classes and longer by the slack at both ends."""
    kinds = np.zeros(len(polylines), np.int64) if renamed is None else renamed[polylines.labels]
    return Polylines.from_list([_longer(vertices, slack) for vertices in polylines], labels=kinds)


def _longer(vertices: Float[np.ndarray, "v 2"], slack: float) -> Float[np.ndarray, "v 2"]:
    longer = vertices.copy()
    for end, before in ((0, 1), (-1, -2)):
        if slack == 0 or len(vertices) < 2:
            break
        out = vertices[end] - vertices[before]
        length = float(np.hypot(out[0], out[1]))
        if length > 0:
            longer[end] += out * (slack / length)
    return longer


__all__ = ["ANGLE_RADIUS", "Case", "make_case", "see_everything"]
