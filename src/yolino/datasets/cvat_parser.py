"""Reads the XML of CVAT as it comes, an image at a time, and knows the line of everything that is wrong."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple
from xml.parsers import expat

import numpy as np
from jaxtyping import Float

from yolino.datasets.annotation import Annotation, LabelError

_CHUNK = 1 << 16
_PIXELS = re.compile(r"0*[1-9][0-9]{0,8}")


@dataclass
class _Image:
    """An image whose element is open."""

    name: str
    where: str
    size: tuple[int, int] | None = None
    error: LabelError | None = None
    lines: list[Float[np.ndarray, "_ 2"]] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    scores: list[float] = field(default_factory=list)
    ignore: list[Float[np.ndarray, "_ 2"]] = field(default_factory=list)


class _Shape(NamedTuple):
    """A polyline or polygon whose element is open."""

    tag: str
    attributes: dict[str, str]
    where: str


class CVATParser:
    """Turns a file of CVAT into annotations while it is parsed.

    Args:
        path: The file.
        ignore: Labels whose polygons are regions where nothing is labelled.
        kinds: Takes in the names of the task's labels, and the kind of shape that each is meant for.
    """

    def __init__(self, path: Path, ignore: Sequence[str], kinds: dict[str, str]) -> None:
        self._path, self._ignore, self._kinds = path, ignore, kinds
        self._done: list[Annotation | LabelError] = []
        self._open: list[str] = []
        self._text: list[str] = []
        self._label: dict[str, str] = {}
        self._attribute, self._score = "", ""
        self._image = _Image("", "")
        self._shape = _Shape("", {}, "")
        self._expat = expat.ParserCreate()
        self._expat.buffer_text = True
        self._expat.StartElementHandler = self._start
        self._expat.EndElementHandler = self._end
        self._expat.CharacterDataHandler = self._text.append
        # Without a document type there are no entities: none that name files, none that grow without end.
        self._expat.StartDoctypeDeclHandler = self._refuse

    def images(self) -> Iterator[Annotation | LabelError]:
        """Yields the images of the file.

        Raises:
            LabelError: The file cannot be read, or not be read on.
        """
        with self._path.open("rb") as stream:
            going = True
            while going:
                chunk = stream.read(_CHUNK)
                going = bool(chunk)
                failure = self._parse(chunk)
                yield from self._done
                self._done.clear()
                if failure:
                    raise failure

    def _parse(self, chunk: bytes) -> LabelError | None:
        """Takes the next part of the file; an empty one is its end."""
        try:
            self._expat.Parse(chunk, not chunk)
        except LabelError as error:
            return error
        except expat.ExpatError as error:
            reason = f"is not valid XML ({expat.ErrorString(error.code)}), but a whole file of CVAT is needed"
            return LabelError(f"{self._path}, line {error.lineno}", reason)
        except (LookupError, ValueError) as error:  # an encoding that is unknown
            return LabelError(f"{self._path}, line 1", f"cannot be decoded ({error}): save it as UTF-8")
        return None

    def _place(self, inside: str = "") -> str:
        return f"{self._path}{inside}, line {self._expat.CurrentLineNumber}"

    def _refuse(self, *_: object) -> None:
        raise LabelError(self._place(), "declares a document type, which CVAT does not: take <!DOCTYPE> out")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._open.append(tag)
        self._text.clear()
        match self._open:
            case [root] if root != "annotations":
                raise LabelError(self._place(), f"begins with <{root}>, but <annotations> of CVAT is needed")
            case [_, "track"]:
                reason = 'has a <track> of "CVAT for video": export the task as "CVAT for images 1.1"'
                raise LabelError(self._place(), reason)
            case [_, "image"]:
                self._image = self._open_image(attributes)
            case [_, "image", "polyline" | "polygon"]:
                self._shape = _Shape(tag, attributes, self._place(f", image {self._image.name}"))
                self._score = ""
            case [_, "image", _, "attribute"]:
                self._attribute = attributes.get("name", "")
            case [_, "meta", *_, "labels", "label"]:
                self._label = {}

    def _end(self, tag: str) -> None:
        text = "".join(self._text)
        match self._open:
            case [_, "meta", *_, "labels", "label", key]:
                self._label[key] = text
            case [_, "meta", *_, "labels", "label"] if "name" in self._label:
                self._kinds.setdefault(self._label["name"], self._label.get("type", "any"))
            case [_, "image", _, "attribute"] if self._attribute == "score":
                self._score = text
            case [_, "image", "polyline" | "polygon"] if self._image.error is None:
                try:
                    self._close_shape(*self._shape)
                except LabelError as error:
                    self._image.error = error
            case [_, "image"]:
                self._done.append(self._close_image(self._image))
        self._open.pop()
        self._text.clear()

    def _open_image(self, attributes: dict[str, str]) -> _Image:
        name = attributes.get("name", "").replace("\\", "/")
        # CVAT exports the images of projects into a folder for each subset, frames of videos as PNG files.
        inside = Path("images", attributes.get("subset", ""), name if Path(name).suffix else f"{name}.PNG")
        if name and inside != Path("images", name) and (self._path.parent / inside).is_file():
            name = inside.as_posix()
        image = _Image(name, f"{self._path}, image {name}")
        if not name:
            image.error = LabelError(self._place(), "has an image without a name, but a file is needed")
        elif "width" in attributes or "height" in attributes:
            width, height = attributes.get("width", ""), attributes.get("height", "")
            if _PIXELS.fullmatch(width) and _PIXELS.fullmatch(height):
                image.size = int(height), int(width)
            else:
                reason = f"has width {width!r} and height {height!r}, but whole numbers of pixels are needed"
                image.error = LabelError(self._place(f", image {name}"), reason)
        return image

    def _close_shape(self, tag: str, attributes: dict[str, str], where: str) -> None:
        name = attributes.get("label")
        if tag == "polygon" and name not in self._ignore:
            return
        if name is None:
            raise LabelError(where, f"has a {tag} without a label, but the name of a class is needed")
        vertices = _parse_points(attributes.get("points", ""), where)
        if tag == "polygon":
            self._image.ignore.append(vertices)
        else:
            self._image.scores.append(_parse_score(self._score, where))
            self._image.lines.append(vertices)
            self._image.names.append(name)

    def _close_image(self, image: _Image) -> Annotation | LabelError:
        if image.error:
            return image.error
        scores = image.scores if any(score != 1 for score in image.scores) else ()
        return Annotation(image.name, image.where, image.lines, image.names, scores, image.ignore, image.size)


def _parse_points(text: str, where: str) -> Float[np.ndarray, "v 2"]:
    values: list[float] = []
    for point in text.split(";"):
        try:
            x, y = point.split(",")
            values += (float(x), float(y))
        except ValueError:
            raise LabelError(where, f"has the point {point[:40]!r}, but x,y is needed") from None
    vertices = np.array(values, np.float64).reshape(-1, 2)
    if not np.isfinite(vertices).all():
        raise LabelError(where, "has a coordinate that is not finite, but numbers of pixels are needed")
    return vertices


def _parse_score(text: str, where: str) -> float:
    try:
        score = float(text) if text.strip() else 1.0  # CVAT's lines that a person adds have an empty one
    except ValueError:
        score = np.nan
    if not np.isfinite(score):
        raise LabelError(where, f"has the score {text[:40]!r}, but a finite number is needed")
    return score


__all__ = ["CVATParser"]
