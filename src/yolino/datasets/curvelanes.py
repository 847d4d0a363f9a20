"""The CurveLanes benchmark: lists that name the images, and a JSON file of lanes for each of them.

`train/train.txt` has an image per line (`images/ab12.jpg`), and `train/labels/ab12.lines.json` its lanes:
`{"Lines": [[{"y": "1439.0", "x": "2079.41"}, ...], ...]}`, from the lower end to the upper one, which is
kept. The coordinates are strings (numbers are read too), count pixels and may lie outside the image.
(https://github.com/SoulmateB/CurveLanes)
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from yolino.datasets.annotation import LabelError, parse_json
from yolino.datasets.lists import ListedDataset, pixel_numbers
from yolino.datasets.writing import ImageWriter, without_suffix
from yolino.types import Sample


class CurveLanesWriter(ImageWriter):
    """Writes a file for each image: into the folder `labels` beside the folder `images`.

    The labels of an image that is in no folder `images` are written beside it.
    """

    loses = ("classes", "ignored regions", "scores", "sizes")

    def add(self, sample: Sample) -> None:
        """Writes the lanes of one image."""
        self.check(sample)
        lanes = [
            [{"y": repr(y), "x": repr(x)} for x, y in pixel_numbers(line).tolist()]
            for line in sample.polylines
        ]
        self.write(sample, CurveLanes.label_name(sample.name), json.dumps({"Lines": lanes}) + "\n")


class CurveLanes(ListedDataset):
    """Frames and lane markings of the CurveLanes benchmark, in the layout that it publishes.

    Args:
        root: Folder that holds `train` and `valid`, or one of these.
        labels: Lists, label files or folders of them, absolute or below `root`; None: those of the images in
            `names`, or all `*.lines.json` below `root`.
        options: The other arguments of `FileDataset`; `names="train/train.txt"` is the benchmark's way.
    """

    patterns = ("**/*.lines.json",)
    suffix = ".lines.json"
    writer = CurveLanesWriter

    @staticmethod
    def label_name(image: str) -> str:
        """Gives the name of the label file of an image: in `labels` instead of `images`, or beside it."""
        return _swap(without_suffix(image), "images", "labels") + CurveLanes.suffix

    @staticmethod
    def image_name(label: str) -> str:
        """Gives the name of the image of a label file, without suffix: in `images`, or beside it."""
        return _swap(label.removesuffix(CurveLanes.suffix), "labels", "images")

    @staticmethod
    def read_lines(path: Path) -> list[Float[np.ndarray, "_ 2"]]:
        """Gives the vertices of each lane of a label file, in pixels.

        Raises:
            LabelError: It is no JSON, has no lanes, or a lane has no points or one that is not finite.
            OSError: The file cannot be read.
        """
        document = parse_json(path.read_bytes(), str(path))
        lanes = document.get("Lines") if isinstance(document, dict) else None
        if not isinstance(lanes, list):
            raise LabelError(str(path), 'has no list of lanes, but {"Lines": [...]} is needed')
        return [_lane(lane, f"{path}, lane {i}") for i, lane in enumerate(lanes)]


def _lane(points: Any, where: str) -> Float[np.ndarray, "v 2"]:
    if not isinstance(points, list) or not points:
        raise LabelError(where, 'has no points, but at least one {"x": ..., "y": ...} is needed')
    for point in points:
        if not isinstance(point, dict) or not {"x", "y"} <= point.keys():
            raise LabelError(where, f'has the point {point!r}, but {{"x": ..., "y": ...}} is needed')
    values = [value for point in points for value in (point["x"], point["y"])]
    try:
        # Other types than these, like true, would become numbers.
        known = {*map(type, values)} <= {str, int, float}
        numbers = np.fromiter(map(float, values), np.float64, len(values)) if known else np.array([np.nan])
    except (ValueError, OverflowError):
        numbers = np.array([np.nan])
    if not np.isfinite(numbers).all():
        wrong = next(value for value in values if not _is_finite(value))
        raise LabelError(where, f"has the coordinate {wrong!r}, but finite numbers are needed")
    return numbers.reshape(-1, 2) + 0.5


def _is_finite(value: Any) -> bool:
    try:
        return type(value) in (str, int, float) and bool(np.isfinite(float(value)))
    except (ValueError, OverflowError):
        return False


def _swap(name: str, old: str, new: str) -> str:
    """Gives the name with the last folder `old` called `new`."""
    *folders, file = name.split("/")
    if old in folders:
        folders[len(folders) - 1 - folders[::-1].index(old)] = new
    return "/".join([*folders, file])


__all__ = ["CurveLanes", "CurveLanesWriter"]
