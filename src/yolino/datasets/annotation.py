"""What a label file says about one image, before names become indices and files become images."""

from __future__ import annotations

import codecs
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

_LARGEST = 1.7e308


class LabelError(ValueError):
    """A label file, or a part of one, that cannot be read.

    Args:
        where: The file, and the place in it: `labels.json, line 3`.
        reason: What is wrong with it and what is needed, to be read after `where`, without a full stop:
            `has no points, but at least two are needed`.
    """

    def __init__(self, where: str, reason: str) -> None:
        super().__init__(f"{where} {reason}.")
        self.where, self.reason = where, reason


@dataclass(frozen=True, eq=False)
class Annotation:
    """The labels of one image as its file states them.

    Attributes:
        image: The image file as the label file names it, with forward slashes.
        where: The label file, and the place in it, for messages.
        lines: The vertices of each polyline, `(x, y)` in pixels of the image.
        names: Class name of each polyline.
        scores: Score of each polyline; empty: all are 1.
        ignore: Polygons in pixels inside which nothing is labelled.
        size: `(height, width)` of the image, where the file states it.
        source: The label file; `FileDataset` fills it in.
    """

    image: str
    where: str
    lines: Sequence[Float[np.ndarray, "_ 2"]] = ()
    names: Sequence[str] = ()
    scores: Sequence[float] = ()
    ignore: Sequence[Float[np.ndarray, "_ 2"]] = field(default=())
    size: tuple[int, int] | None = None
    source: Path = Path()


def parse_json(data: bytes, where: str) -> Any:
    """Gives what a JSON text in UTF-8 holds; a byte order mark is fine.

    Raises:
        LabelError: It is no such text; the place is named.
    """
    try:
        return json.loads(data.removeprefix(codecs.BOM_UTF8))
    except (ValueError, RecursionError) as error:
        reason = str(error) if isinstance(error, json.JSONDecodeError) else type(error).__name__
        raise LabelError(where, f"is not valid JSON ({reason})") from None


def check_points(points: object, where: str, *, least: int = 1) -> Float[np.ndarray, "v 2"]:
    """Gives a list of `[x, y, ...]` as an array of vertices; further coordinates (a height) are left out.

    Raises:
        LabelError: It is no list of points, has too few, or a coordinate is no finite number.
    """
    if not isinstance(points, list | tuple) or len(points) < least:
        given = f"{len(points)} points" if isinstance(points, list | tuple) else type(points).__name__
        raise LabelError(where, f"has {given}, but at least {least} points [x, y] are needed")
    for point in points:
        if not isinstance(point, list | tuple) or len(point) < 2:
            raise LabelError(where, f"has the point {point!r}, but [x, y] is needed")
        for value in point[:2]:
            if type(value) not in (int, float) or not abs(value) <= _LARGEST:
                raise LabelError(where, f"has the coordinate {value!r}, but finite numbers are needed")
    return np.array([point[:2] for point in points], np.float64).reshape(-1, 2)


__all__ = ["Annotation", "LabelError", "check_points", "parse_json"]
