"""YOLinO: detect polylines of any shape in images, in one network pass.

    import yolino
    from yolino.io import read_image

    polylines = yolino.load("default")(read_image("road.jpg"))

Importing this package is fast: each room is imported when it is first used, torch only to train or export.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from yolino.inference.loading import load
    from yolino.inference.predictor import Predictor
    from yolino.types import Polylines, Sample, Segments

    __version__: str

_HOMES = {
    "Predictor": "yolino.inference.predictor",
    "load": "yolino.inference.loading",
    "Polylines": "yolino.types",
    "Sample": "yolino.types",
    "Segments": "yolino.types",
}


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib.metadata import version

        return version("yolino")
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'yolino' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES, "__version__"])


__all__ = ["Polylines", "Predictor", "Sample", "Segments", "__version__", "load"]
