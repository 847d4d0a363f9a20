"""Image files to RGB pixels: what is cut, turned, transparent, gray, deep, too large or no image at all."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Shaped, UInt8

from yolino import jpeg, png

_LARGEST = 2**30  # pixels: OpenCV reads no more
_REDUCED = {
    1: cv2.IMREAD_COLOR,
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
    if reduce not in _REDUCED:
        raise ValueError(f"reduce is {reduce}, but must be 1, 2, 4 or 8.")
    data = _read_bytes(path)
    _check_complete(data, path)
    if data.startswith(jpeg.START):
        return _decode_jpeg(data, reduce, path)
    return reduce_image(_decode_any(data, path), reduce)


def read_reduced(
    path: str | Path, reduction: Callable[[tuple[int, int]], int]
) -> tuple[UInt8[np.ndarray, "h w 3"], int]:
    """Gives the RGB pixels of an image file, of a JPEG reduced if that will do, and by how much they are.

    Args:
        path: As for `read_image`.
        reduction: From the size (height, width) of a JPEG to 1, 2, 4 or 8: by how much it may be reduced.
            Where that does not divide both sides, less is done, so each pixel stands for a whole block.

    Returns:
        The pixels, and 1, 2, 4 or 8: points of the pixels times this are points of the image.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: As for `read_image`.
    """
    data = _read_bytes(path)
    size = _check_complete(data, path)
    if not data.startswith(jpeg.START):
        return _decode_any(data, path), 1
    reduce = reduction(size) if min(size) else 1
    while reduce > 1 and (size[0] % reduce or size[1] % reduce):
        reduce //= 2
    return _decode_jpeg(data, reduce, path), reduce


def _decode_jpeg(data: bytes, reduce: int, path: str | Path) -> UInt8[np.ndarray, "h w 3"]:
    return np.asarray(cv2.cvtColor(_decode(data, _REDUCED[reduce], path), cv2.COLOR_BGR2RGB))


def _decode_any(data: bytes, path: str | Path) -> UInt8[np.ndarray, "h w 3"]:
    """Gives the pixels of other files than JPEG."""
    if _has_alpha(data):
        image = _over_white(_to_uint8(_decode(data, cv2.IMREAD_UNCHANGED, path), path))
    else:
        image = _to_uint8(_decode(data, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH, path), path)
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))


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


def _check_complete(data: bytes, path: str | Path) -> tuple[int, int]:
    """Gives the size as displayed, (0, 0) where the file's head does not tell.

    Raises:
        ValueError: The end is missing, which OpenCV may fill with gray, or the image is beyond its limit.
    """
    height, width = 0, 0
    whole = True
    if data.startswith(jpeg.START):
        whole = jpeg.is_complete(data)
        header = jpeg.read_header(BytesIO(data))
        height, width = (0, 0) if header is None else header.size
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
    return height, width


def _has_alpha(data: bytes) -> bool:
    if data.startswith(png.START):
        return png.has_alpha(data)
    if data[8:16] == b"WEBPVP8X":
        return bool(data[20] & 0x10)
    return data[8:16] == b"WEBPVP8L"


class _Silence:
    """How many blocks keep OpenCV silent at the moment, and its level before the first."""

    lock = threading.Lock()
    blocks = 0
    level = 0


@contextmanager
def quiet() -> Iterator[None]:
    """Keeps OpenCV's log lines from standing beside our one sentence; threads may do so at once."""
    with _Silence.lock:
        if _Silence.blocks == 0:
            _Silence.level = cv2.utils.logging.getLogLevel()
            cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        _Silence.blocks += 1
    try:
        yield
    finally:
        with _Silence.lock:
            _Silence.blocks -= 1
            if _Silence.blocks == 0:
                cv2.utils.logging.setLogLevel(_Silence.level)


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


__all__ = ["image_size", "quiet", "read_image", "read_reduced", "reduce_image"]
