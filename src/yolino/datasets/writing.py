"""What every format that can be written offers: samples go in one by one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import ClassVar

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
        """Gives the class name of a label: `line` where there are no classes."""
        return self.classes[label] if self.classes else "line"

    def __enter__(self) -> Writer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


__all__ = ["Writer"]
