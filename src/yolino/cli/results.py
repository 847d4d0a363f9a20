"""What `yolino predict` does with each image: read, predict, write."""

from __future__ import annotations

import time
from pathlib import Path
from statistics import median
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt8

from yolino.cli.views import find_view
from yolino.datasets import WRITERS, Writer
from yolino.datasets.convert import holds_labels
from yolino.datasets.tusimple import Record, benchmark_rows, polylines_to_record, write_records
from yolino.inference import Predictor, Stages
from yolino.io import FORMATS, Result, read_image, write_atomic, write_image
from yolino.types import Sample

TUSIMPLE = "tusimple"
SUBMISSION = "predictions.json"


class Found(NamedTuple):
    """What one image gave, and how long the predictor took for it."""

    name: str
    path: Path
    result: Result
    milliseconds: float


class ResultWriter:
    """Writes the results of images into a folder, each file wholly or not at all.

    Args:
        out: The folder.
        format: A name in `FORMATS`: a file for each image; "tusimple": one file of JSON lines for all; or the
            name of another format of labels, for a person to correct.
        pictures: Whether to write a picture of each image.
        view: What it shows: a name in `yolino.cli.views.VIEWS`.

    Raises:
        ValueError: If the format or the view is unknown.
    """

    def __init__(self, out: Path, format: str, *, pictures: bool, view: str = "lines") -> None:
        known = [*FORMATS, TUSIMPLE, *(name for name in WRITERS if name not in (*FORMATS, TUSIMPLE))]
        if format not in known:
            raise ValueError(f"The format {format!r} is unknown; use one of {', '.join(known)}.")
        if out.exists() and not out.is_dir():
            raise ValueError(f"--out {out} is a file, but a folder is needed: give another name.")
        if format not in (*FORMATS, TUSIMPLE) and holds_labels(out):
            raise ValueError(
                f"--out {out} holds labels already, which would be replaced: choose another folder."
            )
        self.out, self.format, self.pictures = out, format, pictures
        self._draw = find_view(view)
        self._labels: Writer | None = None

    def refuse_overwriting(self, images: list[Path], names: list[str]) -> None:
        """Raises ValueError if a result would replace one of the images."""
        originals = {path.resolve() for path in images}
        for name in names if self.pictures else ():
            if self._picture(name).resolve() in originals:
                raise ValueError(
                    f"The picture {self._picture(name)} would replace a source image; "
                    "choose another --out, or --no-images."
                )

    def write(
        self,
        predictor: Predictor,
        name: str,
        image: UInt8[np.ndarray, "h w 3"],
        stages: Stages,
        result: Result,
    ) -> None:
        """Writes the files of one image."""
        if self.format in FORMATS:
            write_atomic(self.out / f"{name}.{self.format}", FORMATS[self.format](result))
        elif self.format != TUSIMPLE:
            if self._labels is None:
                directed = predictor.header.directed
                self._labels = WRITERS[self.format](self.out, classes=result.classes, directed=directed)
            self._labels.add(_as_sample(name, result))
        if self.pictures:
            write_image(self._picture(name), self._draw(image, stages, predictor))

    def finish(self, found: list[Found]) -> None:
        """Writes the file of all images, where the format has one."""
        if self._labels is not None:
            self._labels.close()
        if self.format == TUSIMPLE:
            write_records(self.out / SUBMISSION, [_submission(one) for one in found])

    def _picture(self, name: str) -> Path:
        return self.out / f"{name}.png"


def predict_one(predictor: Predictor, path: Path, name: str, writer: ResultWriter) -> Found:
    """Reads one image, predicts it and writes its results.

    Raises:
        UnreadableError: If the image cannot be read; what else goes wrong concerns more than this image.
    """
    try:
        image = read_image(path)
    except (ValueError, OSError, MemoryError) as error:
        raise UnreadableError(
            " ".join(str(error).split()) or f"{path} is too large for the memory."
        ) from error
    start = time.perf_counter()
    stages = predictor.stages(image)
    milliseconds = (time.perf_counter() - start) * 1e3
    size = (image.shape[0], image.shape[1])
    header = predictor.header
    result = Result(path.as_posix(), size, stages.polylines, header.classes, header.name)
    writer.write(predictor, name, image, stages, result)
    return Found(name, path, result, milliseconds)


class UnreadableError(ValueError):
    """One image cannot be read; the others can."""


def rows(found: list[Found]) -> list[tuple[str, int, str]]:
    """Gives the rows of the table: image, polylines, milliseconds."""
    shown = []
    for one in found:
        suffix = "" if one.name.endswith(one.path.suffix) else one.path.suffix
        shown.append((one.name + suffix, len(one.result.polylines), f"{one.milliseconds:.1f}"))
    return shown


def summary(found: list[Found], out: Path) -> str:
    """Gives the line below the table."""
    count = sum(len(one.result.polylines) for one in found)
    images = f"{len(found)} image{'s' * (len(found) != 1)}"
    lines = f"{count} polyline{'s' * (count != 1)}"
    return f"{images}, {lines}, {median(one.milliseconds for one in found):.1f} ms per image -> {out}"


def _as_sample(name: str, result: Result) -> Sample:
    """Gives the result as labels of the image, which is called like its result."""
    path = Path(result.image)
    named = name if name.endswith(path.suffix) else name + path.suffix
    return Sample(named, path, result.polylines, (), result.size)


def _submission(found: Found) -> Record:
    """Gives the submission record; the rows are the benchmark's, scaled for other heights than 720."""
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


__all__ = ["Found", "ResultWriter", "UnreadableError", "predict_one", "rows", "summary"]
