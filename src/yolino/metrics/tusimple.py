"""The official scores of the TuSimple lane benchmark: accuracy, false positives and false negatives.

Written from the definition in the benchmark's public evaluation (Apache-2.0,
github.com/TuSimple/tusimple-benchmark):

- A lane is one x per row of `h_samples`; negative is "none here" and becomes -100, so none agrees with none.
- A predicted x is right if it differs by less than 20 px / cos(angle) from the label, where the angle is that
  of the straight line fitted to the labelled lane (x as a function of y; 0 with less than two points).
- The accuracy of a labelled lane is the part of *all* rows on which the best predicted lane is right; at .85
  it is matched.
- Accuracy is the sum over the labelled lanes, without the worst where there are more than four, over min(4,
  labelled).
- FP is (predicted - matched) / predicted, FN is unmatched / min(4, labelled), with one missed lane forgiven
  where there are more than four. A prediction may match several labels, so FP can be negative. It is in the
  definition.
- More than 200 ms, or more than two lanes above the labelled number: accuracy 0, FP 0, FN 1.
- Images count alike: the scores are means over the images.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike, NDArray

from yolino.metrics.metric import Lines, SumMetric
from yolino.types import Polylines

Lanes = Sequence[ArrayLike] | NDArray[np.float64]

PIXEL_THRESHOLD = 20.0
MATCH_THRESHOLD = 0.85
TIME_LIMIT_MS = 200.0
_NONE = -100.0  # far from every column of an image
_AT_END = 1e-6  # pixels: a row this little beyond the end of a line still meets it


class TuSimpleScore(NamedTuple):
    """Scores of one image.

    Attributes:
        accuracy: Mean accuracy of the labelled lanes.
        fp: Part of the predicted lanes that match no label.
        fn: Part of the labelled lanes that are missed, a fifth lane forgiven.
        fn_strict: Part of all labelled lanes that are missed, none forgiven (not part of the benchmark).
    """

    accuracy: float
    fp: float
    fn: float
    fn_strict: float


def score_image(
    pred_lanes: Lanes,
    gt_lanes: Lanes,
    h_samples: ArrayLike,
    run_time_ms: float = 0.0,
) -> TuSimpleScore:
    """Gives the official scores of one image.

    Args:
        pred_lanes: Predicted lanes, each the x in pixels for every row, negative where there is none.
        gt_lanes: Labelled lanes in the same form.
        h_samples: The rows.
        run_time_ms: Time that the prediction took in milliseconds; beyond 200 it does not count.

    Raises:
        ValueError: There are no rows, a lane has another number of values than there are rows, or a value is
            not finite.
    """
    rows = np.asarray(h_samples, dtype=np.float64)
    if rows.ndim != 1 or len(rows) == 0:
        raise ValueError("h_samples must be a list of at least one row.")
    predicted = _lanes(pred_lanes, len(rows), "predicted")
    labelled = _lanes(gt_lanes, len(rows), "labelled")
    if run_time_ms > TIME_LIMIT_MS or len(predicted) > len(labelled) + 2:
        return TuSimpleScore(0.0, 0.0, 1.0, 1.0)
    best = _lane_accuracies(predicted, labelled, rows)
    missed = int(np.count_nonzero(best < MATCH_THRESHOLD))
    extra = len(labelled) > 4
    lanes = max(min(len(labelled), 4), 1)
    matched = len(labelled) - missed
    return TuSimpleScore(
        accuracy=float(best.sum() - (best.min() if extra else 0.0)) / lanes,
        fp=(len(predicted) - matched) / len(predicted) if len(predicted) else 0.0,
        fn=(missed - (extra and missed > 0)) / lanes,
        fn_strict=missed / max(len(labelled), 1),
    )


def score_files(predictions_path: str | Path, labels_path: str | Path) -> dict[str, float]:
    """Gives the official scores of a submission file: `accuracy`, `fp`, `fn` and the unofficial `fn_strict`.

    Args:
        predictions_path: JSON lines with `raw_file`, `lanes` and `run_time` (milliseconds).
        labels_path: JSON lines with `raw_file`, `lanes` and `h_samples`.

    Raises:
        FileNotFoundError: One of the files does not exist.
        ValueError: A line is no valid record (the message names file and line), an image occurs twice, or the
            two files do not hold the same images.
    """
    labels = _records(Path(labels_path), ("raw_file", "lanes", "h_samples"))
    predictions = _records(Path(predictions_path), ("raw_file", "lanes", "run_time"))
    missing = [name for name in labels if name not in predictions]
    unknown = [name for name in predictions if name not in labels]
    if unknown:
        raise ValueError(
            f"{predictions[unknown[0]][0]} predicts {unknown[0]!r}, which {labels_path} does not label: "
            f"{len(unknown)} too many."
        )
    if missing:
        raise ValueError(
            f"{predictions_path} lacks {len(missing)} of the {len(labels)} images of {labels_path}, "
            f"first {missing[0]!r}: every labelled image needs a line, with empty lanes if nothing was found."
        )
    metric = TuSimpleMetric()
    for name, (where, prediction) in predictions.items():
        label = labels[name][1]
        try:
            metric.update_lanes(
                prediction["lanes"], label["lanes"], label["h_samples"], float(prediction["run_time"])
            )
        except (ValueError, TypeError) as error:
            raise ValueError(f"{where} ({name}), labelled in {labels[name][0]}: {error}") from None
    return metric.compute()


class TuSimpleMetric(SumMetric):
    """The official TuSimple scores over many images: `accuracy`, `fp`, `fn`, and the unofficial `fn_strict`.

    `update_lanes` is the benchmark itself. `update` takes any polylines at rows of its own and serves where
    labels have no rows. A perfect prediction has accuracy 1; an image without labels has accuracy 0 and FN 0
    by definition, and FP 1 if something was predicted (up to two lanes, else FP 0 and FN 1).

    Args:
        h_samples: The pixel rows that `update` compares. None: every 72nd part of the height from 16/72 on,
            at 720 rows the benchmark's 160, 170, ..., 710.
    """

    headline = "accuracy"

    def __init__(self, h_samples: Sequence[float] | None = None) -> None:
        super().__init__()
        self.h_samples = None if h_samples is None else tuple(h_samples)

    def update_lanes(
        self,
        pred_lanes: Lanes,
        gt_lanes: Lanes,
        h_samples: ArrayLike,
        run_time_ms: float = 0.0,
    ) -> None:
        """Adds one image in the form of the benchmark's files; arguments and errors as in `score_image`."""
        self._rows.append(np.array([*score_image(pred_lanes, gt_lanes, h_samples, run_time_ms), 1.0]))

    def update(
        self,
        prediction: Lines,
        truth: Lines,
        size: tuple[int, int],
        ignore: Sequence[Float[np.ndarray, "_ 2"]] = (),
    ) -> None:
        """Adds one image given as polylines in pixels, each compared at the rows that it crosses.

        Raises:
            ValueError: Segments are given, or regions to ignore: the benchmark knows neither.
        """
        if not isinstance(prediction, Polylines) or not isinstance(truth, Polylines):
            raise ValueError("The TuSimple scores compare whole lanes: link the segments to polylines first.")
        if len(ignore):
            raise ValueError(
                "The TuSimple scores know no ignored regions: leave them out, or use the point metric."
            )
        rows = (
            np.arange(16, 72) * size[0] / 72
            if self.h_samples is None
            else np.array(self.h_samples, np.float64)
        )
        self.update_lanes(lanes_at_rows(prediction, rows, size), lanes_at_rows(truth, rows, size), rows)

    def scores(self, sums: Float[np.ndarray, "*b k"]) -> dict[str, Float[np.ndarray, "*b"]]:
        """Gives the mean scores of sums of `rows`."""
        return {
            name: np.asarray(sums[..., i] / sums[..., -1]) for i, name in enumerate(TuSimpleScore._fields)
        }


