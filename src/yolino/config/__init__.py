"""The experiment file: YAML with a section per part; its keys are the constructors' arguments."""

from __future__ import annotations

from yolino.config.mistakes import check_keys, explain, suggest
from yolino.config.reading import differences, load_experiment, override, read_yaml
from yolino.config.sections import (
    Augmentation,
    Data,
    Experiment,
    Loss,
    Matching,
    Model,
    Postprocess,
    Section,
    Source,
    Training,
)

__all__ = [
    "Augmentation",
    "Data",
    "Experiment",
    "Loss",
    "Matching",
    "Model",
    "Postprocess",
    "Section",
    "Source",
    "Training",
    "check_keys",
    "differences",
    "explain",
    "load_experiment",
    "override",
    "read_yaml",
    "suggest",
]
