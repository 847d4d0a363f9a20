"""What is drawn on one image in Label Studio: the results of an annotation as polylines and regions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from yolino.datasets.annotation import LabelError
from yolino.datasets.labelstudio_paths import path_to_polylines, to_pixels

_LINES = ("polyline", "polylinelabels")
_POLYGONS = ("polygon", "polygonlabels")


@dataclass
class Shapes:
    """The shapes on one image.

    Attributes:
        lines: Vertices of each polyline, in pixels.
        names: Class name of each polyline.
        scores: Score of each polyline.
        ignore: Regions where nothing is labelled, in pixels.
        size: `(height, width)` of the image; None where nothing states it.
    """

    lines: list[Float[np.ndarray, "_ 2"]] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    scores: list[float] = field(default_factory=list)
    ignore: list[Float[np.ndarray, "_ 2"]] = field(default_factory=list)
    size: tuple[int, int] | None = None


def read_shapes(
    results: Sequence[object],
    where: str,
    *,
    size: tuple[int, int] | None,
    ignore: Sequence[str],
    default: str,
) -> Shapes:
    """Gives the polylines and regions among the results of an annotation.

    Args:
        results: The results.
        where: The file, and the place in it, for messages.
        size: Size of the image where the results do not state it.
        ignore: Labels whose closed shapes are regions where nothing is labelled.
        default: Class name of polylines without a label.

    Raises:
        LabelError: A result is broken.
    """
    shapes, stated = Shapes(size=size), None
    for place, result, label in _drawn(results, where):
        value, kind = result["value"], result.get("type")
        is_region = label in ignore and (kind in _POLYGONS or value.get("closed") is True)
        if not is_region and kind in _POLYGONS:
            continue
        shapes.size = _size(result, size, place)
        if stated not in (None, shapes.size):
            raise LabelError(place, f"states the size {shapes.size}, but another result states {stated}")
        stated = shapes.size
        is_path = "vertices" in value
        convert = path_to_polylines if is_path else _points_to_polylines
        found = convert(value, shapes.size, place)
        if is_region:
            # The last point of a closed path is its first.
            shapes.ignore += [line[: -1 if is_path else None] for line in found]
        else:
            shapes.lines += found
            shapes.names += [default if label is None else label] * len(found)
            shapes.scores += [_score(result, place)] * len(found)
    return shapes


def _drawn(results: Sequence[object], where: str) -> Iterator[tuple[str, Mapping[str, Any], str | None]]:
    """Yields each line, path and polygon once: its place, its result and its label."""
    drawn: dict[str, tuple[str, Mapping[str, Any]]] = {}
    labels: dict[str, str] = {}
    for number, result in enumerate(results, 1):
        place = f"{where}, result {number}"
        if not isinstance(result, Mapping):
            raise LabelError(place, f"is a {type(result).__name__}, but a JSON object is needed")
        value, kind = result.get("value"), result.get("type")
        if not isinstance(value, Mapping) or not isinstance(kind, str):
            continue
        # A tool without labels gives two results with one id: what is drawn, and the label that was chosen.
        key = str(result.get("id", number))
        if "vertices" in value or kind in (*_LINES, *_POLYGONS):
            drawn.setdefault(key, (place, result))
        if kind.endswith("labels") and value.get(kind):
            labels[key] = _label(value[kind], place)
    for key, (place, result) in drawn.items():
        yield place, result, labels.get(key)


def _label(labels: object, where: str) -> str:
    if not isinstance(labels, list) or len(labels) != 1 or not isinstance(labels[0], str):
        raise LabelError(where, f"has the labels {str(labels)[:80]}, but a list of one name is needed")
    return labels[0]


def _points_to_polylines(
    value: Mapping[str, Any], size: tuple[int, int], where: str
) -> list[Float[np.ndarray, "_ 2"]]:
    return [to_pixels(value.get("points"), size, where)]


def _size(result: Mapping[str, Any], size: tuple[int, int] | None, where: str) -> tuple[int, int]:
    """Gives the size that a result states, or else `size`."""
    if result.get("image_rotation"):
        reason = f"was drawn on the image rotated by {result['image_rotation']!r} degrees"
        raise LabelError(where, f"{reason}, but it is needed as its file has it: rotate it back")
    height, width = result.get("original_height"), result.get("original_width")
    if height is None and width is None and size is not None:
        return size
    if type(height) is not int or type(width) is not int or min(height, width) < 1:
        given = f"original_height {height!r} and original_width {width!r}"
        raise LabelError(
            where, f"has {given}, but whole numbers are needed, of which coordinates are percents"
        )
    return height, width


def _score(result: Mapping[str, Any], where: str) -> float:
    score = result.get("score")
    if score is None:
        return 1.0
    if type(score) not in (int, float) or not abs(score) < float("inf"):
        raise LabelError(where, f"has the score {score!r}, but a finite number is needed")
    return float(score)


__all__ = ["Shapes", "read_shapes"]
