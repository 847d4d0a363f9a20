"""What `yolino predict` does with each image: read, predict, write."""

from __future__ import annotations

import contextlib
import json
import time
from array import array
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

import numpy as np
from jaxtyping import UInt8

from yolino.cli.sources import real_path
from yolino.cli.views import find_view
from yolino.inference import Predictor, Stages
from yolino.inference.stream import explain
from yolino.io import FORMATS, Result, open_atomic, read_image, write_atomic, write_image
from yolino.types import Sample

if TYPE_CHECKING:  # the formats of labels are imported when one is asked for
    from yolino.datasets import Writer
    from yolino.datasets.tusimple import Record

TUSIMPLE = "tusimple"
SUBMISSION = "predictions.json"


class Found(NamedTuple):
    """What one image gave, and how long the predictor took for it."""

    name: str
    path: Path
    result: Result
    milliseconds: float


class Tally:
    """What is told at the end: the first rows of the table, and sums over all images.

    Args:
        shown: How many rows are kept.
    """

    def __init__(self, shown: int) -> None:
        self.rows: list[tuple[str, int, str]] = []
        self.images = self._polylines = 0
        self._shown, self._milliseconds = shown, array("d")

    def add(self, one: Found) -> None:
        """Adds an image."""
        self.images += 1
        self._polylines += len(one.result.polylines)
        self._milliseconds.append(one.milliseconds)
        if len(self.rows) < self._shown:
            suffix = "" if one.name.endswith(one.path.suffix) else one.path.suffix
            self.rows.append((one.name + suffix, len(one.result.polylines), f"{one.milliseconds:.1f}"))

    def summary(self, out: Path, seconds: float, before: str = "") -> str:
        """Gives the line below the table.

        Args:
            out: Folder of the results.
            seconds: How long all images took together, end to end.
            before: What came before and is not in `seconds`, such as "after 35 s of compiling".
        """
        parts = [
            f"{self.images} image{'s' * (self.images != 1)}",
            f"{self._polylines} polyline{'s' * (self._polylines != 1)}",
        ]
        if self.images > 1:
            parts.append(f"{self.images / max(seconds, 1e-9):.1f} images per second {before}".rstrip())
        return f"{', '.join(parts)}, {median(self._milliseconds):.1f} ms per image -> {out}"


class ResultWriter:
    """Writes the results of images into a folder, each file wholly or not at all.

    Args:
        out: The folder.
        format: A name in `FORMATS`: a file for each image; "tusimple": one file of JSON lines for all; or the
            name of another format of labels, for a person to correct.
        pictures: Whether to write a picture of each image.
        view: What it shows: a name in `yolino.cli.views.VIEWS`.

    Attributes:
        directed: Whether the lines have a direction, for labels; the model's.

    Raises:
        ValueError: If the format or the view is unknown.
    """

    def __init__(self, out: Path, format: str, *, pictures: bool, view: str = "lines") -> None:
        if format not in (own := (*FORMATS, TUSIMPLE)):
            _check_labels(format, out, own)
        if out.exists() and not out.is_dir():
            raise ValueError(f"--out {out} is a file, but a folder is needed: give another name.")
        self.out, self.format, self.pictures = out, format, pictures
        self._draw = find_view(view)
        self.directed = True
        self._labels: Writer | None = None
        self._lines: BinaryIO | None = None
        self._files = contextlib.ExitStack()

    def refuse_overwriting(self, images: list[Path], names: list[str]) -> None:
        """Raises ValueError if a result would replace one of the images."""
        if not self.pictures:
            return
        folders: dict[Path, str] = {}
        originals = {real_path(path, folders) for path in images}
        for name in names:
            if real_path(self._picture(name), folders) in originals:
                raise ValueError(
                    f"The picture {self._picture(name)} would replace a source image; "
                    "choose another --out, or --no-images."
                )

    def write(
        self,
        predictor: Predictor,
        name: str,
        image: UInt8[np.ndarray, "h w 3"],
        stages: Stages | None,
        result: Result,
    ) -> None:
        """Writes the files that an image has of its own; threads may do so at once.

        Args:
            predictor: What predicted it.
            name: Name for its files.
            image: Its pixels.
            stages: For the picture; None if none is wanted.
            result: What was found.
        """
        if self.format in FORMATS:
            write_atomic(self.out / f"{name}.{self.format}", FORMATS[self.format](result))
        if stages is not None:
            write_image(self._picture(name), self._draw(image, stages, predictor))

    def add(self, one: Found) -> None:
        """Adds an image to the file of all images, where the format has one; one after the other."""
        if self.format == TUSIMPLE:
            if self._lines is None:
                self._lines = self._files.enter_context(open_atomic(self.out / SUBMISSION))
            self._lines.write((json.dumps(_submission(one)) + "\n").encode())
        elif self.format not in FORMATS:
            if self._labels is None:
                from yolino.datasets import WRITERS

                writer = WRITERS[self.format]
                self._labels = writer(self.out, classes=one.result.classes, directed=self.directed)
            self._labels.add(_as_sample(one.name, one.result))

    def finish(self) -> None:
        """Ends the file of all images, where the format has one."""
        if self._labels is not None:
            self._labels.close()
        self._files.close()

    def _picture(self, name: str) -> Path:
        return self.out / f"{name}.png"


