"""Samples to masks: a folder of class masks, and a file that says what their values mean."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, Int32

from yolino.datasets.annotation import LabelError
from yolino.datasets.writing import ImageWriter, without_suffix
from yolino.geometry import clip_polylines
from yolino.io import write_atomic
from yolino.types import Sample

FOLDER = "masks"
"""Name of the folder of the masks."""
_VALUES = "values.json"
_IGNORED = 255
# Parts of a pixel that OpenCV's drawing knows: 2^-4.
_SHIFT = 4


class MasksWriter(ImageWriter):
    """Writes a class mask for each image, `masks/<name>.png`, and what its values mean, `masks/values.json`.

    A polyline of the label i is drawn with the value i + 1, regions to ignore with 255.

    Args:
        out: The folder.
        classes: Names of the classes, at most 254.
        directed: Not written.
        width: Width of the lines in pixels.

    Raises:
        ValueError: There are too many classes, or the width is not positive.
    """

    loses = ("directions", "exact vertices", "order", "scores")

    def __init__(
        self, out: Path, *, classes: Sequence[str] = (), directed: bool = True, width: int = 1
    ) -> None:
        super().__init__(out, classes=classes, directed=directed)
        if len(self.classes) >= _IGNORED:
            raise ValueError(f"A mask holds at most {_IGNORED - 1} classes, but there are {len(classes)}.")
        if width < 1:
            raise ValueError(f"The width of the lines is {width}, but at least 1 pixel is needed.")
        self._pen = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (width, width))

    def add(self, sample: Sample) -> None:
        """Writes the mask of one image; what lies outside the image is left out."""
        if sample.size is None:
            raise ValueError(f"The size of {sample.name} is unknown: its mask needs it, so give its image.")
        if not all(np.isfinite(v).all() for v in (sample.polylines.vertices, *sample.ignore)):
            raise ValueError(f"{sample.name} has a vertex that is not finite: remove it.")
        mask = np.zeros(sample.size, np.uint8)
        for polygon in sample.ignore:
            cv2.fillPoly(mask, [_to_drawing(np.clip(polygon, -1e5, 1e5))], _IGNORED, shift=_SHIFT)
        lines = clip_polylines(sample.polylines, sample.size)
        values = lines.labels + 1 if self.classes else np.ones(len(lines), np.int64)
        for value in np.unique(values).tolist():
            drawing = np.zeros(sample.size, np.uint8)
            for vertices in lines[values == value]:
                cv2.polylines(drawing, [_to_drawing(vertices)], False, 1, 1, cv2.LINE_8, _SHIFT)
            # OpenCV's thick lines are up to two pixels too wide.
            mask[cv2.dilate(drawing, self._pen) > 0] = value
        data = cv2.imencode(".png", mask)[1].tobytes()
        self.write(sample, f"{FOLDER}/{without_suffix(sample.name)}.png", data)

    def close(self) -> None:
        """Writes what the values mean."""
        names = {str(i + 1): name for i, name in enumerate(self.classes or (self.name_of(0),))}
        meaning = {"values": names, "ignore_value": _IGNORED}
        write_atomic(self.out / FOLDER / _VALUES, json.dumps(meaning, ensure_ascii=False, indent=1) + "\n")


def read_meaning(root: Path) -> tuple[dict[int, str] | None, int | None]:
    """Gives the names of the values and the value to ignore as `MasksWriter` wrote them; None: it did not.

    Raises:
        LabelError: The file does not have that form.
    """
    path = root / FOLDER / _VALUES
    if not path.is_file():
        return None, None
    try:
        meaning = json.loads(path.read_text(encoding="utf-8"))
    except ValueError:
        raise LabelError(str(path), "is not valid JSON, but one object is needed") from None
    ignored = meaning.get("ignore_value") if isinstance(meaning, dict) else None
    if not isinstance(meaning, dict) or not isinstance(ignored, int | None):
        raise LabelError(str(path), 'is not of the form {"values": {"1": "crack"}, "ignore_value": 255}')
    return check_meaning(meaning.get("values"), f"{path}, values"), ignored


def check_meaning(values: object, where: str) -> dict[int, str]:
    """Gives the names of the values by whole numbers.

    Raises:
        LabelError: There is no value, one is no positive whole number, or one has no name.
    """
    if not isinstance(values, Mapping) or not values:
        raise LabelError(where, "must name the values of the masks: {1: crack, 2: joint}")
    for value, name in values.items():
        if not str(value).isdecimal() or int(value) == 0 or not isinstance(name, str):
            raise LabelError(
                where, f"has {value!r}: {name!r}, but positive whole numbers with names are needed"
            )
    return {int(value): name for value, name in values.items()}


def _to_drawing(vertices: Float[np.ndarray, "v 2"]) -> Int32[np.ndarray, "v 2"]:
    """Gives vertices in the whole numbers of OpenCV's drawing, where pixel centers are whole."""
    drawn: Int32[np.ndarray, "v 2"] = np.round((np.asarray(vertices, np.float64) - 0.5) * 2**_SHIFT).astype(
        np.int32
    )
    return drawn


__all__ = ["FOLDER", "MasksWriter", "check_meaning", "read_meaning"]
