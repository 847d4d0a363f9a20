"""How good are the lines? Metrics over images, by name in `METRICS`."""

from __future__ import annotations

from yolino.metrics.apls import AplsMetric
from yolino.metrics.bootstrap import bootstrap_intervals
from yolino.metrics.classes import ClassMetric
from yolino.metrics.culane import CULaneMetric
from yolino.metrics.instances import ChamferMetric, FrechetMetric
from yolino.metrics.metric import Metric, SumMetric
from yolino.metrics.points import PointMatch, PointMetric, match_points
from yolino.metrics.samples import Samples, sample_lines
from yolino.metrics.topo import TopoMetric
from yolino.metrics.tusimple import TuSimpleMetric, TuSimpleScore, score_files, score_image

METRICS: dict[str, type[Metric]] = {
    "points": PointMetric,
    "tusimple": TuSimpleMetric,
    "classes": ClassMetric,
    "culane": CULaneMetric,
    "chamfer": ChamferMetric,
    "frechet": FrechetMetric,
    "topo": TopoMetric,
    "apls": AplsMetric,
}

__all__ = [
    "METRICS",
    "AplsMetric",
    "CULaneMetric",
    "ChamferMetric",
    "ClassMetric",
    "FrechetMetric",
    "Metric",
    "PointMatch",
    "PointMetric",
    "Samples",
    "SumMetric",
    "TopoMetric",
    "TuSimpleMetric",
    "TuSimpleScore",
    "bootstrap_intervals",
    "match_points",
    "sample_lines",
    "score_files",
    "score_image",
]
