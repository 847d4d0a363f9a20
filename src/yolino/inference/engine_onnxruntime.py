"""ONNX Runtime: runs `.onnx` files on a processor, with CUDA, or with TensorRT."""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from jaxtyping import UInt8

from yolino.image import check_batch
from yolino.inference.engine import (
    METADATA_KEY,
    cache_folder,
    check_arguments,
    check_file,
    check_interface,
    choose_precision,
    read_header,
    usable_cores,
)
from yolino.types import Output

CPU, CUDA, TENSORRT = "CPUExecutionProvider", "CUDAExecutionProvider", "TensorrtExecutionProvider"
ONNX_PRECISIONS = {"cpu": ("fp32", "int8"), "cuda": ("fp32", "fp16", "int8")}


class OnnxEngine:
    """Runs an exported network with ONNX Runtime.

    On a GPU, fp32 runs with CUDA (without TF32) and fp16 with TensorRT, which keeps the programs that it
    builds for minutes in the user's cache folder (`YOLINO_CACHE`).

    Args:
        path: File written by `yolino export`.
        device: "auto" (CUDA where ONNX Runtime offers it, else the processor), "cpu" or "cuda".
        precision: "auto" (fp32; int8 where the file is quantized), "fp32", "fp16" (on a GPU) or "int8".
        threads: Threads of the network on the processor; None lets ONNX Runtime decide.
        streams: Calls at once that the threads are shared among.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If it is no YOLinO model, or an argument is unknown or not available.
        ModuleNotFoundError: If ONNX Runtime is not installed.
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
        check_file(path)
        runtime = _onnxruntime()
        available = runtime.get_available_providers()
        provider = _provider(device, precision, available)
        self.streams = streams
        options = _session_options(runtime, _threads_of_a_call(threads, streams))
        self._session = _open_session(runtime, path, options, _provider_options(provider, path))
        started = self._session.get_providers()[0]
        self.device = "cpu" if started == CPU else "cuda"
        if provider not in (CPU, started) and (device == "cuda" or precision == "fp16"):
            raise ValueError(
                f"ONNX Runtime could not start {_PLAIN[provider].strip()} (see its documentation for the "
                "version it needs)."
            )
        self.header = read_header(self._session.get_modelmeta().custom_metadata_map.get(METADATA_KEY), path)
        where = f"ONNX Runtime on {self.device}"
        self.precision = choose_precision(precision, self.header, path, ONNX_PRECISIONS[self.device], where)
        self.name = f"ONNX Runtime {_PLAIN[started]}{self.precision}"
        self._names = check_interface(
            path, self.header, _inputs(self._session), [value.name for value in self._session.get_outputs()]
        )

    def __call__(self, batch: UInt8[np.ndarray, "b h w 3"]) -> Output:
        """Gives what the network says about RGB images of its input size.

        Raises:
            ValueError: If they are no such images, have another size, there are none, or ONNX Runtime fails.
        """
        check_batch(batch, self.header.size)
        try:
            values = self._session.run(self._names, {"images": batch})
        except Exception as error:  # ONNX Runtime's own exceptions have no common class but this one
            raise ValueError(f"ONNX Runtime failed to run the model: {_first_line(error)}") from error
        return Output(values[0], values[1], values[2] if len(values) > 2 else None)


_PLAIN = {CPU: "", CUDA: "CUDA ", TENSORRT: "TensorRT "}


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


def _provider(device: str, precision: str, available: Sequence[str]) -> str:
    """Gives the provider that runs the network.

    TensorRT is taken for fp16 only: it builds a program for minutes, while CUDA starts at once.
    """
    if device == "cpu" or (CUDA not in available and device == "auto"):
        return CPU
    if CUDA not in available:
        raise ValueError(
            "The device 'cuda' needs ONNX Runtime with CUDA: pip install onnxruntime-gpu, or use 'cpu'."
        )
    if precision != "fp16":
        return CUDA
    if TENSORRT not in available:
        raise ValueError("ONNX Runtime runs fp16 with TensorRT, which this one lacks: leave out --precision.")
    return TENSORRT


def _provider_options(provider: str, path: Path) -> list[tuple[str, dict[str, str]]]:
    """Gives the providers in the order of preference, with their options."""
    if provider == CPU:
        return [(CPU, {})]
    exact = (CUDA, {"use_tf32": "0"})  # TF32 has 10 bits of mantissa: less than the file's arithmetic
    if provider == CUDA:
        return [exact, (CPU, {})]
    options = {"trt_fp16_enable": "1"}
    # The names that TensorRT's programs get know the graph, but not its weights: one folder for each file.
    with open(path, "rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()[:16]
    if (folder := cache_folder(f"tensorrt/{digest}")) is not None:
        options |= {
            "trt_engine_cache_enable": "1",
            "trt_engine_cache_path": str(folder),
            "trt_timing_cache_enable": "1",
            "trt_timing_cache_path": str(folder),
        }
    return [(TENSORRT, options), exact, (CPU, {})]


def _threads_of_a_call(threads: int | None, streams: int) -> int | None:
    """Gives how many threads a call may use.

    A call works in the caller's thread and in those of one pool for all calls. So when all streams are busy,
    `streams` callers and the others of the pool are `threads` together.
    """
    if streams == 1:
        return threads
    return max(1, (usable_cores() if threads is None else threads) - streams + 1)


def _session_options(runtime: ModuleType, threads: int | None) -> Any:
    options = runtime.SessionOptions()
    options.log_severity_level = 3
    # Threads that wait by spinning take the cores that other steps need. Without, measured on
    # two cores, an image takes 1 % longer on an idle machine and half as long on a busy one.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    if threads is not None:
        options.intra_op_num_threads = threads
    return options


def _open_session(
    runtime: ModuleType, path: Path, options: Any, providers: list[tuple[str, dict[str, str]]]
) -> Any:
    try:
        return runtime.InferenceSession(str(path), options, providers=providers)
    except Exception as error:  # ONNX Runtime's own exceptions have no common class but this one
        raise ValueError(f"The model {path} is not a readable ONNX file ({_first_line(error)}).") from error


def _inputs(session: Any) -> dict[str, tuple[str, list[int | None]]]:
    return {
        value.name: (
            value.type.removeprefix("tensor(").removesuffix(")"),
            [edge if isinstance(edge, int) else None for edge in value.shape],
        )
        for value in session.get_inputs()
    }


def _first_line(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__


__all__ = ["ONNX_PRECISIONS", "OnnxEngine"]
