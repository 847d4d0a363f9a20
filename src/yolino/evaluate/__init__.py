"""Scores: of a model on a dataset, and of result files against label files."""

from __future__ import annotations

from yolino.evaluate.report import score_rows, write_report
from yolino.evaluate.run import Evaluation, evaluate, point_radius
from yolino.evaluate.score import Scores, score

__all__ = ["Evaluation", "Scores", "evaluate", "point_radius", "score", "score_rows", "write_report"]
