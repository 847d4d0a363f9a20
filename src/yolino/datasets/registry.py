"""All formats by name."""

from __future__ import annotations

from yolino.datasets.argoverse2 import Argoverse2
from yolino.datasets.coco import Coco
from yolino.datasets.culane import CULane
from yolino.datasets.curvelanes import CurveLanes
from yolino.datasets.cvat import CVAT
from yolino.datasets.dataset import Dataset
from yolino.datasets.files import FileDataset
from yolino.datasets.geojson import GeoJson
from yolino.datasets.labelme import LabelMe
from yolino.datasets.labelstudio import LabelStudio
from yolino.datasets.masks import Masks
from yolino.datasets.results import Results
from yolino.datasets.synthetic import Synthetic
from yolino.datasets.tusimple import TuSimple
from yolino.datasets.writing import Writer

DATASETS: dict[str, type[Dataset]] = {
    "tusimple": TuSimple,
    "culane": CULane,
    "curvelanes": CurveLanes,
    "geojson": GeoJson,
    "cvat": CVAT,
    "coco": Coco,
    "labelme": LabelMe,
    "labelstudio": LabelStudio,
    "masks": Masks,
    "argoverse2": Argoverse2,
    "results": Results,
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
