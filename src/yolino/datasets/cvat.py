"""CVAT: labels of many images in one XML file, as its format "CVAT for images 1.1" has them.

`<polyline>` elements become polylines; `<polygon>` elements whose label is to be ignored become regions
where nothing is labelled. Boxes, points, masks, skeletons, tags and other polygons are left out. An attribute
called `score` is the score of a polyline, other attributes are left out. Coordinates of CVAT are continuous
pixels with the origin in the corner of the image, so they are taken as they are (its manual has lines that
end at y = 1200 in an image of 1200 rows: https://docs.cvat.ai/docs/dataset_management/formats/format-xml/).

Tracks of the other format, "CVAT for video 1.1", name no images; CVAT itself splits them into images when it
exports "CVAT for images 1.1".
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from yolino.datasets.annotation import Annotation, LabelError
from yolino.datasets.cvat_parser import CVATParser
from yolino.datasets.files import FileDataset, Names
from yolino.datasets.writing import Writer
from yolino.io import write_atomic
from yolino.types import Sample

_NO_XML = re.compile(r"[^\t\n\r\x20-\uD7FF\uE000-\uFFFD\U00010000-\U0010FFFF]")
_IGNORE = "ignore"


class CVATWriter(Writer):
    """Writes `annotations.xml`, which CVAT imports as "CVAT for images 1.1" into a task with the same images.

    CVAT takes over lines whose label the task has; a score other than 1 becomes the attribute `score`, which
    CVAT takes over where the label has an attribute of that name. Regions to ignore become polygons `ignore`.

    Args:
        out: The folder.
        classes: Names of the classes: the labels of the task.
        directed: Not written: vertices keep their order.
        file: Name of the file.
    """

    def __init__(
        self, out: Path, *, classes: Sequence[str] = (), directed: bool = True, file: str = "annotations.xml"
    ) -> None:
        super().__init__(out, classes=classes, directed=directed)
        self._path, self._images, self._has_regions = out / file, list[str](), False

    def add(self, sample: Sample) -> None:
        """Takes one image."""
        if sample.size is None:
            raise ValueError(f"The size of {sample.name} is unknown, but CVAT's format states it: give it.")
        (height, width), found = sample.size, sample.polylines
        if not np.isfinite(found.scores).all():
            raise ValueError(f"{sample.name} has a score that is not finite: take its line out.")
        lines = [f'  <image id="{len(self._images)}" name={_quoted(sample.name)}']
        lines[0] += f' width="{width}" height="{height}">'
        for vertices, label, score in zip(found, found.labels, found.scores, strict=True):
            points = _format_points(vertices, sample.name)
            lines.append(_element("polyline", self.name_of(int(label)), points, float(score)))
        for vertices in sample.ignore:
            lines.append(_element("polygon", _IGNORE, _format_points(vertices, sample.name), 1.0))
            self._has_regions = True
        self._images.append("\n".join([*lines, "  </image>\n"]))

    def close(self) -> None:
        """Writes the file."""
        kinds = dict.fromkeys(self.classes or (self.name_of(0),), "polyline")
        if self._has_regions:
            kinds[_IGNORE] = "any" if _IGNORE in kinds else "polygon"
        task = [
            "<name>yolino</name>",
            f"<size>{len(self._images)}</size>",
            "<mode>annotation</mode>",
            "<labels>",
            *(_label(name, kind) for name, kind in kinds.items()),
            "</labels>",
        ]
        head = ['<?xml version="1.0" encoding="utf-8"?>', "<annotations>", "  <version>1.1</version>"]
        meta = ["  <meta><task>", *(f"    {line}" for line in task), "  </task></meta>\n"]
        text = "\n".join([*head, *meta]) + "".join(self._images) + "</annotations>\n"
        write_atomic(self._path, text)


class CVAT(FileDataset):
    """Images and polylines of a CVAT task or project, exported as "CVAT for images 1.1".

    The file is read as it comes, an image at a time. Images are looked for where CVAT exports them, too: in
    the folder `images`, and there in a folder for each subset of a project.

    Without `classes`, the classes are the task's labels in the task's order: those that occur on a polyline
    and those that are meant for polylines only.

    Args:
        root: Folder of the images.
        labels: XML files, absolute or below `root`; None: `annotations.xml` in `root`, or else all XML files.
        options: The other arguments of `FileDataset`.
    """

    patterns = ("annotations.xml", "*.xml")
    writer = CVATWriter

    def __init__(self, root: str | Path, labels: Names | None = None, **options: Any) -> None:
        self._kinds: dict[str, str] = {}
        super().__init__(root, labels, **options)

    def read(self, path: Path) -> Iterator[Annotation | LabelError]:
        """Yields an annotation for each image."""
        yield from CVATParser(path, self.ignore, self._kinds).images()

    def found_classes(self) -> tuple[str, ...]:
        """Gives the names of the task's labels for polylines, and of others that occur."""
        occurring = super().found_classes()
        listed = [name for name, kind in self._kinds.items() if kind == "polyline" or name in occurring]
        return tuple(dict.fromkeys([*listed, *occurring]))


def _format_points(vertices: Iterable[Iterable[float]], name: str) -> str:
    array = np.asarray(vertices, np.float64)
    if len(array) == 0 or not np.isfinite(array).all():
        raise ValueError(f"{name} has a line without vertices or with one that is not finite: take it out.")
    return ";".join(f"{x!r},{y!r}" for x, y in array.tolist())


def _element(tag: str, name: str, points: str, score: float) -> str:
    head = f'    <{tag} label={_quoted(name)} occluded="0" points="{points}" z_order="0"'
    if score == 1:
        return f"{head}></{tag}>"
    return f'{head}><attribute name="score">{score!r}</attribute></{tag}>'


def _label(name: str, kind: str) -> str:
    score = (
        "<attribute><name>score</name><mutable>False</mutable><input_type>text</input_type>"
        "<default_value>1</default_value><values></values></attribute>"
    )
    attributes = f"<attributes>{'' if kind == 'polygon' else score}</attributes>"
    name = escape(_checked(name), {"\r": "&#13;"})
    return f"  <label><name>{name}</name><type>{kind}</type>{attributes}</label>"


def _quoted(name: str) -> str:
    return quoteattr(_checked(name))


def _checked(name: str) -> str:
    if found := _NO_XML.search(name):
        raise ValueError(
            f"The name {name!r} has the character {found[0]!r}, which XML cannot hold: rename it."
        )
    return name


__all__ = ["CVAT", "CVATWriter"]
