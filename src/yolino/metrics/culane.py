"""The official F1 of the CULane lane benchmark: lanes drawn 30 px wide, matched by their overlap.

Written from the rules of the benchmark's public evaluation (github.com/XingangPan/SCNN,
tools/lane_evaluation):

- A lane is a natural cubic spline through its vertices, drawn 30 px wide into an image of 1640 x 590
  (`yolino.metrics.culane_lines`). What lies outside the image is lost.
- Predicted and labelled lanes are paired one to one so that the sum of their IoU is largest.
- A pair with an IoU above (not at) the threshold is a true positive; every other prediction is a false
  positive, every other label a false negative.
- The counts are summed over all images before they are divided.

Where the tool is undefined or depends on the order of the lanes, `docs/metrics/culane.md` says what is done.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import NDArray

from yolino.metrics.culane_lines import drawn_pixels, pixels_inside
from yolino.metrics.metric import Lines, SumMetric
from yolino.types import Polylines

# The thresholds of the mean F1; divided, so that each is the number closest to its decimals.
THRESHOLDS = np.arange(50, 100, 5) / 100
_LARGEST = 1e6  # pixels: what lies farther away is a mistake, and OpenCV's whole numbers have an end
_WIDEST = 32767  # OpenCV's limit


class CULaneMetric(SumMetric):
    """The official CULane `precision`, `recall` and `f1`, and `f1_mean` over the IoU .50, .55, ..., .95.

    Micro-averaged: counts of lanes are summed over the images. A ratio without a denominator is 1 if there is
    neither prediction nor ground truth, else 0. Use one metric per scene category.

    A segment is a lane of two vertices. A lane with less than two vertices overlaps with nothing, but counts.

    Args:
        iou: The IoU that a pair must exceed.
        width: Width of the drawn lanes in pixels of the drawing, a whole number.
        size: `(height, width)` of the drawing. Lanes of an image of another size are scaled to it, each axis
            on its own. None: every image has a drawing of its own size.

    Raises:
        ValueError: An argument is out of its range.
    """

    headline = "f1"

    def __init__(
        self,
        *,
        iou: float = 0.5,
        width: float | int = 30,
        size: tuple[int, int] | None = (590, 1640),
    ) -> None:
        super().__init__()
        if not 0 < iou < 1:
            raise ValueError(f"iou must be above 0 and below 1, got {iou}.")
        if not (1 <= width <= _WIDEST and width == int(width)):
            raise ValueError(f"width must be a whole number of pixels from 1 to {_WIDEST}, got {width}.")
        if size is not None:
            _check_size(size)
        self.iou = iou
        self.width = int(width)
        self.size = size

    def update(
        self,
        prediction: Lines,
        truth: Lines,
        size: tuple[int, int],
        ignore: Sequence[Float[np.ndarray, "_ 2"]] = (),
    ) -> None:
        """Adds one image.

        Args:
            prediction: Predicted lanes in pixels of the image.
            truth: Labelled lanes in pixels of the image.
            size: `(height, width)` of the image.
            ignore: Polygons in pixels of the image (even-odd rule). The drawn pixels whose centers lie inside
                are removed on both sides, and so are lanes of which nothing is left. The benchmark has none.

        Raises:
            ValueError: A coordinate is not finite or more than a million pixels away, a polygon has less than
                three corners, or `size` is not positive.
        """
        _check_size(size)
        for side, lines in (("prediction", prediction), ("truth", truth)):
            _check_points(
                lines.vertices if isinstance(lines, Polylines) else lines.endpoints, f"The {side} has a line"
            )
        for polygon in ignore:
            if len(polygon) < 3:
                raise ValueError(f"An ignored polygon needs at least 3 corners (x, y), got {polygon!r}.")
            _check_points(np.asarray(polygon), "There is an ignored polygon")
        drawing = self.size or size
        ignored = (
            pixels_inside([_to_drawing(p, size, drawing) for p in ignore], drawing) if len(ignore) else None
        )
        found, wanted = (self._draw(lines, size, drawing, ignored) for lines in (prediction, truth))
        pairs = _best_pairs(_ious(found, wanted, drawing))
        true_positives = np.array([np.count_nonzero(pairs > limit) for limit in (self.iou, *THRESHOLDS)])
        counts = [true_positives, len(found) - true_positives, len(wanted) - true_positives]
        self._rows.append(np.stack(counts, axis=1).ravel().astype(np.float64))

    def counts(self) -> dict[str, int]:
        """Gives the true positives `tp`, false positives `fp` and false negatives `fn` at `iou`, in lanes.

        Raises:
            ValueError: There is no image yet.
        """
        sums = self.rows[:, :3].sum(axis=0)
        return {name: int(count) for name, count in zip(("tp", "fp", "fn"), sums, strict=True)}

    def scores(self, sums: Float[np.ndarray, "*b k"]) -> dict[str, Float[np.ndarray, "*b"]]:
        """Gives `precision`, `recall`, `f1` and `f1_mean` of sums of `rows`."""
        counts = sums.reshape(*sums.shape[:-1], 1 + len(THRESHOLDS), 3)
        tp, fp, fn = counts[..., 0], counts[..., 1], counts[..., 2]
        f1 = _ratio(2 * tp, 2 * tp + fp + fn, fp + fn == 0)
        return {
            "precision": _ratio(tp, tp + fp, fn == 0)[..., 0],
            "recall": _ratio(tp, tp + fn, fp == 0)[..., 0],
            "f1": f1[..., 0],
            "f1_mean": np.asarray(f1[..., 1:].mean(axis=-1)),
        }

    def _draw(
        self,
        lines: Lines,
        size: tuple[int, int],
        drawing: tuple[int, int],
        ignored: Bool[np.ndarray, " k"] | None,
    ) -> list[Int[np.ndarray, " _"]]:
        """Gives the pixels of each lane without the ignored ones, sorted."""
        places = lines if isinstance(lines, Polylines) else lines.endpoints
        strokes = [drawn_pixels(_to_drawing(place, size, drawing), drawing, self.width) for place in places]
        if ignored is not None:
            rest = [stroke[~ignored[stroke]] for stroke in strokes]
            strokes = [
                left for left, stroke in zip(rest, strokes, strict=True) if len(left) or not len(stroke)
            ]
        # Equally good pairings can differ in their counts; the order of the lanes must not choose one.
        return sorted(strokes, key=np.ndarray.tobytes)


def _ious(
    found: Sequence[Int[np.ndarray, " _"]], wanted: Sequence[Int[np.ndarray, " _"]], size: tuple[int, int]
) -> Float[np.ndarray, "n m"]:
    """Gives the intersection over union of each predicted and each labelled set of pixels, 0 if empty."""
    ious = np.zeros((len(found), len(wanted)))
    covered = np.zeros(size[0] * size[1], np.bool_)
    for i, stroke in enumerate(found):
        covered[stroke] = True
        for j, other in enumerate(wanted):
            common = int(np.count_nonzero(covered[other]))
            ious[i, j] = common / max(len(stroke) + len(other) - common, 1)
        covered[stroke] = False
    return ious


def _best_pairs(ious: Float[np.ndarray, "n m"]) -> Float[np.ndarray, " k"]:
    """Gives the IoU of each pair of the one-to-one pairing whose sum is largest."""
    from scipy.optimize import linear_sum_assignment  # takes half a second, which a detector need not wait

    found, wanted = linear_sum_assignment(ious, maximize=True)
    return np.asarray(ious[found, wanted])


def _ratio(
    part: NDArray[np.float64], whole: NDArray[np.float64], nothing: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Gives `part / whole`; without a whole, 1 where there is `nothing` on the other side either, else 0."""
    return np.where(whole > 0, part / np.where(whole > 0, whole, 1.0), nothing.astype(np.float64))


def _to_drawing(
    points: Float[np.ndarray, "v 2"], size: tuple[int, int], drawing: tuple[int, int]
) -> Float[np.ndarray, "v 2"]:
    """Gives the points in the drawing, in OpenCV's coordinates: the center of the first pixel is (0, 0)."""
    return np.asarray(points * np.array([drawing[1] / size[1], drawing[0] / size[0]]) - 0.5)


def _check_size(size: tuple[int, int]) -> None:
    if min(size) <= 0:
        raise ValueError(f"size must be a positive (height, width), got {size}.")


def _check_points(points: NDArray[np.float64], what: str) -> None:
    if not np.abs(points).max(initial=0.0) <= _LARGEST:
        raise ValueError(
            f"{what} with a coordinate that is NaN, infinite or more than a million pixels away: remove or "
            "repair it first."
        )


__all__ = ["THRESHOLDS", "CULaneMetric"]
