"""OpenVINO: runs `.xml` files (with their `.bin`) and `.onnx` files on a processor."""

from __future__ import annotations

import functools
import importlib
import queue
import sys
import threading
from collections import OrderedDict
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from jaxtyping import UInt8

from yolino.image import check_batch
from yolino.inference.engine import (
    METADATA_KEY,
    check_arguments,
    check_file,
    check_interface,
    choose_precision,
    read_header,
)
from yolino.types import Output

OPENVINO_PRECISIONS = {"cpu": ("fp32", "bf16", "fp16", "int8")}
_PROGRAMS = 4  # batch sizes that are kept compiled
_CONVERTER = "openvino.tools.ovc"
_HINTS = {"fp32": "f32", "bf16": "bf16", "fp16": "f16", "int8": "f32"}
_ABILITIES = {"bf16": "BF16", "fp16": "FP16"}


class OpenVinoEngine:
    """Runs an exported network with OpenVINO.

    The network is compiled for each batch size when it first comes, which takes a tenth of a second and makes
    it faster than one for all; the last four sizes stay compiled.

    Args:
        path: File written by `yolino export`: `.xml` with its `.bin` beside it, or `.onnx`.
        device: "auto" or "cpu".
        precision: "auto" (fp32; int8 where the file is quantized), "fp32", "bf16", "fp16" (the last two where
            the processor has them) or "int8".
        threads: Threads of the network; None lets OpenVINO decide.
        streams: Calls at once that the threads are shared among.

    Raises:
        FileNotFoundError: If there is no such file, or an `.xml` lacks its `.bin`.
        ValueError: If it is no YOLinO model, or an argument is unknown or not available.
        ModuleNotFoundError: If OpenVINO is not installed.
    """

    def __init__(
        self,
        path: Path | str,
        *,
        device: str = "auto",
        precision: str = "auto",
        threads: int | None = None,
        streams: int = 1,
    ) -> None:
        path = Path(path)
        check_arguments(device, threads, streams)
        _check_files(path)
        if device == "cuda":
            raise ValueError("OpenVINO has no device 'cuda'; use 'cpu', or another engine.")
        core = openvino_core()
        model = _read(core, path)
        self.header = read_header(_header_text(model, path), path)
        self._names = check_interface(path, self.header, _inputs(model), _outputs(model))
        allowed = _precisions(core)
        self.precision = choose_precision(precision, self.header, path, allowed, "OpenVINO on this processor")
        self.device, self.streams = "cpu", streams
        self.name = f"OpenVINO {self.precision}"
        settings: dict[str, Any] = {
            "PERFORMANCE_HINT": "LATENCY",
            "INFERENCE_PRECISION_HINT": _HINTS[self.precision],
            "NUM_STREAMS": streams,
            "ENABLE_CPU_PINNING": False,  # pinned threads stand still where another program works
        }
        if threads is not None:
            settings["INFERENCE_NUM_THREADS"] = max(threads, streams)
        self._programs = _Programs(core, model, self.header.size, settings)

    def __call__(self, batch: UInt8[np.ndarray, "b h w 3"]) -> Output:
        """Gives what the network says about RGB images of its input size.

        Raises:
            ValueError: If they are no such images, have another size, there are none, or OpenVINO fails.
        """
        check_batch(batch, self.header.size)
        try:
            values = self._programs(batch)
        except RuntimeError as error:
            raise ValueError(f"OpenVINO failed to run the model: {_reason(error)}") from error
        found = [values[name] for name in self._names]
        return Output(found[0], found[1], found[2] if len(found) > 2 else None)


class _Programs:
    """A model compiled for the batch sizes that come; of those that came last, `_PROGRAMS` are kept."""

    def __init__(self, core: Any, model: Any, size: tuple[int, int], settings: dict[str, Any]) -> None:
        self._core, self._model, self._size, self._settings = core, model, size, settings
        self._kept: OrderedDict[int, _Program] = OrderedDict()
        self._lock = threading.Lock()

    def __call__(self, batch: UInt8[np.ndarray, "b h w 3"]) -> Any:
        return self._of(len(batch))(batch)

    def _of(self, count: int) -> _Program:
        with self._lock:
            if count not in self._kept:
                self._kept[count] = self._compile(count)
                if len(self._kept) > _PROGRAMS:
                    self._kept.popitem(last=False)
            self._kept.move_to_end(count)
            return self._kept[count]

    def _compile(self, count: int) -> _Program:
        model = self._model.clone()  # the weights are shared
        model.reshape({"images": [count, *self._size, 3]})
        return _Program(self._core.compile_model(model, "CPU", self._settings))


