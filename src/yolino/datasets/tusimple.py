"""The TuSimple lane benchmark: labels to samples, polylines to its submission records.

A record is one line of a label or submission file: `{"raw_file": "clips/.../20.jpg", "lanes": [[x, ...],
...], "h_samples": [y, ...]}`. `lanes` holds one x for each row of `h_samples`, -2 where a lane has none.
These numbers count pixels: x = 3 at row 7 is the fourth pixel of the eighth row, and its center is the
point (3.5, 7.5) of the house's frame. So reading adds half a pixel to both coordinates, and writing takes
it off again.

Rows run from top to bottom in the files; polylines run from bottom to top, the driving direction. Rows
without x inside a lane are bridged: the polyline runs straight through the gap.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from yolino.datasets.tusimple_records import Record, located_records, read_records, write_records
from yolino.geometry import cumulative_length
from yolino.types import Polylines, Sample

CLASSES = (
    "continuous yellow",
    "continuous white",
    "dashed",
    "double dashed",
    "Botts' dots",
    "double continuous yellow",
    "unknown",
)
NONE = -2
_HALF = 0.5


class TuSimple:
    """Frames and lane boundaries of the TuSimple benchmark, in the layout that it publishes.

    Attributes:
        records: The label records in the order of the files, for the official metric.
        classes: Names of the labels.
        directed: True: lanes run in driving direction.
    """

    directed = True

    def __init__(
        self,
        root: str | Path,
        labels: str | Path | Sequence[str | Path] | None = None,
        *,
        classes: bool = False,
        require_images: bool = True,
    ) -> None:
        """Reads the labels.

        Args:
            root: Folder that `raw_file` starts from.
            labels: Label files, absolute or below `root`; without any, `label_data_*.json` in `root`.
            classes: Whether to use the ids in `classes` (id 1 is label 0); otherwise all lanes are label 0.
            require_images: Whether to raise where an image is missing.

        Raises:
            FileNotFoundError: The root, a label file or an image does not exist.
            ValueError: A label file is empty or has a line that is no valid record; the message names both.
        """
        self.root = Path(root)
        self.classes: tuple[str, ...] = CLASSES if classes else ("lane",)
        self.records: list[Record] = []
        self._labels: list[list[int]] = []
        for path in _label_files(self.root, labels):
            for where, record in located_records(path):
                lane_labels = _class_labels(record, where) if classes else [0] * len(record["lanes"])
                if require_images and not (self.root / record["raw_file"]).is_file():
                    raise FileNotFoundError(
                        f"{where} names the image {self.root / record['raw_file']}, which does not exist."
                    )
                self.records.append(record)
                self._labels.append(lane_labels)

    def __len__(self) -> int:
        return len(self.records)

    def __getitem__(self, index: int) -> Sample:
        record = self.records[index]
        polylines = record_to_polylines(record, self._labels[index])
        return Sample(record["raw_file"], self.root / record["raw_file"], polylines)

    def __iter__(self) -> Iterator[Sample]:
        return (self[i] for i in range(len(self)))


def record_to_polylines(record: Record, labels: Sequence[int] | None = None) -> Polylines:
    """Gives the lanes of a record in image pixels, bottom to top; lanes without any x are left out.

    A negative x is none, as in the official evaluation.

    Args:
        record: A valid record.
        labels: Label of each lane of the record; 0 without.
    """
    rows = np.asarray(record["h_samples"], np.float64)
    upwards = np.argsort(-rows, kind="stable")
    lines, chosen = [], []
    for i, lane in enumerate(record["lanes"]):
        x = np.asarray(lane, np.float64)[upwards]
        there = x >= 0
        if there.any():
            lines.append(np.stack([x[there], rows[upwards][there]], axis=1) + _HALF)
            chosen.append(0 if labels is None else labels[i])
    return Polylines.from_list(lines, labels=chosen)


def polylines_to_record(
    raw_file: str,
    polylines: Polylines,
    h_samples: Sequence[int | float],
    *,
    size: tuple[int, int] = (720, 1280),
    run_time: float = 0.0,
    extend_px: float = 0.0,
) -> Record:
    """Gives the record of the polylines of one image: their x at the center of each row of `h_samples`.

    A polyline is walked from its lower end. Where it crosses a row several times, the first crossing
    counts. A row that it does not cross has none, and so has one where it lies outside the image. Polylines
    without any x are left out.

    Args:
        raw_file: Name of the image below the root.
        polylines: Polylines in pixels of the original image.
        h_samples: The rows, as in the label file.
        size: `(height, width)` of the image in pixels.
        run_time: Time to find the polylines, in milliseconds.
        extend_px: Length by which both ends are continued straight on, in pixels.

    Raises:
        ValueError: A vertex is NaN or infinite.
    """
    if not np.isfinite(polylines.vertices).all():
        raise ValueError(f"a polyline of {raw_file} has a vertex that is not finite: remove it.")
    rows = np.asarray(h_samples, np.float64)
    lanes = []
    for vertices in polylines:
        if len(vertices) == 0:
            continue
        upwards = vertices if vertices[0, 1] >= vertices[-1, 1] else vertices[::-1]
        columns = _crossings(_extend(upwards, extend_px), rows + _HALF) - _HALF
        inside = (columns >= -_HALF) & (columns <= size[1] - _HALF)
        if inside.any():
            # The first half pixel of a row would be negative, which the benchmark takes for none.
            lanes.append(np.where(inside, np.maximum(columns, 0.0), NONE).round(3).tolist())
    return Record(raw_file=raw_file, lanes=lanes, h_samples=list(h_samples), run_time=float(run_time))


def _extend(vertices: Float[np.ndarray, "v 2"], length: float) -> Float[np.ndarray, "w 2"]:
    """Gives the polyline with both ends continued straight on by `length` pixels."""
    if length <= 0 or cumulative_length(vertices)[-1] == 0:
        return vertices
    moved = np.append(True, (np.diff(vertices, axis=0) != 0).any(axis=1))
    vertices = vertices[moved]
    out = vertices[[0, -1]] - vertices[[1, -2]]
    ends = vertices[[0, -1]] + out * (length / np.hypot(out[:, :1], out[:, 1:]))
    return np.concatenate([ends[:1], vertices, ends[1:]])


def _crossings(vertices: Float[np.ndarray, "v 2"], rows: Float[np.ndarray, " r"]) -> Float[np.ndarray, " r"]:
    """Gives the x where the polyline first crosses each row (y in pixels), NaN where it does not."""
    if len(vertices) == 1:
        vertices = np.repeat(vertices, 2, axis=0)
    start, end = vertices[:-1], vertices[1:]
    low, high = np.minimum(start[:, 1], end[:, 1]), np.maximum(start[:, 1], end[:, 1])
    crosses = (low[:, None] <= rows) & (rows <= high[:, None])
    first = crosses.argmax(axis=0)
    rise = (end - start)[first, 1]
    t = np.where(rise == 0, 0.0, (rows - start[first, 1]) / np.where(rise == 0, 1.0, rise))
    # Weighted so that both ends of a piece are met exactly: reading and writing labels is the identity.
    x = start[first, 0] * (1 - t) + end[first, 0] * t
    return np.where(crosses.any(axis=0), x, np.nan)


def _label_files(root: Path, labels: str | Path | Sequence[str | Path] | None) -> list[Path]:
    if not root.is_dir():
        raise FileNotFoundError(f"There is no folder {root}: give the folder of the label files.")
    if labels is None:
        found = sorted(root.glob("label_data_*.json"))
        if not found:
            raise FileNotFoundError(f"There is no label_data_*.json in {root}: name the label files.")
        return found
    names = [labels] if isinstance(labels, str | Path) else labels
    if not names:
        raise ValueError("The list of label files is empty: name one, or give None for label_data_*.json.")
    return [Path(name) if Path(name).is_file() else root / name for name in names]


def _class_labels(record: Record, where: str) -> list[int]:
    if "classes" not in record:
        raise ValueError(f"{where} has no classes: use labels extended with them, or read without classes.")
    ids = str(record["classes"]).split()
    if len(ids) != len(record["lanes"]):
        raise ValueError(f"{where} has {len(ids)} classes for {len(record['lanes'])} lanes.")
    wrong = [i for i in ids if not i.isdecimal() or not 1 <= int(i) <= len(CLASSES)]
    if wrong:
        raise ValueError(f"{where} has the class {wrong[0]!r}, but 1 to {len(CLASSES)} are allowed.")
    return [int(i) - 1 for i in ids]


__all__ = [
    "CLASSES",
    "Record",
    "TuSimple",
    "polylines_to_record",
    "read_records",
    "record_to_polylines",
    "write_records",
]
