"""Threshold, NMS and linker of a model, chosen on labelled images; the network runs once for each image."""

from __future__ import annotations

from yolino.tuning.model_files import with_header
from yolino.tuning.objective import OBJECTIVES, Objective, build_objective
from yolino.tuning.report import Row, facts, parameter_rows, score_rows, summary, tuned_header
from yolino.tuning.run import Options, Tuning, tune
from yolino.tuning.space import SPACES, Space

__all__ = [
    "OBJECTIVES",
    "SPACES",
    "Objective",
    "Options",
    "Row",
    "Space",
    "Tuning",
    "build_objective",
    "facts",
    "parameter_rows",
    "score_rows",
    "summary",
    "tune",
    "tuned_header",
    "with_header",
]