class _Program:
    """A compiled model; each call in progress has a request of its own."""

    def __init__(self, compiled: Any) -> None:
        self._compiled = compiled
        self._free: queue.LifoQueue[Any] = queue.LifoQueue()

    def __call__(self, batch: UInt8[np.ndarray, "b h w 3"]) -> Any:
        try:
            request = self._free.get_nowait()
        except queue.Empty:
            request = self._compiled.create_infer_request()
        # The input is not copied where it is contiguous; the outputs are, as the next run overwrites them.
        values = request.infer({"images": batch}, share_inputs=True, share_outputs=False)
        self._free.put(request)
        return values


def import_openvino() -> ModuleType:
    """Gives the package `openvino`, without its converter of models.

    At its import, the converter sends usage statistics to Google Analytics (and takes three times as long as
    all the rest: 0.3 s). OpenVINO does without it where it cannot be imported. Who needs it in the same
    process imports `openvino.tools.ovc`.
    """
    if "openvino" in sys.modules:
        return sys.modules["openvino"]
    present = _CONVERTER in sys.modules
    if not present:
        sys.modules[_CONVERTER] = None  # type: ignore[assignment]  # "cannot be imported", says Python's reference
    try:
        return importlib.import_module("openvino")
    finally:
        if not present:
            del sys.modules[_CONVERTER]


@functools.cache
def openvino_core() -> Any:
    """Gives the one `openvino.Core` of this process.

    Each one gives the thread a stack for signal handlers and takes it back at its end. Where two end in the
    order in which they began, the thread keeps one that is gone, and the next signal (Ctrl-C, or a process of
    a data loader that ends) is a segmentation fault. One that lives as long as the process has no such end.
    """
    core = import_openvino().Core()
    core.get_property("CPU", "OPTIMIZATION_CAPABILITIES")  # loads what brings the stack
    return core


def _check_files(path: Path) -> None:
    check_file(path)
    weights = path.with_suffix(".bin")
    if path.suffix.lower() == ".xml" and not weights.is_file():
        raise FileNotFoundError(f"The model {path} needs the file {weights} beside it, which does not exist.")


def _read(core: Any, path: Path) -> Any:
    try:
        return core.read_model(str(path))
    except RuntimeError as error:
        raise ValueError(f"The model {path} is not readable with OpenVINO ({_reason(error)}).") from error


def _header_text(model: Any, path: Path) -> str | None:
    """Gives the header's JSON; OpenVINO keeps the metadata of an ONNX file under "framework"."""
    place = ["framework", METADATA_KEY] if path.suffix.lower() == ".onnx" else [METADATA_KEY, "header"]
    if not model.has_rt_info(place):
        return None
    return str(model.get_rt_info(place).astype(str))


def _inputs(model: Any) -> dict[str, tuple[str, list[int | None]]]:
    return {
        name: (
            str(value.element_type.to_dtype()),
            [edge.get_length() if edge.is_static else None for edge in value.partial_shape],
        )
        for value in model.inputs
        for name in value.names
    }


def _outputs(model: Any) -> list[str]:
    return [name for value in model.outputs for name in value.names]


def _precisions(core: Any) -> tuple[str, ...]:
    """Gives what this processor calculates with."""
    abilities = core.get_property("CPU", "OPTIMIZATION_CAPABILITIES")
    return tuple(
        name for name in OPENVINO_PRECISIONS["cpu"] if name not in _ABILITIES or _ABILITIES[name] in abilities
    )


def _reason(error: Exception) -> str:
    """Gives the last line of OpenVINO's message, which is the cause; before it stand places in its source."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[-1] if lines else type(error).__name__


__all__ = ["OPENVINO_PRECISIONS", "OpenVinoEngine", "import_openvino", "openvino_core"]
