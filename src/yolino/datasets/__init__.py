"""Datasets: annotations of many formats to samples. `DATASETS` is the extension point."""

from __future__ import annotations

from yolino.datasets.annotation import Annotation, LabelError
from yolino.datasets.dataset import Dataset
from yolino.datasets.files import FileDataset
from yolino.datasets.registry import DATASETS, WRITERS
from yolino.datasets.synthetic import Synthetic
from yolino.datasets.tusimple import TuSimple
from yolino.datasets.writing import Writer

__all__ = [
    "DATASETS",
    "WRITERS",
    "Annotation",
    "Dataset",
    "FileDataset",
    "LabelError",
    "Synthetic",
    "TuSimple",
    "Writer",
]
