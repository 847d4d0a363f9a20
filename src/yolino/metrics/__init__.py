"""How good are the lines? Metrics over images, by name in `METRICS`."""

from __future__ import annotations

from yolino.metrics.bootstrap import bootstrap_intervals
from yolino.metrics.classes import ClassMetric
from yolino.metrics.culane import CULaneMetric
from yolino.metrics.instances import ChamferMetric, FrechetMetric
from yolino.metrics.metric import Metric, SumMetric
from yolino.metrics.points import PointMatch, PointMetric, match_points
from yolino.metrics.samples import Samples, sample_lines
from yolino.metrics.tusimple import TuSimpleMetric, TuSimpleScore, score_files, score_image

METRICS: dict[str, type[Metric]] = {
    "points": PointMetric,
    "tusimple": TuSimpleMetric,
    "classes": ClassMetric,
    "culane": CULaneMetric,
    "chamfer": ChamferMetric,
    "frechet": FrechetMetric,
}

__all__ = [
    "METRICS",
    "CULaneMetric",
    "ChamferMetric",
    "ClassMetric",
    "FrechetMetric",
    "Metric",
    "PointMatch",
    "PointMetric",
    "Samples",
    "SumMetric",
    "TuSimpleMetric",
    "TuSimpleScore",
    "bootstrap_intervals",
    "match_points",
    "sample_lines",
    "score_files",
    "score_image",
]