def predict_one(predictor: Predictor, path: Path, name: str, writer: ResultWriter) -> Found:
    """Reads one image, predicts it and writes its own files; threads may do so at once.

    Raises:
        UnreadableError: If the image cannot be read; what else goes wrong concerns more than this image.
    """
    try:
        image = read_image(path)
    except (ValueError, OSError, MemoryError) as error:
        raise UnreadableError(explain(error, path)) from error
    start = time.perf_counter()
    stages = predictor.stages(image) if writer.pictures else None
    polylines = predictor(image) if stages is None else stages.polylines
    milliseconds = (time.perf_counter() - start) * 1e3
    size = (image.shape[0], image.shape[1])
    header = predictor.header
    result = Result(path.as_posix(), size, polylines, header.classes, header.name)
    writer.write(predictor, name, image, stages, result)
    return Found(name, path, result, milliseconds)


class UnreadableError(ValueError):
    """One image cannot be read; the others can."""


def _check_labels(format: str, out: Path, others: tuple[str, ...]) -> None:
    """Raises ValueError unless `format` is one of labels and the folder holds none."""
    from yolino.datasets import WRITERS
    from yolino.datasets.convert import holds_labels

    if format not in WRITERS:
        known = [*others, *(name for name in WRITERS if name not in others)]
        raise ValueError(f"The format {format!r} is unknown; use one of {', '.join(known)}.")
    if holds_labels(out):
        raise ValueError(f"--out {out} holds labels already, which would be replaced: choose another folder.")


def _as_sample(name: str, result: Result) -> Sample:
    """Gives the result as labels of the image, which is called like its result."""
    path = Path(result.image)
    named = name if name.endswith(path.suffix) else name + path.suffix
    return Sample(named, path, result.polylines, (), result.size)


def _submission(found: Found) -> Record:
    """Gives the submission record; the rows are the benchmark's, scaled for other heights than 720."""
    from yolino.datasets.tusimple import benchmark_rows, polylines_to_record

    height = found.result.size[0]
    return polylines_to_record(
        _raw_file(found.path),
        found.result.polylines,
        benchmark_rows(height),
        size=found.result.size,
        run_time=round(found.milliseconds, 3),
    )


def _raw_file(path: Path) -> str:
    """Gives the name that the benchmark uses: from the folder `clips` on, if there is one."""
    parts = path.parts
    start = len(parts) - 1 - parts[::-1].index("clips") if "clips" in parts else 0
    return Path(*parts[start:]).as_posix()


__all__ = ["Found", "ResultWriter", "Tally", "UnreadableError", "predict_one"]