def lanes_at_rows(
    polylines: Polylines, rows: Float[np.ndarray, " h"], size: tuple[int, int]
) -> Float[np.ndarray, "n h"]:
    """Gives the pixel column of each polyline in each pixel row, -2 where it is not in the image.

    A polyline is followed upwards; its first crossing counts. Polylines that cross no row are left out. A
    pixel's place is its center, half a pixel from the house's continuous coordinates.

    Args:
        polylines: Polylines in pixels.
        rows: Pixel rows.
        size: `(height, width)` of the image.
    """
    lanes = [_columns(vertices, rows + 0.5) for vertices in polylines]
    columns = np.array(lanes).reshape(len(lanes), len(rows))
    there = (columns >= 0) & (columns <= size[1])
    return np.where(there, np.maximum(columns - 0.5, 0.0), -2.0)[there.any(axis=1)]


def _columns(vertices: Float[np.ndarray, "v 2"], y: Float[np.ndarray, " h"]) -> Float[np.ndarray, " h"]:
    """Gives the x of the first crossing with each y from the lower end on, NaN where there is none."""
    if len(vertices) < 2:
        return np.full(len(y), np.nan)
    if vertices[0, 1] < vertices[-1, 1]:
        vertices = vertices[::-1]
    start, end = vertices[:-1], vertices[1:]
    low, high = np.minimum(start[:, 1], end[:, 1]), np.maximum(start[:, 1], end[:, 1])
    crosses = (low - _AT_END <= y[:, None]) & (y[:, None] <= high + _AT_END)
    piece = crosses.argmax(axis=1)
    rise = end[piece, 1] - start[piece, 1]
    along = np.where(rise == 0, 0.0, (y - start[piece, 1]) / np.where(rise == 0, 1.0, rise))
    x = start[piece, 0] + np.clip(along, 0.0, 1.0) * (end[piece, 0] - start[piece, 0])
    return np.where(crosses.any(axis=1), x, np.nan)


