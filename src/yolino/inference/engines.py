"""What runs a network: one small class per file format. Everything after them is numpy."""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import UInt8

from yolino.header import Header
from yolino.types import Output

DEVICES = ("auto", "cpu", "cuda")
METADATA_KEY = "yolino"


@runtime_checkable
class Engine(Protocol):
    """A loaded network with the header of its file."""

    header: Header

    def __call__(self, batch: UInt8[np.ndarray, "b h w 3"], /) -> Output:
        """Gives what the network says about RGB images of its input size."""
        ...


class OnnxEngine:
    """Runs an exported network with ONNX Runtime.

    Args:
        path: File written by `yolino export`.
        device: "auto" (CUDA where ONNX Runtime offers it, else the processor), "cpu" or "cuda".
        threads: Threads of one run on the processor; None lets ONNX Runtime decide.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If it is no YOLinO model, or `device` is unknown or not available.
    """

    def __init__(self, path: Path | str, *, device: str = "auto", threads: int | None = None) -> None:
        path = Path(path)
        if not path.is_file():
            raise FileNotFoundError(f"The model {path} does not exist; give a model file or 'default'.")
        if threads is not None and threads < 1:
            raise ValueError(
                f"threads is {threads}, but must be at least 1 (or None: let ONNX Runtime decide)."
            )
        runtime = _onnxruntime()
        provider = _provider(device, runtime.get_available_providers())
        self._session = _open_session(runtime, path, provider, threads)
        self.device = "cpu" if self._session.get_providers()[0] == "CPUExecutionProvider" else "cuda"
        if device == "cuda" and self.device != "cuda":
            raise ValueError(
                "ONNX Runtime could not start CUDA (see its documentation for the CUDA version it needs)."
            )
        self.header = _read_header(self._session, path)
        self._names = _check_interface(self._session, path, self.header)

    def __call__(self, batch: UInt8[np.ndarray, "b h w 3"]) -> Output:
        """Gives what the network says about RGB images of its input size.

        Raises:
            ValueError: If the images have another size, or ONNX Runtime fails.
        """
        if batch.shape[1:3] != self.header.size:
            raise ValueError(
                f"The network takes images of {self.header.size} (height, width), got {batch.shape[1:3]}."
            )
        try:
            values = self._session.run(self._names, {"images": batch})
        except Exception as error:  # ONNX Runtime's own exceptions have no common class but this one
            raise ValueError(f"ONNX Runtime failed to run the model: {error}") from error
        return Output(values[0], values[1], values[2] if len(values) > 2 else None)


def torch_engine(path: Path | str, *, device: str = "auto", threads: int | None = None) -> Engine:
    """Gives the engine for a checkpoint; needs torch.

    Raises:
        ModuleNotFoundError: If torch is not installed.
    """
    if not Path(path).is_file():
        raise FileNotFoundError(f"The model {path} does not exist; give a model file or 'default'.")
    if importlib.util.find_spec("torch") is None or importlib.util.find_spec("safetensors") is None:
        raise ModuleNotFoundError(
            f"The checkpoint {path} needs torch: pip install 'yolino[train]', or use its exported .onnx file."
        )
    module = importlib.import_module("yolino.model.engine")
    engine: Engine = module.TorchEngine(Path(path), device=device, threads=threads)
    return engine


ENGINES: dict[str, Callable[..., Engine]] = {".onnx": OnnxEngine, ".safetensors": torch_engine}


def open_engine(path: Path | str, *, device: str = "auto", threads: int | None = None) -> Engine:
    """Gives the engine for the model file `path`, chosen by its suffix (`ENGINES`).

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If the suffix is unknown, the file is no YOLinO model, or the device is not available.
        ModuleNotFoundError: If the engine needs a package that is not installed.
    """
    path = Path(path)
    if device not in DEVICES:
        raise ValueError(f"The device {device!r} is unknown; use one of {', '.join(DEVICES)}.")
    if path.suffix.lower() not in ENGINES:
        raise ValueError(
            f"The model {path} has the suffix {path.suffix!r}; known model files end in {', '.join(ENGINES)}."
        )
    return ENGINES[path.suffix.lower()](path, device=device, threads=threads)


