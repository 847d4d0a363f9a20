"""One record of the TuSimple benchmark to polylines and back.

The numbers of a record count pixels: x = 3 at row 7 is the fourth pixel of the eighth row, and its center is
the point (3.5, 7.5) of the house's frame. So reading adds half a pixel to both coordinates, and writing takes
it off again.

Rows run from top to bottom in the files; polylines run from bottom to top, the driving direction. Rows
without x inside a lane are bridged: the polyline runs straight through the gap.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from yolino.datasets.annotation import LabelError
from yolino.datasets.tusimple_records import Record
from yolino.geometry import cumulative_length
from yolino.types import Polylines

CLASSES = (
    "continuous yellow",
    "continuous white",
    "dashed",
    "double dashed",
    "Botts' dots",
    "double continuous yellow",
    "unknown",
)
"""Names of the ids 1 to 7 that fabvio/TuSimple-lane-classes adds to the labels."""
NONE = -2
_HALF = 0.5


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
    classes: Sequence[str] = (),
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
        classes: Names of the labels; where all are among `CLASSES`, the record gets their ids.
        extend_px: Length by which both ends are continued straight on, in pixels.

    Raises:
        ValueError: A vertex is NaN or infinite.
    """
    if not np.isfinite(polylines.vertices).all():
        raise ValueError(f"a polyline of {raw_file} has a vertex that is not finite: remove it.")
    rows = np.asarray(h_samples, np.float64)
    named = len(classes) > 0 and set(classes) <= set(CLASSES)
    lanes, ids = [], []
    for vertices, label in zip(polylines, polylines.labels, strict=True):
        if len(vertices) == 0:
            continue
        upwards = vertices if vertices[0, 1] >= vertices[-1, 1] else vertices[::-1]
        columns = _crossings(_extend(upwards, extend_px), rows + _HALF) - _HALF
        inside = (columns >= -_HALF) & (columns <= size[1] - _HALF)
        if inside.any():
            # The first half pixel of a row would be negative, which the benchmark takes for none.
            lanes.append(np.where(inside, np.maximum(columns, 0.0), NONE).round(3).tolist())
            ids.append(str(CLASSES.index(classes[label]) + 1) if named else "")
    record = Record(raw_file=raw_file, lanes=lanes, h_samples=list(h_samples), run_time=float(run_time))
    if named:
        record["classes"] = " ".join(ids)
    return record


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


def class_labels(record: Record, where: str) -> list[int]:
    """Gives the label of each lane of a record: its id less one.

    Raises:
        LabelError: The record has no ids, or wrong ones.
    """
    if "classes" not in record:
        raise LabelError(where, "has no classes, use labels extended with them, or read without classes")
    ids = str(record["classes"]).split()
    if len(ids) != len(record["lanes"]):
        raise LabelError(where, f"has {len(ids)} classes for {len(record['lanes'])} lanes")
    wrong = [i for i in ids if not i.isdecimal() or not 1 <= int(i) <= len(CLASSES)]
    if wrong:
        raise LabelError(where, f"has the class {wrong[0]!r}, but 1 to {len(CLASSES)} are allowed")
    return [int(i) - 1 for i in ids]


__all__ = ["CLASSES", "NONE", "class_labels", "polylines_to_record", "record_to_polylines"]
