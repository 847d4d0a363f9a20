"""LabelMe: a JSON file per image, in which a person draws shapes.

```
{"version": "5.5.0", "flags": {}, "imagePath": "a.jpg", "imageData": null, "imageHeight": 590,
 "imageWidth": 1640, "shapes": [{"label": "lane", "shape_type": "linestrip", "group_id": null, "flags": {},
  "description": "", "points": [[10.5, 580.0], [22.0, 570.25]]}]}
```

Shapes of the type `linestrip` or `line` are polylines. A `polygon` or `rectangle` whose label is in `ignore`
is a region where nothing is labelled; other shapes are left out. The points are those of LabelMe's canvas: it
draws the image from (0, 0) on, scaled, so they are continuous pixels as they are. `imagePath` starts from the
folder of the JSON file. A number `score`, which LabelMe keeps where it finds it, is the score of a polyline.
(https://github.com/wkentaro/labelme)
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from yolino.datasets.annotation import Annotation, LabelError, check_points, parse_json
from yolino.datasets.files import FileDataset
from yolino.datasets.writing import ImageWriter, without_suffix
from yolino.types import Sample

_LINES = ("linestrip", "line")
_REGIONS = ("polygon", "oriented_rectangle", "rectangle")
_VERSION = "5.5.0"  # of the LabelMe whose files we write


class LabelMeWriter(ImageWriter):
    """Writes a file for each image, beside it, as LabelMe does.

    Args:
        out: The folder.
        classes: Names of the classes; a polyline's label is the index.
        directed: Not written.
        images: Folder of the images, if that is not `out`: LabelMe then finds them there.
    """

    loses = ()

    def __init__(
        self,
        out: Path,
        *,
        classes: Sequence[str] = (),
        directed: bool = True,
        images: str | Path | None = None,
    ) -> None:
        super().__init__(out, classes=classes, directed=directed)
        self._images = out if images is None else Path(images)

    def add(self, sample: Sample) -> None:
        """Writes the shapes of one image."""
        self.check(sample)
        if sample.size is None:
            raise ValueError(f"The size of {sample.name} is unknown: LabelMe's files state it.")
        if not all(np.isfinite(a).all() for a in (sample.polylines.scores, *sample.ignore)):
            raise ValueError(f"{sample.name} has a score or a corner that is not finite: JSON has no such.")
        file = without_suffix(sample.name) + LabelMe.suffix
        image = os.path.relpath(self._images / sample.name.lstrip("/"), (self.out / file).parent)
        document: dict[str, Any] = {
            "version": _VERSION,
            "flags": {},
            "shapes": [*self._lines(sample), *(_shape("ignore", "polygon", p) for p in sample.ignore)],
            "imagePath": Path(image).as_posix(),
            "imageData": None,
            "imageHeight": sample.size[0],
            "imageWidth": sample.size[1],
        }
        self.write(sample, file, json.dumps(document, ensure_ascii=False, allow_nan=False, indent=2) + "\n")

    def _lines(self, sample: Sample) -> Iterator[dict[str, Any]]:
        lines = sample.polylines
        for vertices, score, label in zip(lines, lines.scores.tolist(), lines.labels.tolist(), strict=True):
            shape = _shape(self.name_of(label), "linestrip", vertices)
            yield shape if score == 1 else {**shape, "score": score}


class LabelMe(FileDataset):
    """Images that were labelled in LabelMe.

    Args:
        root: Folder that the names of the images start from.
        labels: Label files, folders of them or globs, absolute or below `root`; None: all `*.json` below
            `root`.
        options: The other arguments of `FileDataset`.
    """

    patterns = ("**/*.json",)
    writer = LabelMeWriter
    suffix = ".json"

    def read(self, path: Path) -> Iterator[Annotation | LabelError]:
        """Yields the shapes of one image.

        Raises:
            LabelError: It is no file of LabelMe, or a shape that is a polyline or a region is broken.
        """
        document = _parse(path)
        lines, names, scores, ignore = [], [], [], []
        for i, shape in enumerate(document["shapes"]):
            where = f"{path}, shape {i}"
            name, kind = _label(shape, where)
            if kind in _LINES:
                lines.append(check_points(shape.get("points"), where))
                names.append(name)
                scores.append(_score(shape, where))
            elif kind in _REGIONS and name in self.ignore:
                ignore.append(_region(shape, kind, where))
        image = self._image_name(path, _image_path(document, path))
        size = _size(document, path)
        yield Annotation(image, str(path), lines, names, scores, ignore, size)

    def _image_name(self, path: Path, given: str) -> str:
        """Gives the image below the root. Files get moved: what `imagePath` says is not always there."""
        if not given:
            return Path(os.path.relpath(path.with_suffix(""), self.root)).as_posix()
        stated = Path(os.path.relpath(os.path.join(path.parent, given), self.root)).as_posix()
        beside = Path(os.path.relpath(path.parent / Path(given).name, self.root)).as_posix()
        folder = self.images or self.root
        places = (stated, given.lstrip("/"), beside)
        return next((place for place in places if (folder / place).is_file()), stated)


def _shape(label: str, kind: str, points: Float[np.ndarray, "v 2"]) -> dict[str, Any]:
    return {
        "label": label,
        "points": points.tolist(),
        "group_id": None,
        "description": "",
        "shape_type": kind,
        "flags": {},
    }


def _parse(path: Path) -> dict[str, Any]:
    document = parse_json(path.read_bytes(), str(path))
    if not isinstance(document, dict) or not isinstance(document.get("shapes"), list):
        raise LabelError(str(path), "has no list of shapes, which a file of LabelMe has")
    return document


def _label(shape: Any, where: str) -> tuple[str, str]:
    """Gives the label and the type of a shape; files of the first versions state no type."""
    if not isinstance(shape, dict):
        raise LabelError(where, f"is {shape!r}, but an object is needed")
    name, kind = shape.get("label"), shape.get("shape_type") or "polygon"
    if not isinstance(name, str) or not isinstance(kind, str):
        raise LabelError(where, f"has the label {name!r} and the shape_type {kind!r}, but names are needed")
    return name, kind


def _score(shape: Mapping[str, Any], where: str) -> float:
    score = shape.get("score")
    if score is None:
        return 1.0
    if type(score) not in (int, float) or not abs(score) < float("inf"):
        raise LabelError(where, f"has the score {score!r}, but a finite number is needed")
    return float(score)


def _region(shape: Mapping[str, Any], kind: str, where: str) -> Float[np.ndarray, "v 2"]:
    """Gives the corners of a shape; LabelMe's rectangles have two of them, those of others have all."""
    corners = check_points(shape.get("points"), where, least=2 if kind == "rectangle" else 3)
    if kind == "rectangle" and len(corners) == 2:
        (left, top), (right, bottom) = corners
        return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
    return corners


def _image_path(document: Mapping[str, Any], path: Path) -> str:
    image = document.get("imagePath") or ""
    if not isinstance(image, str):
        raise LabelError(str(path), f"has imagePath {image!r}, but the name of an image is needed")
    return image.replace("\\", "/")


def _size(document: Mapping[str, Any], path: Path) -> tuple[int, int] | None:
    height, width = document.get("imageHeight"), document.get("imageWidth")
    if height is None or width is None:
        return None
    if type(height) is not int or type(width) is not int or min(height, width) < 1:
        given = f"imageHeight {height!r} and imageWidth {width!r}"
        raise LabelError(str(path), f"has {given}, but positive whole numbers are needed")
    return height, width


__all__ = ["LabelMe", "LabelMeWriter"]
