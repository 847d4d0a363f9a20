"""All formats by name."""

from __future__ import annotations

from yolino.datasets.dataset import Dataset
from yolino.datasets.files import FileDataset
from yolino.datasets.synthetic import Synthetic
from yolino.datasets.tusimple import TuSimple
from yolino.datasets.writing import Writer

DATASETS: dict[str, type[Dataset]] = {
    "tusimple": TuSimple,
    "synthetic": Synthetic,
}
"""What can be read."""

WRITERS: dict[str, type[Writer]] = {
    name: kind.writer
    for name, kind in DATASETS.items()
    if issubclass(kind, FileDataset) and kind.writer is not None
}
"""What can be written."""

__all__ = ["DATASETS", "WRITERS"]
