"""Scores: of a model on a dataset, and of result files against label files."""

from __future__ import annotations

from yolino.evaluate.confusion import draw_confusion
from yolino.evaluate.kinds import label_map
from yolino.evaluate.report import (
    CLASS_COLUMNS,
    SCORE_COLUMNS,
    class_rows,
    confusion_tables,
    score_rows,
    write_report,
)
from yolino.evaluate.run import Evaluation, evaluate, point_radius
from yolino.evaluate.score import Scores, score

__all__ = [
    "CLASS_COLUMNS",
    "SCORE_COLUMNS",
    "Evaluation",
    "Scores",
    "class_rows",
    "confusion_tables",
    "draw_confusion",
    "evaluate",
    "label_map",
    "point_radius",
    "score",
    "score_rows",
    "write_report",
]
