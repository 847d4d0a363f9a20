"""The torch engine: runs a network behind the same face as the other engines (`yolino.inference.engines`)."""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import UInt8
from torch import Tensor, nn

from yolino.header import Header
from yolino.image import check_batch
from yolino.model.checkpoint import load_checkpoint
from yolino.model.network import Network
from yolino.model.programs import Arrays, EagerProgram, Program, StaticPrograms, record
from yolino.types import Output

_DTYPES = {"fp32": torch.float32, "bf16": torch.bfloat16, "fp16": torch.float16}
_THREADS = torch.get_num_threads()
_COMPILERS = ("c++", "g++", "clang++")


class Exportable(nn.Module):
    """The whole graph up to the seam: RGB pixels -> segments in pixels, scores, class probabilities.

    Args:
        network: The network.
        size: Height and width of its input in pixels.
        precision: Arithmetic up to the network's last convolution: decoding is always done in 32 bits, as
            16 of them cannot tell the pixels of an image apart.
    """

    def __init__(self, network: Network, size: tuple[int, int], precision: str = "fp32") -> None:
        super().__init__()
        self.network, self.size, self.precision = network, size, precision
        if precision != "fp32":  # else each run would round the weights anew
            for module in network.modules():
                if isinstance(module, nn.Conv2d | nn.ConvTranspose2d | nn.Linear):
                    module.to(_DTYPES[precision])

    def forward(self, images: UInt8[Tensor, "b h w 3"]) -> tuple[Tensor, ...]:
        """Gives end points `(b, n, 2, 2)`, scores `(b, n)` and, with classes, probabilities `(b, n, c)`."""
        pixels = images.permute(0, 3, 1, 2).float()
        if self.precision == "fp32":
            prediction = self.network(pixels)
        else:
            with torch.autocast(pixels.device.type, _DTYPES[self.precision]):
                prediction = self.network(pixels)
        endpoints, scores, probabilities = self.network.decode(prediction, self.size)
        return (endpoints, scores, probabilities) if self.network.num_classes else (endpoints, scores)


class TorchEngine:
    """Runs a checkpoint with torch.

    On a GPU the work of one batch is recorded as a CUDA graph, for batches of 1, 2, 4, ... images: starting
    its hundreds of small steps one by one takes longer than running them. Others are filled up.

    Args:
        path: A checkpoint (`.safetensors`).
        device: `auto`, `cpu` or `cuda`.
        precision: Arithmetic of the network: `auto` and `fp32` (without TF32), `bf16` or `fp16`. End points
            and scores are float32 in any case.
        threads: Threads of the CPU, or None for torch's choice. It holds for all of torch in this process.
        streams: Calls at once that the threads are shared among.
        compiled: Whether `torch.compile` makes a faster program of the network first, in about a minute.

    Raises:
        FileNotFoundError: No such file.
        ValueError: The file is no checkpoint, or an argument is unknown or not available.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        device: str = "auto",
        precision: str = "auto",
        threads: int | None = None,
        streams: int = 1,
        compiled: bool = False,
    ) -> None:
        self.precision = _check_precision(precision)
        self.device = _check_device(device)
        if compiled:
            _check_compiler(self.device)
        network, self.header = load_checkpoint(path)
        self.streams = streams
        _set_threads(threads, streams)
        network = network.to(self.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.graph: nn.Module = Exportable(network, self.header.size, self.precision).eval()
        self.name = f"torch{' compiled' * compiled} {self.precision}"
        self._program = _program(self.graph, self.header.size, self.device, streams, compiled)

    @classmethod
    def of(cls, network: Network, header: Header, *, device: str = "cpu") -> TorchEngine:
        """Gives an engine for a network in memory (validation during training), which stays as it is."""
        engine = cls.__new__(cls)
        engine.header, engine.device, engine.precision = header, _check_device(device), "fp32"
        engine.name, engine.streams = "torch fp32", 1
        engine.graph = Exportable(network, header.size).eval().to(engine.device)
        engine._program = EagerProgram(engine.graph, engine.device)
        return engine

    def __call__(self, images: UInt8[np.ndarray, "b h w 3"]) -> Output:
        """Gives what the network says about a batch of RGB images of its input size.

        Raises:
            ValueError: If they are no such images, have another size, or there are none.
        """
        check_batch(images, self.header.size)
        found: Arrays = self._program(images)
        return Output(found[0], found[1], found[2] if len(found) > 2 else None)


def compiled_engine(path: str | Path, **arguments: object) -> TorchEngine:
    """Gives a `TorchEngine` whose network goes through `torch.compile`."""
    return TorchEngine(path, compiled=True, **arguments)  # type: ignore[arg-type]


def _program(graph: nn.Module, size: Sequence[int], device: str, streams: int, compiled: bool) -> Program:
    if compiled:
        graph = torch.compile(graph, dynamic=False)  # type: ignore[assignment]

    def make(count: int) -> Program:
        if device == "cpu":
            return EagerProgram(graph, device)
        return record(graph, (count, *size, 3), device)

    fixed = compiled or device != "cpu"
    return StaticPrograms(make, streams=streams) if fixed else make(0)


def _check_precision(precision: str) -> str:
    if precision not in ("auto", *_DTYPES):
        raise ValueError(f"torch has no precision {precision!r}; use auto, {', '.join(_DTYPES)}.")
    return "fp32" if precision == "auto" else precision


def _check_device(device: str) -> str:
    if device not in ("auto", "cpu") and not device.startswith("cuda"):
        raise ValueError(f"device {device!r} is unknown; use auto, cpu or cuda.")
    if device.startswith("cuda") and not torch.cuda.is_available():
        raise ValueError("device cuda was asked for, but torch finds no GPU; use --device cpu.")
    return "cuda" if device == "auto" and torch.cuda.is_available() else device.replace("auto", "cpu")


def _check_compiler(device: str) -> None:
    """Raises ValueError if `torch.compile` lacks the compiler that it needs on a processor."""
    named = [os.environ["CXX"]] if os.environ.get("CXX") else []
    if device == "cpu" and not any(map(shutil.which, (*named, *_COMPILERS))):
        raise ValueError(
            "The engine torch-compiled needs a C++ compiler on a processor (g++, or the one in CXX): install "
            "one, or take the engine torch."
        )


def _set_threads(threads: int | None, streams: int) -> None:
    """Shares the threads among the streams; torch gives as many to each thread that calls it."""
    if threads is not None or streams > 1:
        torch.set_num_threads(max(1, (threads or _THREADS) // streams))
