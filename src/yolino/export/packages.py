"""The packages that only some exports need."""

from __future__ import annotations

import importlib
import importlib.util
import logging
import sys
from types import ModuleType

from yolino.inference.engine_openvino import import_openvino, openvino_core

_REPORTER = "openvino_telemetry"


def needed(name: str, what: str) -> ModuleType:
    """Gives a package that an export needs.

    Args:
        name: Its name, such as "onnx".
        what: What needs it, for the message.

    Raises:
        ModuleNotFoundError: It is not installed; the message says how to get it.
    """
    if importlib.util.find_spec(name) is None:
        raise ModuleNotFoundError(
            f"{what} needs the package {name}, which is not installed: pip install 'yolino[quantize]'."
        )
    return import_openvino() if name == "openvino" else importlib.import_module(name)


def import_nncf() -> ModuleType:
    """Gives the package `nncf`, which then sends no usage statistics and writes no log lines below errors.

    At its import and at every call, NNCF reports to Google Analytics through the package
    `openvino_telemetry`; it does without where that cannot be imported. So from here on, this process cannot.

    Raises:
        ModuleNotFoundError: NNCF or OpenVINO is not installed.
    """
    needed("openvino", "Quantizing for OpenVINO")
    openvino_core()  # the first one, as NNCF makes its own
    if "nncf" not in sys.modules:
        sys.modules[_REPORTER] = None  # type: ignore[assignment]  # "cannot be imported", says Python's reference
    nncf = needed("nncf", "Quantizing for OpenVINO")
    logging.getLogger("nncf").setLevel(logging.ERROR)
    return nncf


__all__ = ["import_nncf", "needed"]
