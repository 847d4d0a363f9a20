"""Datasets: annotations of many formats to samples. `DATASETS` is the extension point."""

from __future__ import annotations

from yolino.datasets.dataset import Dataset
from yolino.datasets.synthetic import Synthetic
from yolino.datasets.tusimple import TuSimple

DATASETS: dict[str, type[Dataset]] = {"tusimple": TuSimple, "synthetic": Synthetic}

__all__ = ["DATASETS", "Dataset", "Synthetic", "TuSimple"]
