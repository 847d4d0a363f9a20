"""Export: a checkpoint or an exported model in, a model file out that has everything inside.

Torch is loaded only where a checkpoint is read.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from yolino.export.calibration import Calibration
    from yolino.export.graph import onnx_bytes
    from yolino.export.run import FORMATS, Exported, export

_HOMES = {
    "Calibration": "yolino.export.calibration",
    "Exported": "yolino.export.run",
    "FORMATS": "yolino.export.run",
    "export": "yolino.export.run",
    "onnx_bytes": "yolino.export.graph",
}


def __getattr__(name: str) -> object:
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'yolino.export' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])


__all__ = ["FORMATS", "Calibration", "Exported", "export", "onnx_bytes"]