def _lanes(lanes: Lanes, rows: int, kind: str) -> Float[np.ndarray, "n h"]:
    """Gives the lanes as one array with -100 where there is none."""
    arrays = [np.asarray(lane, dtype=np.float64) for lane in lanes]
    for i, lane in enumerate(arrays):
        if lane.shape != (rows,):
            raise ValueError(
                f"The {kind} lane {i} has {lane.size} values, but there are {rows} rows in h_samples."
            )
        if not np.isfinite(lane).all():
            raise ValueError(
                f"The {kind} lane {i} has a value that is NaN or infinite: write -2 where there is none."
            )
    x = np.array(arrays).reshape(len(arrays), rows)
    return np.where(x >= 0, x, _NONE)


def _thresholds(lanes: Float[np.ndarray, "n h"], rows: Float[np.ndarray, " h"]) -> Float[np.ndarray, " n"]:
    """Gives 20 px over the cosine of the angle of each lane, from the least-squares slope of x over y."""
    there = lanes >= 0
    count = np.maximum(there.sum(axis=1, keepdims=True), 1)
    y = np.where(there, rows - (there * rows).sum(axis=1, keepdims=True) / count, 0.0)
    x = np.where(there, lanes - np.where(there, lanes, 0.0).sum(axis=1, keepdims=True) / count, 0.0)
    spread = (y * y).sum(axis=1)
    slope = (x * y).sum(axis=1) / np.where(spread > 0, spread, 1.0)
    return np.asarray(PIXEL_THRESHOLD / np.cos(np.arctan(slope)))


def _lane_accuracies(
    predicted: Float[np.ndarray, "n h"], labelled: Float[np.ndarray, "m h"], rows: Float[np.ndarray, " h"]
) -> Float[np.ndarray, " m"]:
    """Gives the accuracy of each labelled lane by its best prediction, 0 without any."""
    thresholds = _thresholds(labelled, rows)[:, None, None]
    right = np.abs(labelled[:, None] - predicted) < thresholds
    return np.asarray((right.sum(axis=2) / len(rows)).max(axis=1, initial=0.0))


def _records(path: Path, keys: tuple[str, ...]) -> dict[str, tuple[str, dict[str, Any]]]:
    """Gives the records of a JSON-lines file by image name, each with the place that it stands at."""
    if not path.is_file():
        raise FileNotFoundError(f"There is no file {path}.")
    records: dict[str, tuple[str, dict[str, Any]]] = {}
    for number, line in enumerate(path.read_bytes().splitlines(), start=1):
        if not line.strip():
            continue
        where = f"{path}, line {number}"
        record = _record(line, keys, where)
        if record["raw_file"] in records:
            raise ValueError(f"{where} repeats {record['raw_file']!r} of {records[record['raw_file']][0]}.")
        records[record["raw_file"]] = (where, record)
    if not records:
        raise ValueError(f"{path} has no records: one JSON object per line is needed.")
    return records


def _record(line: bytes, keys: tuple[str, ...], where: str) -> dict[str, Any]:
    try:
        record = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{where} is not valid JSON: {error}.") from None
    if not isinstance(record, dict) or any(key not in record for key in keys):
        raise ValueError(f"{where} must be a JSON object with {', '.join(keys)}.")
    if not isinstance(record["raw_file"], str):
        raise ValueError(f"{where} has raw_file {record['raw_file']!r}, but the name of an image is needed.")
    if not isinstance(record["lanes"], list) or not all(isinstance(lane, list) for lane in record["lanes"]):
        raise ValueError(f"{where} has lanes that are not a list of lists of x, one for each row.")
    if "run_time" in keys and type(record["run_time"]) not in (int, float):
        raise ValueError(
            f"{where} has run_time {record['run_time']!r}, but a number of milliseconds is needed."
        )
    return record
