"""Images from files, results to files: robust reading, atomic writing, the JSON form of results."""

from __future__ import annotations

import json
import os
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import BinaryIO

import cv2
import numpy as np
from jaxtyping import UInt8

from yolino.decoding import image_size, quiet, read_image, read_reduced, reduce_image
from yolino.types import Polylines


def write_atomic(path: str | Path, data: bytes | str) -> None:
    """Writes a file that is either wholly there or not at all; text is written as UTF-8.

    Raises:
        OSError: The disk is full, or the place cannot be written.
    """
    with open_atomic(path) as stream:
        stream.write(data.encode() if isinstance(data, str) else data)


@contextmanager
def open_atomic(path: str | Path) -> Iterator[BinaryIO]:
    """Opens a file for writing that is there when the block ends, and not at all if that fails.

    The data goes to a temporary name in the same folder, which is made if need be, and is renamed when it
    is on the disk. An older file stays as it was until then.

    Raises:
        OSError: The disk is full, or the place cannot be written.
    """
    target = Path(os.path.realpath(path))
    temporary = target.with_name(f".{uuid.uuid4().hex[:12]}.tmp")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            with open(temporary, "xb") as stream:
                yield stream
                stream.flush()
                os.fsync(stream.fileno())
            os.replace(temporary, target)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OSError(
            f"{path} cannot be written: {error.strerror or error}. What was there before is as it was."
        ) from None


def write_image(path: str | Path, image: UInt8[np.ndarray, "h w 3"]) -> None:
    """Writes RGB pixels as an image file of the kind its suffix names (.png, .jpg), wholly or not at all.

    Raises:
        ValueError: The suffix names no kind of image.
        OSError: The disk is full, or the place cannot be written.
    """
    suffix = Path(path).suffix
    try:
        with quiet():
            ok, data = cv2.imencode(suffix, cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    except cv2.error:
        ok = False
    if not ok:
        raise ValueError(f"{path} cannot be written as an image: use a name that ends in .png or .jpg.")
    write_atomic(path, data.tobytes())


@dataclass(frozen=True, eq=False)
class Result:
    """The polylines found in one image, with all that a reader of the file needs to know.

    Attributes:
        image: Name of the image file.
        size: `(height, width)` of the image.
        polylines: The polylines in pixels of the image.
        classes: Names of the classes; a polyline's label is the index.
        model: Name of the model.
        version: Version of yolino.
    """

    image: str
    size: tuple[int, int]
    polylines: Polylines
    classes: tuple[str, ...] = ()
    model: str = ""
    version: str = field(default_factory=lambda: metadata.version("yolino"))


def to_json(result: Result) -> str:
    """Gives a result as one JSON object: points rounded to 1/100 pixel, scores to 1/10000.

    Raises:
        ValueError: A point or score is infinite or not a number, which JSON cannot say.
    """
    lines = result.polylines
    if not (np.isfinite(lines.vertices).all() and np.isfinite(lines.scores).all()):
        raise ValueError(
            f"The polylines of {result.image} have points or scores that are not finite numbers."
        )
    document = {
        "image": result.image,
        "size": list(result.size),
        "polylines": [
            {"points": np.round(points, 2).tolist(), "score": round(float(score), 4), "label": int(label)}
            for points, score, label in zip(lines, lines.scores, lines.labels, strict=True)
        ],
        "classes": list(result.classes),
        "model": result.model,
        "version": result.version,
    }
    return json.dumps(document, allow_nan=False) + "\n"


def from_json(text: str) -> Result:
    """Gives the result that `to_json` wrote.

    Raises:
        ValueError: The text is no JSON, or lacks something a result has.
    """
    try:
        document = json.loads(text)
        lines = document["polylines"]
        polylines = Polylines.from_list(
            [line["points"] for line in lines],
            [line["score"] for line in lines],
            [line["label"] for line in lines],
        )
        height, width = (int(value) for value in document["size"])
        classes = tuple(str(name) for name in document.get("classes", ()))
        model, version = str(document.get("model", "")), str(document.get("version", ""))
        return Result(str(document["image"]), (height, width), polylines, classes, model, version)
    except KeyError as error:
        raise ValueError(f"the key {error} is missing") from None
    except (TypeError, AttributeError) as error:
        raise ValueError(f"it does not have the form of a result ({error})") from None


def read_result(path: str | Path) -> Result:
    """Gives the result in a file that was written in the `json` format.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is no such result.
    """
    try:
        return from_json(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise FileNotFoundError(f"There is no result file {path}.") from None
    except ValueError as error:
        raise ValueError(f"{path} is not a result of yolino: {error}.") from None


FORMATS: dict[str, Callable[[Result], str]] = {"json": to_json}


__all__ = [
    "FORMATS",
    "Result",
    "from_json",
    "image_size",
    "open_atomic",
    "quiet",
    "read_image",
    "read_reduced",
    "read_result",
    "reduce_image",
    "to_json",
    "write_atomic",
    "write_image",
]