@contextlib.contextmanager
def _quiet_stderr() -> Iterator[None]:
    """Keeps what C code writes to stderr meanwhile for itself, and shows it only if the block fails."""
    try:
        saved = os.dup(2)
    except OSError:  # a service without stderr
        yield
        return
    with tempfile.TemporaryFile() as kept:
        os.dup2(kept.fileno(), 2)
        try:
            yield
        except BaseException:
            kept.seek(0)
            os.write(saved, kept.read())
            raise
        finally:
            os.dup2(saved, 2)
            os.close(saved)


def _onnxruntime() -> ModuleType:
    """Gives ONNX Runtime, silent below errors.

    At its import it looks for GPUs and warns on stderr where it does not find what it expects, before any
    setting can reach it (microsoft/onnxruntime issue 27092).
    """
    if "onnxruntime" in sys.modules:
        return sys.modules["onnxruntime"]
    with _quiet_stderr():
        runtime = importlib.import_module("onnxruntime")
    runtime.set_default_logger_severity(3)
    return runtime


def _provider(device: str, available: list[str]) -> str:
    if device not in DEVICES:
        raise ValueError(f"The device {device!r} is unknown; use one of {', '.join(DEVICES)}.")
    if device != "cpu" and "CUDAExecutionProvider" in available:
        return "CUDAExecutionProvider"
    if device == "cuda":
        raise ValueError(
            "The device 'cuda' needs ONNX Runtime with CUDA: pip install onnxruntime-gpu, or use 'cpu'."
        )
    return "CPUExecutionProvider"


def _open_session(runtime: ModuleType, path: Path, provider: str, threads: int | None) -> Any:
    options = runtime.SessionOptions()
    options.log_severity_level = 3
    # Threads that wait by spinning take the cores that other steps need. Without, measured on
    # two cores, an image takes 1 % longer on an idle machine and half as long on a busy one.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    if threads is not None:
        options.intra_op_num_threads = threads
    providers = list(dict.fromkeys([provider, "CPUExecutionProvider"]))
    try:
        return runtime.InferenceSession(str(path), options, providers=providers)
    except Exception as error:  # ONNX Runtime's own exceptions have no common class but this one
        reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise ValueError(f"The model {path} is not a readable ONNX file ({reason}).") from error


def _read_header(session: Any, path: Path) -> Header:
    metadata = session.get_modelmeta().custom_metadata_map
    if METADATA_KEY not in metadata:
        raise ValueError(
            f"{path} is not a YOLinO model: its metadata has no '{METADATA_KEY}' header; "
            "export one with `yolino export CHECKPOINT`."
        )
    try:
        return Header.from_json(metadata[METADATA_KEY])
    except ValueError as error:
        raise ValueError(f"{path} has a damaged header. {error}") from error


def _check_interface(session: Any, path: Path, header: Header) -> list[str]:
    """Gives the names of the outputs to fetch, in order.

    Raises:
        ValueError: If the graph's input and outputs are not those of an exported network.
    """
    inputs = {value.name: (value.type, list(value.shape)) for value in session.get_inputs()}
    outputs = [value.name for value in session.get_outputs()]
    wanted = ["endpoints", "scores"] + ["probabilities"] * bool(header.classes)
    if list(inputs) != ["images"] or inputs["images"][0] != "tensor(uint8)":
        raise ValueError(f"{path} must have the one input 'images' (b, h, w, 3) of uint8, but has {inputs}.")
    fixed = [n for n in inputs["images"][1][1:3] if isinstance(n, int)]
    if fixed and tuple(fixed) != header.size:
        raise ValueError(f"{path} takes images of {tuple(fixed)}, but its header says {header.size}.")
    if missing := [name for name in wanted if name not in outputs]:
        raise ValueError(
            f"{path} lacks the outputs {', '.join(missing)}: it has {', '.join(outputs) or 'none'}. "
            "Export the model again with `yolino export CHECKPOINT`."
        )
    return wanted


__all__ = ["DEVICES", "ENGINES", "METADATA_KEY", "Engine", "OnnxEngine", "open_engine", "torch_engine"]
