"""What the pictures of `yolino predict` show: a function for each `--view`.

Tiny images are enlarged by a whole factor, for lines and keys to be told apart.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int, UInt8

from yolino.geometry import transform_points
from yolino.grid import Grid
from yolino.inference import Predictor, Stages
from yolino.inference.flips import mirror_segments, with_mirrors
from yolino.inference.rotations import join_views
from yolino.inference.views import ImageRaster, view
from yolino.inference.windows import STRIDE, owned_predictors
from yolino.types import Output, Polylines, Segments
from yolino.viz import (
    cell_edge,
    draw_cells,
    draw_legend,
    draw_polylines,
    draw_scale,
    draw_segments,
    draw_stages,
    draw_wheel,
    enlarge,
    readable_zoom,
    tiny_zoom,
)

Image = UInt8[np.ndarray, "h w 3"]
Matrix = Float[np.ndarray, "3 3"]
Picture = UInt8[np.ndarray, "ph pw 3"]
View = Callable[[Image, Stages, Predictor], Picture]
FEW_CLASSES = 12  # of which the legend names those, too, that the image does not show


def draw_lines_view(image: Image, stages: Stages, predictor: Predictor) -> Picture:
    """Gives the polylines, each in its color; where the model knows several classes, in those, with names."""
    header = predictor.header
    image, lines = _readable(image, stages.polylines)
    if len(header.classes) < 2:
        return draw_polylines(image, lines, directed=header.directed)
    drawn = draw_polylines(image, lines, color_by="label", directed=header.directed)
    return draw_legend(drawn, header.classes, labels=lines.labels) if len(lines) else drawn


def draw_orientation_view(image: Image, stages: Stages, predictor: Predictor) -> Picture:
    """Gives the polylines with their direction as a hue, and the wheel of directions."""
    directed = predictor.header.directed
    image, lines = _readable(image, stages.polylines)
    drawn = draw_polylines(image, lines, color_by="direction", directed=directed)
    return draw_wheel(drawn, directed=directed)


def draw_identity_view(image: Image, stages: Stages, predictor: Predictor) -> Picture:
    """Gives the polylines, each in its color, with dots where several meet."""
    image, lines = _readable(image, stages.polylines)
    return draw_polylines(image, lines, directed=predictor.header.directed, junctions=True)


def draw_classes_view(image: Image, stages: Stages, predictor: Predictor) -> Picture:
    """Gives the polylines in the colors of their classes, and the names; of many only those that occur."""
    header, labels = predictor.header, stages.polylines.labels
    image, lines = _readable(image, stages.polylines)
    drawn = draw_polylines(image, lines, color_by="label", directed=header.directed)
    if not header.classes:
        return drawn
    return draw_legend(drawn, header.classes, labels=None if len(header.classes) <= FEW_CLASSES else labels)


def draw_score_view(image: Image, stages: Stages, predictor: Predictor) -> Picture:
    """Gives the polylines in the colors of their scores, and the scale."""
    image, lines = _readable(image, stages.polylines)
    return draw_scale(draw_polylines(image, lines, color_by="score", directed=predictor.header.directed))


def draw_cells_view(image: Image, stages: Stages, predictor: Predictor) -> Picture:
    """Gives the cells, and the segments above the threshold in the colors of their predictors.

    A small image is enlarged until its cells can be read.
    """
    header = predictor.header
    every, predictors, matrix = _candidates(predictor, image)
    kept = every.scores >= np.float32(predictor.threshold)
    grid = Grid(_extent(predictor, image), header.stride)
    drawn = draw_cells(
        image,
        every[kept],
        grid,
        predictors=predictors[kept],
        matrix=matrix,
        directed=header.directed,
        zoom=readable_zoom((image.shape[0], image.shape[1]), cell_edge(grid, matrix)),
    )
    return draw_legend(drawn, [f"predictor {i}" for i in range(header.predictors)])


def draw_segments_view(image: Image, stages: Stages, predictor: Predictor) -> Picture:
    """Gives the segments after the NMS with their direction as a hue, and the wheel of directions."""
    directed = predictor.header.directed
    zoom = tiny_zoom((image.shape[0], image.shape[1]))
    segments = stages.segments.with_endpoints(stages.segments.endpoints * zoom)
    return draw_wheel(draw_segments(enlarge(image, zoom), segments, directed=directed), directed=directed)


def draw_stages_view(image: Image, stages: Stages, predictor: Predictor) -> Picture:
    """Gives candidates, segments above the threshold, after the NMS, and polylines side by side."""
    every, _, _ = _candidates(predictor, image)
    color_by = "label" if len(predictor.header.classes) > 1 else "identity"
    directed = predictor.header.directed
    return draw_stages(image, every, *stages, directed=directed, color_by=color_by)


VIEWS: dict[str, View] = {
    "lines": draw_lines_view,
    "orientation": draw_orientation_view,
    "identity": draw_identity_view,
    "classes": draw_classes_view,
    "score": draw_score_view,
    "cells": draw_cells_view,
    "segments": draw_segments_view,
    "stages": draw_stages_view,
}
"""The views by their names on the command line."""


def find_view(name: str) -> View:
    """Gives the view of that name.

    Raises:
        ValueError: There is none.
    """
    if name not in VIEWS:
        raise ValueError(f"The view {name!r} is unknown; use one of {', '.join(VIEWS)}.")
    return VIEWS[name]


def _readable(image: Image, polylines: Polylines) -> tuple[Picture, Polylines]:
    """Gives the image, enlarged if it is tiny, and the polylines in its pixels."""
    zoom = tiny_zoom((image.shape[0], image.shape[1]))
    return enlarge(image, zoom), polylines.with_vertices(polylines.vertices * zoom)


def _candidates(predictor: Predictor, image: Image) -> tuple[Segments, Int[np.ndarray, " n"], Matrix]:
    """Gives all that the network says, from another run of it, in pixels of the image.

    Returns:
        The segments, the index of each one's predictor in its cell, and the matrix from pixels of the network
        to those of the image.
    """
    header = predictor.header
    if header.fit != "window":
        pixels, matrix = predictor.preprocess(image)
        output = predictor.engine(with_mirrors(pixels[None]) if predictor.flip else pixels[None])
        found = join_views(
            [
                _segments(output, i) if i == 0 else mirror_segments(_segments(output, i), header.size[1])
                for i in range(len(output.scores))
            ]
        )
        numbers = np.arange(len(found)) % header.predictors  # a mirror image has whole cells, too
        return found.with_endpoints(transform_points(found.endpoints, matrix)), numbers, matrix
    raster, parts, numbers_of = ImageRaster(image), [], []
    for window in predictor.plan(raster.size):
        pixels = view(raster, window, header.size, header.scale).rgb
        owned = owned_predictors(window, header)
        part = _segments(predictor.engine(pixels[None]), 0)[owned]
        parts.append(part.with_endpoints(part.endpoints + np.array([window.left, window.top], np.float64)))
        numbers_of.append(np.flatnonzero(owned) % header.predictors)
    endpoints = np.concatenate([part.endpoints for part in parts]) / header.scale
    found = Segments(endpoints, np.concatenate([part.scores for part in parts]))
    return found, np.concatenate(numbers_of), np.diag([1 / header.scale, 1 / header.scale, 1.0])


def _segments(output: Output, index: int) -> Segments:
    return Segments(output.endpoints[index], output.scores[index])


def _extent(predictor: Predictor, image: Image) -> tuple[int, int]:
    """Gives the size of all cells together in pixels of the network."""
    if predictor.header.fit != "window":
        return predictor.header.size
    plan = predictor.plan((image.shape[0], image.shape[1]))
    height, width = (-(-edge // STRIDE) * STRIDE for edge in plan.extent)
    return height, width


__all__ = ["VIEWS", "View", "find_view"]
