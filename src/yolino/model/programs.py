"""How a torch network is started: step by step, or as a CUDA graph for a fixed number of images."""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

import numpy as np
import torch
from jaxtyping import UInt8
from torch import Tensor, nn

logger = logging.getLogger(__name__)
LARGEST = 64  # images in one program
_WARM_UPS = 3

Arrays = list[np.ndarray]
Program = Callable[[UInt8[np.ndarray, "b h w 3"]], Arrays]


class EagerProgram:
    """Runs a network as it is: batches of any size, from any number of threads.

    Args:
        graph: Gives tensors for images `(b, h, w, 3)`.
        device: Where it is.
        exact: Whether a GPU must not round float32 to TF32 (see `exact_convolutions`).
    """

    def __init__(self, graph: nn.Module, device: str, *, exact: bool = False) -> None:
        self._graph, self._device, self._exact = graph, device, exact

    @torch.inference_mode()
    def __call__(self, images: UInt8[np.ndarray, "b h w 3"]) -> Arrays:
        """Gives the network's outputs, which belong to the caller."""
        if not images.flags.writeable:  # torch warns of such arrays, though nothing writes to them here
            images = images.copy()
        with exact_convolutions() if self._exact else nullcontext():
            return [output.cpu().numpy() for output in self._graph(torch.from_numpy(images).to(self._device))]


class GraphProgram:
    """Runs a network on a fixed number of images as one recorded CUDA graph.

    The graph reads and writes always the same memory: a call fills the input, starts the graph and copies the
    outputs, so only one thread may call at a time. Pinned memory of the host is copied without waiting.

    Args:
        graph: Gives tensors for images `(b, h, w, 3)`.
        shape: Shape of the images.
        device: A GPU.
    """

    def __init__(self, graph: nn.Module, shape: tuple[int, ...], device: str) -> None:
        self._incoming = _pinned(shape, torch.uint8)
        self._images = torch.zeros(shape, dtype=torch.uint8, device=device)
        self._stream = torch.cuda.Stream(device)  # type: ignore[no-untyped-call]
        self._stream.wait_stream(torch.cuda.current_stream(device))
        with torch.inference_mode(), torch.cuda.stream(self._stream), exact_convolutions():
            for _ in range(_WARM_UPS):  # what torch decides and reserves at first must not be recorded
                graph(self._images)
            self._stream.synchronize()
            self._recorded = torch.cuda.CUDAGraph()
            with torch.cuda.graph(
                self._recorded, stream=self._stream, capture_error_mode="thread_local"
            ):  # other threads may work on the GPU meanwhile
                self._outputs: tuple[Tensor, ...] = graph(self._images)
        self._outgoing = [_pinned(tuple(o.shape), o.dtype) for o in self._outputs]

    def __call__(self, images: UInt8[np.ndarray, "b h w 3"]) -> Arrays:
        """Gives the network's outputs, which belong to the caller."""
        np.copyto(self._incoming.numpy(), images)
        with torch.inference_mode(), torch.cuda.stream(self._stream):
            self._images.copy_(self._incoming, non_blocking=True)
            self._recorded.replay()
            for outgoing, output in zip(self._outgoing, self._outputs, strict=True):
                outgoing.copy_(output, non_blocking=True)
            self._stream.synchronize()
        return [outgoing.numpy().copy() for outgoing in self._outgoing]


class StaticPrograms:
    """Runs batches of any size with programs for 1, 2, 4, ... images; they are made when first needed.

    A batch is filled up to the next of these numbers with black images, whose results are dropped. One beyond
    the largest is done in parts. So there are few programs, whatever comes.

    Args:
        make: Gives the program for a number of images.
        streams: Programs for the same number that may run at once; further callers wait.
        largest: Largest number of images, a power of two.
    """

    def __init__(self, make: Callable[[int], Program], *, streams: int = 1, largest: int = LARGEST) -> None:
        self._make, self._streams, self._largest = make, streams, largest
        self._free: dict[int, queue.LifoQueue[Program]] = {}
        self._made: dict[int, int] = {}
        self._lock = threading.Lock()

    def __call__(self, images: UInt8[np.ndarray, "b h w 3"]) -> Arrays:
        """Gives the outputs for all images."""
        step = self._largest
        parts = [self._run(images[i : i + step]) for i in range(0, max(len(images), 1), step)]
        return parts[0] if len(parts) == 1 else [np.concatenate(part) for part in zip(*parts, strict=True)]

    def _run(self, images: UInt8[np.ndarray, "b h w 3"]) -> Arrays:
        count = len(images)
        full = 1 << (max(count, 1) - 1).bit_length()
        if full > count:
            padding = np.zeros((full - count, *images.shape[1:]), np.uint8)
            images = np.concatenate([images, padding])
        free, program = self._take(full)
        try:
            return [output[:count] for output in program(images)]
        finally:
            free.put(program)

    def _take(self, count: int) -> tuple[queue.LifoQueue[Program], Program]:
        with self._lock:
            free = self._free.setdefault(count, queue.LifoQueue())
            if free.empty() and self._made.get(count, 0) < self._streams:
                program = self._make(count)
                self._made[count] = self._made.get(count, 0) + 1
                return free, program
        return free, free.get()


def _pinned(shape: tuple[int, ...], dtype: torch.dtype) -> Tensor:
    """Gives memory of the host that a GPU reads and writes by itself."""
    return torch.empty(shape, dtype=dtype, pin_memory=True)


def record(graph: nn.Module, shape: tuple[int, ...], device: str) -> Program:
    """Gives a `GraphProgram`; where the network cannot be recorded, says so and gives an `EagerProgram`.

    A network that waits for a number from the GPU, say, cannot.
    """
    try:
        return GraphProgram(graph, shape, device)
    except torch.cuda.OutOfMemoryError:
        raise
    except RuntimeError as error:
        logger.warning("The network runs step by step, as it cannot be a CUDA graph: %s", error)
        return EagerProgram(graph, device, exact=True)


def exact_convolutions() -> AbstractContextManager[None]:
    """Gives a context in which a GPU's convolutions of float32 are not rounded to TF32.

    TF32 has 10 bits of mantissa. "fp32" is to mean the same on every device.
    """
    return torch.backends.cudnn.flags(enabled=True, benchmark=True, deterministic=False, allow_tf32=False)


__all__ = ["LARGEST", "Arrays", "EagerProgram", "GraphProgram", "Program", "StaticPrograms", "record"]
