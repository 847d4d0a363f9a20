"""Non-maximum suppression of line segments: one averaged segment for each cluster of near-duplicates."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from jaxtyping import Float, Int

from yolino.postprocess.clustering import cluster, dbscan
from yolino.postprocess.inputs import SegmentArrays, check_not_negative, check_positive, segment_arrays
from yolino.postprocess.merging import check, measure, merge, powers, suppress
from yolino.postprocess.outlines import class_votes
from yolino.types import Segments


def nms_coordinates(
    segments: Segments,
    cell_size: float,
    *,
    midpoint_weight: float = 0.1,
    length_weight: float = 0.013,
    direction_weight: float = 0.05,
    directed: bool = True,
) -> Float[np.ndarray, "n 5"]:
    """Gives the segments as points `(m_x, m_y, l, d_x, d_y)`: the nearer, the more alike (paper, Eq. 8-12).

    Midpoint and length are in cell units, the direction is a unit vector, each times its weight. With the
    defaults and a radius of 0.02, midpoints 0.2 cells apart, lengths 1.5 cells apart or directions 23
    degrees apart reach the radius. An undirected segment has half the direction of twice its angle, so that
    both its directions give one point and small angles count the same. The direction of a segment without
    length is zero.

    Args:
        segments: Segments in pixels.
        cell_size: Side of a cell in pixels.
        midpoint_weight: Factor for the midpoint (the paper's lambda_m times kappa, for a cell as the unit).
        length_weight: Factor for the length (lambda_l).
        direction_weight: Factor for the direction (lambda_d).
        directed: Whether opposite directions are different.
    """
    scales = _scales(cell_size, midpoint_weight, length_weight, direction_weight, directed)
    return np.asarray(measure(segment_arrays(segments).endpoints, scales, directed)[1])


def _scales(
    cell_size: float, midpoint_weight: float, length_weight: float, direction_weight: float, directed: bool
) -> tuple[float, float, float]:
    """Gives the factors of midpoint, length and direction in NMS coordinates; a doubled angle counts half."""
    direction = direction_weight if directed else direction_weight / 2
    return midpoint_weight / cell_size, length_weight / cell_size, float(direction)


class NMS:
    """Merges segments that say the same: clusters them with DBSCAN and gives the average of each cluster.

    Call it with the segments above the confidence threshold; it gives the merged ones, clusters first, in
    the order of their first members, then the segments that are in no cluster. All lengths are in cell
    units, so one set of parameters holds at every stride.

    Midpoint, length and direction are averaged with `(score / best) ** score_power` as weights, so are the
    class probabilities (without them the labels vote); the score is the maximum. Opposite directions are
    never averaged: members of a cluster that point against its best segment make a segment of their own.
    With `directed=False` both directions of a segment are one, angles are averaged doubled, and the merged
    segments point right.

    Args:
        cell_size: Side of a cell (the stride of the network) in the pixels of the segments.
        epsilon: Radius of DBSCAN in the coordinates of `nms_coordinates`.
        min_samples: Segments that make a core point, itself included.
        weighted: Whether `score ** score_power` replaces the number of segments in `min_samples` (as the
            paper says: two segments of .99 are then noise).
        keep_singletons: Whether segments in no cluster are kept as they are.
        directed: Whether the two directions of a segment differ.
        midpoint_weight: See `nms_coordinates`.
        length_weight: See `nms_coordinates`.
        direction_weight: See `nms_coordinates`.
        score_power: Exponent of the scores in the weights.

    Raises:
        ValueError: If a parameter is out of range; when called, if end points or scores are not finite or a
            score is negative.
    """

    def __init__(
        self,
        cell_size: float,
        *,
        epsilon: float = 0.02,
        min_samples: int = 2,
        weighted: bool = False,
        keep_singletons: bool = True,
        directed: bool = True,
        midpoint_weight: float = 0.1,
        length_weight: float = 0.013,
        direction_weight: float = 0.05,
        score_power: float = 10.0,
    ) -> None:
        check_positive(cell_size=cell_size, epsilon=epsilon, min_samples=min_samples)
        check_not_negative(midpoint_weight=midpoint_weight, length_weight=length_weight)
        check_not_negative(direction_weight=direction_weight, score_power=score_power)
        self._scales = _scales(cell_size, midpoint_weight, length_weight, direction_weight, directed)
        self._clustering = (float(epsilon), int(min_samples))
        self._merging = (float(score_power), bool(directed), bool(keep_singletons))
        self._weighted = bool(weighted)
        self._settings = (self._scales, *self._clustering, *self._merging)

    def __call__(self, segments: Segments) -> Segments:
        """Gives the merged segments, in the pixels of `segments`."""
        if len(segments) == 0:
            return segments
        arrays = segment_arrays(segments)
        endpoints, scores, labels, odds, voted = self._merge(arrays)
        if segments.probabilities is not None:
            return Segments.trusted(endpoints, scores, labels, odds)
        if voted:
            names, votes = class_votes(arrays.labels, arrays.probabilities)
            labels = names[self._merge(arrays._replace(probabilities=votes))[2]]
        return Segments.trusted(endpoints, scores, labels, None)

    def clusters(self, segments: Segments) -> Int[np.ndarray, " n"]:
        """Gives the cluster of each segment as DBSCAN finds it, -1 for none."""
        endpoints, scores, *_ = segment_arrays(segments)
        points = measure(endpoints, self._scales, self._merging[1])[1]
        return dbscan(points, *self._clustering, powers(scores, self._merging[0]) if self._weighted else None)

    def _merge(self, arrays: SegmentArrays) -> tuple[Any, ...]:
        """Gives endpoints, scores, labels, probabilities, and whether labels of one cluster differ."""
        epsilon, min_samples = self._clustering
        if not self._weighted and min_samples <= 2:  # one kernel for the usual case
            return cast(tuple[Any, ...], suppress(*arrays, self._settings))
        measures, points = measure(arrays.endpoints, self._scales, self._merging[1])
        check(points, arrays.scores, epsilon)
        weights = powers(arrays.scores, self._merging[0]) if self._weighted else np.empty(0)
        clusters = cluster(points, epsilon, min_samples, weights)
        return cast(tuple[Any, ...], merge(tuple(arrays), measures, clusters, self._merging))
