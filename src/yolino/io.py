"""Images from files, results to files: robust reading, atomic writing, the JSON form of results."""

from __future__ import annotations

import json
import os
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import metadata
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Shaped, UInt8

from yolino import jpeg, png
from yolino.types import Polylines

_LARGEST = 2**30  # pixels: OpenCV reads no more
_REDUCED = {
    2: cv2.IMREAD_REDUCED_COLOR_2,
    4: cv2.IMREAD_REDUCED_COLOR_4,
    8: cv2.IMREAD_REDUCED_COLOR_8,
}


def read_image(path: str | Path, *, reduce: int = 1) -> UInt8[np.ndarray, "h w 3"]:
    """Gives the RGB pixels of an image file.

    EXIF rotation is applied, gray and palette images become RGB, 16-bit values are scaled to 8 bit,
    transparent pixels are blended over white.

    Args:
        path: A JPEG, PNG, WebP, TIFF, BMP or any other file that OpenCV reads.
        reduce: 1, 2, 4 or 8: one pixel of the result stands for a block of this many rows and columns, so the
            size is `ceil(size / reduce)`, and points of the result times `reduce` are points of the image.
            A JPEG is decoded at that size, which saves time.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is empty, truncated, no image, too large or of an unusual pixel type.
    """
    if reduce not in (1, 2, 4, 8):
        raise ValueError(f"reduce is {reduce}, but must be 1, 2, 4 or 8.")
    data = _read_bytes(path)
    _check_complete(data, path)
    if data.startswith(jpeg.START):
        bgr = _decode(data, _REDUCED.get(reduce, cv2.IMREAD_COLOR), path)
        return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB))
    if _has_alpha(data):
        image = _over_white(_to_uint8(_decode(data, cv2.IMREAD_UNCHANGED, path), path))
    else:
        image = _to_uint8(_decode(data, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH, path), path)
    return reduce_image(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), reduce)


def reduce_image(image: UInt8[np.ndarray, "h w 3"], reduce: int) -> UInt8[np.ndarray, "a b 3"]:
    """Gives the means of blocks of `reduce` rows and columns; the size is `ceil(size / reduce)`.

    Blocks at the right and lower edge are filled up with copies of the last column and row.
    """
    if reduce == 1:
        return image
    height, width = image.shape[:2]
    bottom, right = -height % reduce, -width % reduce
    if bottom or right:
        image = cv2.copyMakeBorder(image, 0, bottom, 0, right, cv2.BORDER_REPLICATE)
    size = (image.shape[1] // reduce, image.shape[0] // reduce)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))


def image_size(path: str | Path) -> tuple[int, int]:
    """Gives `(height, width)` of an image file as `read_image` would return it.

    Of a JPEG and of most PNG files only the header and the end are read; other files are decoded, and so are
    these if the end is not there, which then raises.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is no readable image.
    """
    if Path(path).is_file():
        with open(path, "rb") as stream:
            header = jpeg.read_header(stream)
            size = png.read_size(stream) if header is None else header.size
            if header is not None and not jpeg.ends_whole(stream):
                size = None
        if size is not None:
            return size
    height, width = read_image(path).shape[:2]
    return height, width


def write_atomic(path: str | Path, data: bytes | str) -> None:
    """Writes a file that is either wholly there or not at all; text is written as UTF-8.

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
                stream.write(data.encode() if isinstance(data, str) else data)
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


def _read_bytes(path: str | Path) -> bytes:
    path = Path(path)
    if path.is_dir():
        raise ValueError(f"{path} is a folder, not an image file.")
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise FileNotFoundError(f"There is no image file {path}.") from None
    except OSError as error:
        raise ValueError(f"{path} cannot be read: {error.strerror or error}.") from None
    if not data:
        raise ValueError(f"{path} is empty (0 bytes), not an image.")
    return data


def _check_complete(data: bytes, path: str | Path) -> None:
    """Raises if the end is missing, which OpenCV may fill with gray, or the image is beyond its limit."""
    height, width = 0, 0
    whole = True
    if data.startswith(jpeg.START):
        whole = jpeg.is_complete(data)
        height, width, _ = jpeg.read_header(BytesIO(data)) or (0, 0, 1)
    elif data.startswith(png.START):
        whole = png.is_complete(data)
        height, width = png.stated_size(data) if whole else (0, 0)
    elif data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        whole = len(data) >= 8 + int.from_bytes(data[4:8], "little")
    if not whole:
        raise ValueError(f"{path} is truncated: the end of the image is missing after {len(data)} bytes.")
    if height * width > _LARGEST:
        limit = f"at most {_LARGEST} pixels are read: cut it into tiles"
        raise ValueError(f"{path} has {width} x {height} pixels, but {limit}.")


def _has_alpha(data: bytes) -> bool:
    if data.startswith(png.START):
        return png.has_alpha(data)
    if data[8:16] == b"WEBPVP8X":
        return bool(data[20] & 0x10)
    return data[8:16] == b"WEBPVP8L"


@contextmanager
def quiet() -> Iterator[None]:
    """Keeps OpenCV's log lines from standing beside our one sentence."""
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(level)


def _decode(data: bytes, flags: int, path: str | Path) -> Shaped[np.ndarray, "h w *c"]:
    try:
        with quiet():
            image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        raise ValueError(f"{path} cannot be decoded: {error.err or error}.") from None
    if image is None:
        raise ValueError(f"{path} is damaged or not an image of a known kind.")
    return np.asarray(image)


def _to_uint8(image: Shaped[np.ndarray, "h w *c"], path: str | Path) -> UInt8[np.ndarray, "h w *c"]:
    if image.dtype == np.uint8:
        return image
    if image.dtype != np.uint16:
        raise ValueError(f"{path} has {image.dtype} pixels, but 8-bit or 16-bit ones are needed: convert it.")
    return np.asarray(cv2.convertScaleAbs(image, alpha=1 / 257))


def _over_white(image: UInt8[np.ndarray, "h w *c"]) -> UInt8[np.ndarray, "h w 3"]:
    if image.ndim == 2:
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    if image.shape[2] == 3:
        return image
    alpha = cv2.merge([image[:, :, 3]] * 3)
    color = cv2.multiply(image[:, :, :3], alpha, scale=1 / 255)
    return np.asarray(cv2.add(color, 255 - alpha))
