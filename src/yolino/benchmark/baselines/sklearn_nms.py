"""The NMS of `yolino.postprocess.NMS` (defaults, directed, no classes) on numpy and scikit-learn."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from sklearn.cluster import DBSCAN

from yolino.types import Segments

_EPSILON, _MIN_SAMPLES, _POWER = 0.02, 2, 10
_MIDPOINT, _LENGTH, _DIRECTION = 0.1, 0.013, 0.05


def nms_with_sklearn(segments: Segments, cell_size: float) -> Segments:
    """Gives the merged segments: coordinates, `DBSCAN`, then weighted means of all clusters at once."""
    measures = _measure(segments)
    slots = _slots(measures, sklearn_clusters(segments, cell_size), segments.scores)
    count = int(slots.max()) + 1
    peaks = np.zeros(count)
    np.maximum.at(peaks, slots, segments.scores)
    weights = (segments.scores / peaks[slots]) ** _POWER
    totals = np.bincount(slots, weights)
    means = np.stack([np.bincount(slots, weights * column) / totals for column in measures.T], axis=1)
    ways = means[:, 3:] / np.hypot(means[:, 3], means[:, 4])[:, None] * means[:, 2:3] / 2
    endpoints = np.stack([means[:, :2] - ways, means[:, :2] + ways], axis=1)
    return Segments(endpoints, peaks)


def sklearn_clusters(segments: Segments, cell_size: float) -> Int[np.ndarray, " n"]:
    """Gives the cluster of each segment, -1 for none."""
    scales = np.array([_MIDPOINT / cell_size] * 2 + [_LENGTH / cell_size, _DIRECTION, _DIRECTION])
    clustering = DBSCAN(eps=_EPSILON, min_samples=_MIN_SAMPLES)
    return np.asarray(clustering.fit_predict(_measure(segments) * scales))


def _measure(segments: Segments) -> Float[np.ndarray, "n 5"]:
    """Gives midpoint, length and unit direction."""
    delta = segments.endpoints[:, 1] - segments.endpoints[:, 0]
    lengths = np.hypot(delta[:, 0], delta[:, 1])
    return np.column_stack([segments.midpoints, lengths, delta / lengths[:, None]])


def _slots(
    measures: Float[np.ndarray, "n 5"], clusters: Int[np.ndarray, " n"], scores: Float[np.ndarray, " n"]
) -> Int[np.ndarray, " n"]:
    """Gives the merged segment of each: one per cluster and direction, one for each that is in no cluster."""
    n, inside = len(clusters), clusters >= 0
    by_score = np.argsort(-scores, kind="stable")
    best = np.zeros(int(clusters.max(initial=-1)) + 2, np.int64)
    best[clusters[by_score[::-1]]] = by_score[::-1]
    against = (measures[:, 3:] * measures[best[clusters], 3:]).sum(axis=1) < 0
    keys = np.where(inside, 2 * clusters + against, 2 * n + np.arange(n))
    _, first, index = np.unique(keys, return_index=True, return_inverse=True)
    order = np.argsort(np.where(inside[first], first, first + n))
    ranks = np.empty(len(order), np.int64)
    ranks[order] = np.arange(len(order))
    return np.asarray(ranks[index])


__all__ = ["nms_with_sklearn", "sklearn_clusters"]
