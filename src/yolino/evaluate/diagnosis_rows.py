"""Where accuracy is lost along the lines: every row of every label that is wrong has one cause."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike

from yolino.metrics.tusimple import PIXEL_THRESHOLD, Lanes

CAUSES: dict[str, str] = {
    "no_line": "no line there at all",
    "beside_near": "beside the label, in its lower third",
    "beside_middle": "beside the label, in its middle third",
    "beside_far": "beside the label, in its upper third",
    "begins_late": "the line begins above the lower end",
    "begins_early": "the line begins below the lower end",
    "ends_early": "the line ends below the upper end",
    "ends_late": "the line ends above the upper end",
    "gap": "in a gap of the label or of the line",
    "whole_image": "images without labels, or with three lines too many",
}
"""Why a row is wrong; up is away from the camera."""
_NAMES = tuple(CAUSES)


def lost_rows(
    predicted: Lanes, labelled: Lanes, h_samples: ArrayLike
) -> tuple[Float[np.ndarray, "m 10"], Int[np.ndarray, " m"]]:
    """Gives what each label loses of its accuracy for each of `CAUSES`, and the line that it was compared to.

    The losses of a label add up to 1 less its accuracy in the TuSimple benchmark. A label without any right
    row where both it and its best line are has no line (-1).

    Args:
        predicted: Predicted lanes, each the x in pixels for every row, negative where there is none.
        labelled: Labelled lanes in the same form.
        h_samples: The rows.
    """
    rows = np.asarray(h_samples, np.float64)
    truth = np.array(labelled, np.float64).reshape(-1, len(rows))
    found = np.array(predicted, np.float64).reshape(-1, len(rows))
    losses, partners = np.zeros((len(truth), len(_NAMES))), np.full(len(truth), -1)
    for i, label in enumerate(truth):
        near = np.abs(np.where(label >= 0, label, -100) - np.where(found >= 0, found, -100)) < _reach(
            label, rows
        )
        best = int(near.sum(axis=1).argmax()) if len(found) else -1
        if best >= 0 and (near[best] & (label >= 0) & (found[best] >= 0)).any():
            partners[i] = best
            causes = _causes(label, found[best], near[best], rows)
        else:
            wrong = ~near[best] if best >= 0 else np.ones(len(rows), np.bool_)  # also where none is labelled
            causes = np.where(wrong, 0, -1)
        losses[i] = np.bincount(causes[causes >= 0], minlength=len(_NAMES)) / len(rows)
    return losses, partners


def lost_in_image(predicted: Lanes, labelled: Lanes, h_samples: ArrayLike) -> Float[np.ndarray, " c"]:
    """Gives what an image loses for each of `CAUSES`, together 1 less its accuracy in the TuSimple benchmark.

    Of more than four labels the worst is left out; with more than five the benchmark's accuracy has no upper
    bound of 1, and they do not add up. Images without labels, or with at least three lines more than
    labels, have no accuracy at all.

    Args:
        predicted: Predicted lanes, see `lost_rows`.
        labelled: Labelled lanes.
        h_samples: The rows.
    """
    count = len(labelled)
    if count == 0 or len(predicted) > count + 2:
        return np.array([float(name == "whole_image") for name in _NAMES])
    losses, _ = lost_rows(predicted, labelled, h_samples)
    counted = np.argsort(losses.sum(axis=1), kind="stable")[: count - (count > 4)]
    return np.asarray(losses[counted].sum(axis=0) / min(count, 4))


def _reach(label: Float[np.ndarray, " h"], rows: Float[np.ndarray, " h"]) -> float:
    """Gives by how many pixels a column may differ: 20 over the cosine of the angle of the label."""
    there = label >= 0
    if there.sum() < 2:
        return PIXEL_THRESHOLD
    slope = np.polynomial.Polynomial.fit(rows[there], label[there], 1).convert().coef[-1]
    return PIXEL_THRESHOLD / float(np.cos(np.arctan(slope)))


def _causes(
    label: Float[np.ndarray, " h"],
    line: Float[np.ndarray, " h"],
    right: Bool[np.ndarray, " h"],
    rows: Float[np.ndarray, " h"],
) -> Int[np.ndarray, " h"]:
    """Gives the cause of each row, an index of `CAUSES`; -1 where it is right."""
    truth, found = rows[label >= 0], rows[line >= 0]
    part = (rows - truth.min()) / max(float(np.ptp(truth)), 1.0)
    both = (label >= 0) & (line >= 0)
    chosen = [
        (right, -1),
        (both & (part > 2 / 3), "beside_near"),
        (both & (part >= 1 / 3), "beside_middle"),
        (both, "beside_far"),
        ((label >= 0) & (rows > found.max()), "begins_late"),
        ((label >= 0) & (rows < found.min()), "ends_early"),
        ((line >= 0) & (rows > truth.max()), "begins_early"),
        ((line >= 0) & (rows < truth.min()), "ends_late"),
    ]
    indices = [cause if isinstance(cause, int) else _NAMES.index(cause) for _, cause in chosen]
    return np.select([mask for mask, _ in chosen], indices, _NAMES.index("gap")).astype(np.int64)


__all__ = ["CAUSES", "lost_in_image", "lost_rows"]
