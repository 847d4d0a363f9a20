"""Decoded pixels in files that are mapped into memory: an image is decoded once, not in every epoch."""

from __future__ import annotations

import hashlib
import logging
import shutil
import tempfile
from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from yolino.datasets import Dataset
from yolino.io import write_atomic

logger = logging.getLogger(__name__)
_LOOKED_AT = 32  # images of a dataset from which the size of all is told
_RESERVE = 10**9  # bytes of the disk that stay free for checkpoints and for others


class PixelCache:
    """Keeps the pixels of image files, each in a file of its own that is mapped into memory.

    The name of that file is made of the path, size and time of the image, the scale and the version of
    OpenCV, so what is out of date is not found. Files are either wholly there or not at all, so processes may
    fill one folder at the same time, and may be killed. Nothing is ever removed.

    Args:
        folder: Where the files are kept; they take three bytes per pixel.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __call__(
        self, image: Path, scale: str, decode: Callable[[], UInt8[np.ndarray, "h w 3"]]
    ) -> UInt8[np.ndarray, "h w 3"]:
        """Gives the pixels of an image as `decode` gave them when they were needed for the first time.

        Args:
            image: The file.
            scale: Name of the scale at which it is decoded.
            decode: Gives the pixels of the file at that scale.

        Raises:
            FileNotFoundError: There is no such image.
            ValueError: It cannot be decoded.
            OSError: The pixels cannot be written.
        """
        file = self._file(image, scale)
        if (found := _mapped(file)) is not None:
            return found
        pixels = decode()
        buffer = BytesIO()
        np.save(buffer, pixels)
        try:
            write_atomic(file, buffer.getvalue())
        except OSError as error:
            raise OSError(f"{error} {INSTEAD}") from None
        return pixels

    def has(self, image: Path, scale: str) -> bool:
        """Tells whether the pixels of an image are there."""
        return self._file(image, scale).is_file()

    def check_writable(self) -> None:
        """Makes the folder, and raises an OSError of one sentence if nothing can be written there."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=self.folder).close()
        except OSError as error:
            raise OSError(
                f"Decoded pixels cannot be kept in {self.folder}: {error.strerror or error}. {INSTEAD}"
            ) from None

    def check_space(self, total: int, missing: int) -> None:
        """Says in the log how much the folder will hold, and raises if the disk has not as much left.

        Args:
            total: Bytes of all pixels.
            missing: Those of them that are not there yet.

        Raises:
            OSError: The disk is too full for the missing ones.
        """
        there, free = _size(total - missing), shutil.disk_usage(self.folder).free
        logger.info(
            "decoded images and drawn scenes take %s in %s, %s of it already there",
            _size(total),
            self.folder,
            there,
        )
        if missing > free - _RESERVE:
            raise OSError(
                f"Decoded images and drawn scenes would take {_size(missing)} more in {self.folder}, but "
                f"{_size(free)} are free there, of which {_size(_RESERVE)} are left to others. {INSTEAD}"
            )

    def _file(self, image: Path, scale: str) -> Path:
        size, time = state_of(image)
        text = f"{image.resolve()} {size} {time} {scale} {cv2.__version__}"
        return self.folder / f"{hashlib.sha256(text.encode()).hexdigest()[:32]}.npy"


INSTEAD = "Give another folder with out=FOLDER, free some space, or train without data.cache."
"""What to do where files cannot be written."""


def state_of(image: Path) -> tuple[int, int]:
    """Gives size and time of a file, which change when it is written anew.

    Raises:
        FileNotFoundError: There is no such file.
    """
    try:
        state = image.stat()
    except FileNotFoundError:
        raise FileNotFoundError(f"There is no image file {image}.") from None
    return state.st_size, state.st_mtime_ns


def expected(dataset: Dataset, bytes_of: Callable[[Path], tuple[int, bool]]) -> tuple[int, int]:
    """Estimates the bytes of all images of a dataset, and of those that are not there yet, from some of them.

    Args:
        dataset: Whole images; those that are no files take nothing.
        bytes_of: Gives the bytes of an image, and whether they are there.
    """
    if not in_files(dataset):
        return 0, 0
    places = sorted({round(i) for i in np.linspace(0, len(dataset) - 1, _LOOKED_AT)})
    images = [dataset[i].image for i in places]
    found = [bytes_of(image) for image in images if isinstance(image, Path)]
    each = len(dataset) / len(places)
    total = sum(count for count, _ in found)
    missing = sum(count for count, there in found if not there)
    return round(each * total), round(each * missing)


def in_files(dataset: Dataset) -> bool:
    """Tells whether the images of a dataset are files; others are drawn, or in memory."""
    return len(dataset) > 0 and isinstance(dataset[0].image, Path)


def _mapped(file: Path) -> UInt8[np.ndarray, "h w 3"] | None:
    """Gives the pixels in a file, or None if there is none or, after a power failure, only a part of it."""
    try:
        return np.asarray(np.load(file, mmap_mode="r"))
    except FileNotFoundError:
        return None
    except (ValueError, EOFError):
        logger.warning("%s is damaged, and written anew", file)
        return None


def _size(count: int) -> str:
    return f"{count / 1e9:.1f} GB" if count >= 1e9 else f"{count / 1e6:.0f} MB"


__all__ = ["INSTEAD", "PixelCache", "expected", "in_files", "state_of"]
