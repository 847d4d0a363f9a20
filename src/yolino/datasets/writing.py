"""What every format that can be written offers: samples go in one by one."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from types import TracebackType
from typing import ClassVar

import numpy as np

from yolino.image import IMAGE_SUFFIXES
from yolino.io import write_atomic
from yolino.types import Sample


class Writer(ABC):
    """Writes labels, or predictions, into a folder.

    Formats with a file per image write it in `add`, wholly or not at all; formats with one file for all
    write it in `close`. Use it in a `with` statement: what was added before an error is written too.

    Args:
        out: The folder; it is made if need be.
        classes: Names of the classes; a polyline's label is the index.
        directed: Whether the direction of a polyline means something.

    Attributes:
        loses: What the format cannot hold, of `classes`, `scores`, `ignore`, `size`, `vertices`, `order`, ...
    """

    loses: ClassVar[tuple[str, ...]] = ()

    def __init__(self, out: Path, *, classes: Sequence[str] = (), directed: bool = True) -> None:
        self.out, self.classes, self.directed = out, tuple(classes), directed

    @abstractmethod
    def add(self, sample: Sample) -> None:
        """Takes one image. Its `name` is the path of the image below the folder, `size` its size.

        Raises:
            ValueError: The format needs something that the sample lacks, or cannot hold it.
            OSError: The place cannot be written.
        """

    def close(self) -> None:  # noqa: B027 (formats with a file per image have nothing left to do)
        """Writes what is left."""

    def name_of(self, label: int) -> str:
        """Gives the class name of a label: `line` where there are no classes.

        Raises:
            ValueError: There is no such class.
        """
        if not self.classes:
            return "line"
        if not 0 <= label < len(self.classes):
            raise ValueError(f"A polyline has the label {label}, but there are {len(self.classes)} classes.")
        return self.classes[label]

    def __enter__(self) -> Writer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class ImageWriter(Writer):
    """Writes a file for each image, and no file twice.

    Attributes:
        written: The files that were written, with the name of their sample.
    """

    def __init__(self, out: Path, *, classes: Sequence[str] = (), directed: bool = True) -> None:
        super().__init__(out, classes=classes, directed=directed)
        self.written: dict[Path, str] = {}

    def write(self, sample: Sample, file: str, data: str | bytes) -> None:
        """Writes the labels of a sample to a file below the folder.

        Raises:
            ValueError: The file is that of another sample, or lies outside the folder.
        """
        path = Path(os.path.abspath(self.out / file))
        if not path.is_relative_to(os.path.abspath(self.out)):
            raise ValueError(f"{sample.name} leads out of the folder {self.out}: give it a name below it.")
        if path in self.written:
            raise ValueError(
                f"The labels of {sample.name} and {self.written[path]} would both be {path}: rename one."
            )
        write_atomic(path, data)
        self.written[path] = sample.name

    @staticmethod
    def check(sample: Sample) -> None:
        """Raises a ValueError where vertices are not finite, or a polyline has none."""
        if not np.isfinite(sample.polylines.vertices).all():
            raise ValueError(f"{sample.name} has a vertex that is not finite, which cannot be written.")
        if not np.diff(sample.polylines.offsets).all():
            raise ValueError(f"{sample.name} has a polyline without vertices, which cannot be written.")


def without_suffix(image: str) -> str:
    """Gives the name of an image below its folder without `.jpg` or another suffix of images."""
    path = PurePosixPath(image.lstrip("/"))
    return str(path.with_suffix("") if path.suffix.lower() in IMAGE_SUFFIXES else path)


__all__ = ["ImageWriter", "Writer", "without_suffix"]
