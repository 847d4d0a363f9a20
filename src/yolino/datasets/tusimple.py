"""The TuSimple lane benchmark: labels to samples, polylines to its records.

A record is one line of a label or submission file: `{"raw_file": "clips/.../20.jpg", "lanes": [[x, ...],
...], "h_samples": [y, ...]}`. `lanes` holds one x for each row of `h_samples`, -2 where a lane has none.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from yolino.datasets.annotation import Annotation, LabelError
from yolino.datasets.files import FileDataset, Names
from yolino.datasets.tusimple_lanes import (
    CLASSES,
    class_labels,
    polylines_to_record,
    record_to_polylines,
)
from yolino.datasets.tusimple_records import Record, located_records, read_records, write_records
from yolino.datasets.writing import Writer
from yolino.types import Sample


class TuSimpleWriter(Writer):
    """Writes the records of the benchmark: the x of each polyline at the rows of its frames.

    Args:
        out: The folder.
        classes: Names of the classes; written as ids where all are among `CLASSES`.
        directed: Not written: lanes run from bottom to top.
        file: Name of the file.
    """

    loses = ("classes", "directions", "ignored regions", "scores", "sizes", "vertices between the rows")

    def __init__(
        self, out: Path, *, classes: Sequence[str] = (), directed: bool = True, file: str = "label_data.json"
    ) -> None:
        super().__init__(out, classes=classes, directed=directed)
        self._path, self._records = out / file, list[Record]()

    def add(self, sample: Sample) -> None:
        """Takes one image."""
        if sample.size is None:
            raise ValueError(f"The size of {sample.name} is unknown: the benchmark's rows depend on it.")
        rows = benchmark_rows(sample.size[0])
        record = polylines_to_record(
            sample.name, sample.polylines, rows, size=sample.size, classes=self.classes
        )
        self._records.append(record)

    def close(self) -> None:
        """Writes the file."""
        write_records(self._path, self._records)


@dataclass(frozen=True, eq=False)
class _Lanes(Annotation):
    """An annotation with the columns and rows of its record, for the official metric."""

    columns: Float[np.ndarray, "n r"] = field(default_factory=lambda: np.zeros((0, 0)))
    rows: Float[np.ndarray, " r"] = field(default_factory=lambda: np.zeros(0))
    ids: str | None = None


class TuSimple(FileDataset):
    """Frames and lane boundaries of the TuSimple benchmark, in the layout that it publishes.

    Args:
        root: Folder that `raw_file` starts from.
        labels: Label files, absolute or below `root`; None: `label_data*.json` in `root`.
        classes: Whether to use the ids in `classes` (id 1 is the first of `CLASSES`), or which of their names
            to take; otherwise all lanes are of the class `lane`.
        options: The other arguments of `FileDataset`.

    Attributes:
        has_classes: Whether every record names the classes of its lanes.
    """

    patterns = ("label_data*.json",)
    default_class = "lane"
    writer = TuSimpleWriter

    def __init__(
        self,
        root: str | Path,
        labels: Names | None = None,
        *,
        classes: bool | Sequence[str] | Mapping[str, str] | None = None,
        **options: Any,
    ) -> None:
        self._by_class = classes not in (None, False, ["lane"], ("lane",))
        chosen = None if isinstance(classes, bool) else classes
        super().__init__(root, labels, classes=chosen, **options)
        self.has_classes = all(isinstance(one, _Lanes) and one.ids is not None for one in self.annotations)

    def read(self, path: Path) -> Iterator[Annotation | LabelError]:
        """Yields an annotation for each record."""
        for where, record in located_records(path):
            if isinstance(record, LabelError):
                yield record
                continue
            try:
                yield self._annotation(record, where)
            except LabelError as error:
                yield error

    def _annotation(self, record: Record, where: str) -> Annotation:
        count = len(record["lanes"])
        labels = class_labels(record, where) if self._by_class else [0] * count
        names = CLASSES if self._by_class else (self.default_class,)
        lanes = record_to_polylines(record, labels)
        rows = np.array(record["h_samples"], np.float64)
        columns = np.array(record["lanes"], np.float64).reshape(count, len(rows))
        return _Lanes(
            record["raw_file"],
            where,
            tuple(lanes),
            tuple(names[label] for label in lanes.labels),
            columns=columns,
            rows=rows,
            ids=record.get("classes"),
        )

    def found_classes(self) -> tuple[str, ...]:
        """Gives all classes of the benchmark's extension, or the one."""
        return CLASSES if self._by_class else (self.default_class,)

    def record(self, index: int) -> Record:
        """Gives the label record of a sample, for the official metric."""
        one = self.annotations[index]
        assert isinstance(one, _Lanes)
        lanes = [[_number(x) for x in lane] for lane in one.columns.tolist()]
        record = Record(raw_file=one.image, lanes=lanes, h_samples=[_number(y) for y in one.rows.tolist()])
        if one.ids is not None:
            record["classes"] = one.ids
        return record


def _number(value: float) -> int | float:
    return int(value) if value.is_integer() else value


def benchmark_rows(height: int) -> list[int | float]:
    """Gives the rows of the benchmark's frames (160, 170, ... 710), scaled for other heights than 720."""
    return [_number(row * height / 720) for row in range(160, 720, 10)]


__all__ = [
    "CLASSES",
    "Record",
    "TuSimple",
    "TuSimpleWriter",
    "benchmark_rows",
    "polylines_to_record",
    "read_records",
    "record_to_polylines",
    "write_records",
]
