"""Label Studio: tasks with their annotations, as its export "JSON" has them.

```
[{"data": {"image": "/data/local-files/?d=clips/a.jpg"}, "annotations": [{"result": [
  {"id": "1", "type": "vectorlabels", "from_name": "line", "to_name": "image",
   "original_width": 1280, "original_height": 720, "image_rotation": 0,
   "value": {"closed": false, "vectorlabels": ["lane"], "vertices": [
     {"id": "a", "x": 50.0, "y": 100.0, "prevPointId": null, "isBezier": false},
     {"id": "b", "x": 40.5, "y": 60.25, "prevPointId": "a", "isBezier": false}]}}]}]}]
```

Paths of the tools Vector and VectorLabels (`vertices`, see `labelstudio_paths`) are polylines, and so are
`points` of the types `polyline` and `polylinelabels` of other tools. A polygon or closed path whose label is
in `ignore` is a region where nothing is labelled. Other polygons, boxes, masks, key points and choices are
left out. Coordinates are percents of the image, from edge to edge. A number `score` of a result is the score
of its polylines.
(https://labelstud.io/guide/task_format, https://labelstud.io/tags/vectorlabels)

Of a task, the first annotation that was not cancelled counts. A task without one is not labelled, which is
not the same as an image without lines: it is left out. Names of images are found in what the task says of
them: the path in `/data/local-files/?d=PATH`, the name in `/data/upload/1/0a1b2c3d-NAME` (Label Studio puts
the eight digits in front), the path of a URL; of a path, as much of its end as leads to a file.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import parse_qs, quote, unquote, urlsplit
from xml.sax.saxutils import quoteattr

import numpy as np
from jaxtyping import Float

from yolino.datasets.annotation import Annotation, LabelError
from yolino.datasets.files import FileDataset, Names
from yolino.datasets.image_paths import find_end
from yolino.datasets.labelstudio_shapes import read_shapes
from yolino.datasets.writing import Writer
from yolino.image import IMAGE_SUFFIXES
from yolino.io import write_atomic
from yolino.types import Sample

_IGNORE = "ignore"
_SPACE = re.compile(r"[ \t\r\n]*")
_UPLOADED = re.compile(r"^[0-9a-f]{8}-(?=.)")


class LabelStudioWriter(Writer):
    """Writes `tasks.json`, which Label Studio imports, and `labeling_config.txt`, the tools that it needs.

    Args:
        out: The folder.
        classes: Names of the classes: the labels of the vector tool.
        directed: Not written: vertices keep their order.
        prelabel: Whether to write predictions, which a person accepts and corrects, instead of annotations.
        prefix: What stands before the name of an image in its address: that of Label Studio's local files,
            if its document root is `out`.
    """

    def __init__(
        self,
        out: Path,
        *,
        classes: Sequence[str] = (),
        directed: bool = True,
        prelabel: bool = False,
        prefix: str = "/data/local-files/?d=",
    ) -> None:
        super().__init__(out, classes=classes, directed=directed)
        self._prelabel, self._prefix, self._tasks = prelabel, prefix, list[str]()

    def add(self, sample: Sample) -> None:
        """Takes one image."""
        if sample.size is None:
            raise ValueError(
                f"The size of {sample.name} is unknown, but percents of it are written: give it."
            )
        (height, width), found, result = sample.size, sample.polylines, list[dict[str, Any]]()
        if not np.isfinite(found.scores).all():
            raise ValueError(f"{sample.name} has a score that is not finite: take its line out.")
        for vertices, label, score in zip(found, found.labels, found.scores, strict=True):
            points = _percents(vertices, sample)
            value = {"vertices": _vertices(points), "closed": False}
            item = self._item("vector", self.name_of(int(label)), value, sample.size)
            result.append(item | {"score": float(score)} if self._prelabel or score != 1 else item)
        for vertices in sample.ignore:
            value = {"points": _percents(vertices, sample), "closed": True}
            result.append(self._item("polygon", _IGNORE, value, sample.size))
        for i, item in enumerate(result):
            item["id"] = f"{len(self._tasks)}-{i}"
        entry: dict[str, Any] = {"result": result}
        if self._prelabel:
            entry["model_version"] = "yolino"
            entry |= {"score": float(found.scores.mean())} if len(found) else {}
        data = {"image": self._prefix + quote(sample.name), "width": width, "height": height}
        task = {"data": data, "predictions" if self._prelabel else "annotations": [entry]}
        self._tasks.append(json.dumps(task, ensure_ascii=False, allow_nan=False))

    def _item(self, tool: str, name: str, value: dict[str, Any], size: tuple[int, int]) -> dict[str, Any]:
        return {
            "type": f"{tool}labels",
            "from_name": "line" if tool == "vector" else "region",
            "to_name": "image",
            "original_width": size[1],
            "original_height": size[0],
            "image_rotation": 0,
            "value": value | {f"{tool}labels": [name]},
        }

    def close(self) -> None:
        """Writes the files."""
        names = dict.fromkeys(self.classes or (self.name_of(0),))
        labels = "".join(f"    <Label value={quoteattr(name)}/>\n" for name in names)
        tools = (
            '<View>\n  <Image name="image" value="$image"/>\n'
            f'  <VectorLabels name="line" toName="image">\n{labels}  </VectorLabels>\n'
            f'  <PolygonLabels name="region" toName="image">\n    <Label value="{_IGNORE}"/>\n'
            "  </PolygonLabels>\n</View>\n"
        )
        write_atomic(self.out / "labeling_config.txt", tools)
        write_atomic(self.out / "tasks.json", "[" + ",\n ".join(self._tasks) + "]\n")


class LabelStudio(FileDataset):
    """Images and polylines of Label Studio's tasks, exported as "JSON".

    Args:
        root: Folder of the images.
        labels: Exported files, absolute or below `root`; None: all JSON files in `root`.
        predictions: Whether to take the first prediction of a task without an annotation.
        options: The other arguments of `FileDataset`.
    """

    patterns = ("*.json",)
    writer = LabelStudioWriter

    def __init__(
        self, root: str | Path, labels: Names | None = None, *, predictions: bool = False, **options: Any
    ) -> None:
        self._kinds = ("annotations", "predictions") if predictions else ("annotations",)
        super().__init__(root, labels, **options)

    def read(self, path: Path) -> Iterator[Annotation | LabelError]:
        """Yields an annotation for each task that is labelled."""
        count = left_out = 0
        for count, task in enumerate(_tasks(path), 1):
            if count == 1 and isinstance(task, dict) and not task.keys() & {"data", *self._kinds}:
                keys = ", ".join(map(str, task))[:80]
                reason = f'has tasks of the keys {keys}, as in "JSON-MIN"'
                raise LabelError(str(path), f'{reason}, but its "JSON" is needed: export the project again')
            try:
                one = self._annotation(task, f"{path}, task {count}", path.parent)
            except LabelError as error:
                yield error
                continue
            if one is None:
                left_out += 1
            else:
                yield one
        if count and left_out == count:
            reason = f"has {count} tasks, but none with {' or '.join(self._kinds)}"
            raise LabelError(str(path), f"{reason}: label some, or read with predictions=True")

    def _annotation(self, task: object, where: str, beside: Path) -> Annotation | None:
        """Gives what a task says; None where it is not labelled."""
        if not isinstance(task, dict) or not isinstance(task.get("data"), dict):
            raise LabelError(where, 'has no data, but {"data": {...}, "annotations": [...]} is needed')
        data, results = task["data"], _results(task, self._kinds, where)
        if results is None:
            return None
        image = self._image(data, where, beside)
        shapes = read_shapes(results, where, size=_size(data), ignore=self.ignore, default=self.default_class)
        scores = shapes.scores if any(score != 1 for score in shapes.scores) else ()
        return Annotation(image, where, shapes.lines, shapes.names, scores, shapes.ignore, shapes.size)

    def _image(self, data: Mapping[str, Any], where: str, beside: Path) -> str:
        path = _image_path(data, where)
        names = [path.lstrip("/")]
        if path.startswith("/data/upload/"):
            names.append(_UPLOADED.sub("", PurePosixPath(path).name))
        return next((end for name in names if (end := find_end(self, name, beside))), names[-1])


def _tasks(path: Path) -> Iterator[object]:
    """Yields the tasks of a file one by one: as objects of Python, all would take many times its size."""
    text, decoder = path.read_text(encoding="utf-8-sig"), json.JSONDecoder()
    at = _skip(text, 0)
    if not text.startswith("[", at):
        raise LabelError(str(path), 'is no list of tasks: export the project as "JSON"')
    at = _skip(text, at + 1)
    while not text.startswith("]", at):
        try:
            task, at = decoder.raw_decode(text, at)
        except json.JSONDecodeError as error:
            where = f"{path}, line {error.lineno}"
            raise LabelError(
                where, f"is not valid JSON ({error.msg}), but a list of tasks is needed"
            ) from None
        except (ValueError, RecursionError) as error:
            where = f"{path}, line {_line(text, at)}"
            raise LabelError(where, f"is not valid JSON ({type(error).__name__})") from None
        yield task
        at = _skip(text, at)
        if text.startswith(",", at):
            at = _skip(text, at + 1)
        elif not text.startswith("]", at):
            where = f"{path}, line {_line(text, at)}"
            raise LabelError(where, "is not valid JSON (expecting , or ]), but a list of tasks is needed")
    if _skip(text, at + 1) != len(text):
        raise LabelError(
            f"{path}, line {_line(text, at)}", "goes on after the list of tasks: export it again"
        )


def _skip(text: str, at: int) -> int:
    space = _SPACE.match(text, at)
    assert space is not None
    return space.end()


def _line(text: str, at: int) -> int:
    return text.count("\n", 0, at) + 1


def _results(task: Mapping[str, Any], kinds: Sequence[str], where: str) -> list[object] | None:
    """Gives the results of the first annotation that was not cancelled; None where there is none."""
    for kind in kinds:
        entries = task.get(kind) or []
        if not isinstance(entries, list):
            raise LabelError(where, f"has {kind} of type {type(entries).__name__}, but a list is needed")
        for entry in entries:
            if not isinstance(entry, dict):
                raise LabelError(where, f"has {kind} of {type(entry).__name__}, but objects are needed")
            if not entry.get("was_cancelled"):
                results = entry.get("result")
                if not isinstance(results, list):
                    raise LabelError(where, f"has {kind} without a list of results")
                return results
    return None


def _image_path(data: Mapping[str, Any], where: str) -> str:
    """Gives the path under the key `image`, or else the first that ends like an image."""
    addresses = {key: value for key, value in data.items() if isinstance(value, str)}
    if path := _path(addresses.pop("image", "")):
        return path
    for address in addresses.values():
        if PurePosixPath(path := _path(address)).suffix.lower() in IMAGE_SUFFIXES:
            return path
    raise LabelError(where, f"names no file of an image in its data ({', '.join(map(str, data))[:80]})")


def _path(address: str) -> str:
    """Gives the path in an address; none where this is the image itself."""
    if address.startswith("data:"):
        return ""
    try:
        parts = urlsplit(address)
    except ValueError:
        return address
    if parts.path.endswith("/local-files/"):
        address = parse_qs(parts.query).get("d", [""])[0]
    elif parts.netloc or parts.path.startswith("/data/upload/"):
        address = unquote(parts.path)
    return address.replace("\\", "/")


def _size(data: Mapping[str, Any]) -> tuple[int, int] | None:
    """Gives the size that we write for images without lines."""
    height, width = data.get("height"), data.get("width")
    if type(height) is not int or type(width) is not int or min(height, width) < 1:
        return None
    return height, width


def _percents(vertices: Float[np.ndarray, "v 2"], sample: Sample) -> list[list[float]]:
    assert sample.size is not None
    with np.errstate(over="ignore"):
        percents = vertices / np.array([sample.size[1], sample.size[0]], np.float64) * 100
    if len(vertices) == 0 or not np.isfinite(percents).all():
        raise ValueError(
            f"{sample.name} has a line without vertices or with one that is not finite: take it out."
        )
    points: list[list[float]] = percents.tolist()
    return points


def _vertices(points: Sequence[Sequence[float]]) -> list[dict[str, Any]]:
    return [
        {"id": str(i), "x": x, "y": y, "prevPointId": str(i - 1) if i else None, "isBezier": False}
        for i, (x, y) in enumerate(points)
    ]


__all__ = ["LabelStudio", "LabelStudioWriter"]
