"""COCO-style JSON with a field `polyline`: one file for many images.

`{"images": [{"id", "file_name", "width", "height"}], "annotations": [{"id", "image_id", "category_id",
"polyline", "score"}], "categories": [{"id", "name"}]}`, each list with an object per image, line and class.

- `polyline` is `[x1, y1, x2, y2, ...]`, or `[[x, y], ...]`, or a list of several such polylines. A list of
  pairs of numbers is one polyline of points.
- An annotation with `iscrowd` or `ignore`, or without `polyline` in a category that is ignored, is a region
  where nothing is labelled: the polygons `[[x1, y1, ...], ...]` of its `segmentation`, or else its `bbox`.
- Other annotations without `polyline` (boxes, masks, keypoints) are left out. Without `category_id` the class
  is `line`. Images without annotations are samples without polylines.

Coordinates are continuous pixels in COCO, and are taken as they are.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from yolino.datasets.annotation import Annotation, LabelError
from yolino.datasets.coco_document import (
    Entry,
    Vertices,
    category_names,
    category_of,
    check_entry,
    check_image,
    load,
    regions,
    score_of,
    shapes,
    size_of,
)
from yolino.datasets.files import FileDataset, Names
from yolino.datasets.writing import ImageWriter, Writer
from yolino.io import write_atomic
from yolino.types import Sample

_IGNORE = "ignore"


class CocoWriter(Writer):
    """Writes `annotations.json`: images, categories, polylines with their bounding boxes, regions to ignore.

    A region is an annotation with `iscrowd` and `segmentation` in the category `ignore`. The `area` of a
    polyline is that of its bounding box.

    Args:
        out: The folder.
        classes: Names of the classes, which become the categories 1, 2, ...
        directed: Not written: the order of the vertices is kept.
        file: Name of the file.
    """

    loses = ()

    def __init__(
        self, out: Path, *, classes: Sequence[str] = (), directed: bool = True, file: str = "annotations.json"
    ) -> None:
        super().__init__(out, classes=classes, directed=directed)
        self._path = out / file
        self._images: list[Entry] = []
        self._annotations: list[Entry] = []
        self._categories = {name: i for i, name in enumerate(self.classes or (self.name_of(0),), 1)}

    def add(self, sample: Sample) -> None:
        """Takes one image."""
        ImageWriter.check(sample)
        _check_numbers(sample)
        size = sample.size
        if size is None and isinstance(sample.image, np.ndarray):
            size = sample.image.shape[:2]
        if size is None:
            raise ValueError(
                f"The size of {sample.name} is unknown, but COCO needs it: give the sample a size."
            )
        image = {"id": len(self._images) + 1, "file_name": sample.name, "width": size[1], "height": size[0]}
        self._images.append(image)
        lines = sample.polylines
        for vertices, score, label in zip(lines, lines.scores.tolist(), lines.labels.tolist(), strict=True):
            scored = {} if score == 1 else {"score": score}
            self._append(self.name_of(label), vertices, {"polyline": vertices.ravel().tolist(), **scored})
        for polygon in sample.ignore:
            region = {"segmentation": [polygon.ravel().tolist()], "area": _area(polygon), "iscrowd": 1}
            self._append(_IGNORE, polygon, region)

    def _append(self, name: str, vertices: Vertices, fields: Entry) -> None:
        category = self._categories.setdefault(name, len(self._categories) + 1)
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        width, height = (high - low).tolist()
        common = {
            "id": len(self._annotations) + 1,
            "image_id": len(self._images),
            "category_id": category,
            "bbox": [*low.tolist(), width, height],
            "area": width * height,
            "iscrowd": 0,
        }
        self._annotations.append({**common, **fields})

    def close(self) -> None:
        """Writes the file."""
        categories = [{"id": i, "name": name} for name, i in self._categories.items()]
        lists = {"images": self._images, "annotations": self._annotations, "categories": categories}
        rows = {key: ",\n".join(json.dumps(entry) for entry in entries) for key, entries in lists.items()}
        text = ",\n".join(f'"{key}": [\n{row}\n]' for key, row in rows.items())
        write_atomic(self._path, f"{{{text}}}\n")


class Coco(FileDataset):
    """Images with COCO-style annotations that have a `polyline`.

    Without `classes`, the classes are the categories in the order of the files, also those that do not occur,
    where all files list the same; else the names that occur, sorted.

    Args:
        root: Folder that `file_name` starts from; its folder `images`, that of the label file and `images=`
            are tried too.
        labels: Label files, absolute or below `root`; None: `annotations/*.json`, or else `*.json`.
        options: The other arguments of `FileDataset`.
    """

    patterns = ("annotations/*.json", "*.json")
    writer = CocoWriter

    def __init__(self, root: str | Path, labels: Names | None = None, **options: Any) -> None:
        self._categories: list[tuple[str, ...]] = []
        super().__init__(root, labels, **options)

    def read(self, path: Path) -> Iterator[Annotation | LabelError]:
        """Yields an annotation for each image."""
        document = load(path)
        categories = category_names(document["categories"], str(path))
        self._categories.append(tuple(categories.values()))
        images: list[Entry] = []
        entries: dict[object, list[tuple[str, Entry]]] = {}
        for index, image in enumerate(document["images"]):
            try:
                check_image(image, f"{path}, images[{index}]", entries)
                entries[image["id"]] = []
                images.append(image)
            except LabelError as error:
                yield error
        for index, entry in enumerate(document["annotations"]):
            try:
                part = check_entry(entry, str(path), index, entries)
                entries[entry["image_id"]].append((part, entry))
            except LabelError as error:
                yield error
        for image in images:
            try:
                file = image["file_name"].replace("\\", "/")
                lines = self._lines(entries[image["id"]], categories, f"{path}, image {file}")
                yield Annotation(file, f"{path}, image {file}", *lines, size_of(image))
            except LabelError as error:
                yield error

    def _lines(
        self, entries: list[tuple[str, Entry]], categories: dict[object, str], image: str
    ) -> tuple[list[Vertices], list[str], list[float], list[Vertices]]:
        """Gives polylines, their names and scores, and regions to ignore, of the annotations of one image."""
        lines: list[Vertices] = []
        names: list[str] = []
        scores: list[float] = []
        ignore: list[Vertices] = []
        for part, entry in entries:
            where = f"{image}, {part}"
            name = category_of(entry, categories, where, default=self.default_class)
            if entry.get("iscrowd") or entry.get("ignore"):
                ignore.extend(regions(entry, where))
            elif entry.get("polyline") is not None:
                found = shapes(entry["polyline"], f"{where}, polyline")
                lines.extend(found)
                names.extend([name] * len(found))
                scores.extend([score_of(entry, where)] * len(found))
            elif name in self.ignore:
                ignore.extend(regions(entry, where))
        return lines, names, scores, ignore

    def found_classes(self) -> tuple[str, ...]:
        """Gives the categories of the files where these agree, else the names that occur."""
        occurring = super().found_classes()
        stated = {
            tuple(name for name in names if name not in self.ignore or name in occurring)
            for names in self._categories
        }
        if len(stated) != 1:
            return occurring
        return tuple(dict.fromkeys([*stated.pop(), *occurring]))


def _area(polygon: Vertices) -> float:
    """Gives the area inside a polygon (shoelace formula)."""
    x, y = (polygon - polygon[:1]).T
    return float(abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2)


def _check_numbers(sample: Sample) -> None:
    if not all(np.isfinite(values).all() for values in (sample.polylines.scores, *sample.ignore)):
        raise ValueError(f"{sample.name} has a score or a region to ignore that is not finite: remove it.")
    if any(len(polygon) < 3 for polygon in sample.ignore):
        raise ValueError(f"{sample.name} has a region to ignore of fewer than 3 vertices: remove it.")


__all__ = ["Coco", "CocoWriter"]
