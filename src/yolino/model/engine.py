"""The torch engine: runs a network behind the same face as the other engines (`yolino.inference.engines`)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from jaxtyping import UInt8
from torch import Tensor, nn

from yolino.header import Header
from yolino.model.checkpoint import load_checkpoint
from yolino.model.network import Network
from yolino.types import Output


class Exportable(nn.Module):
    """The whole graph up to the seam: RGB pixels -> segments in pixels, scores, class probabilities."""

    def __init__(self, network: Network, size: tuple[int, int]) -> None:
        super().__init__()
        self.network, self.size = network, size

    def forward(self, images: UInt8[Tensor, "b h w 3"]) -> tuple[Tensor, ...]:
        """Gives end points `(b, n, 2, 2)`, scores `(b, n)` and, with classes, probabilities `(b, n, c)`."""
        prediction = self.network(images.permute(0, 3, 1, 2).float())
        endpoints, scores, probabilities = self.network.decode(prediction, self.size)
        return (endpoints, scores, probabilities) if self.network.num_classes else (endpoints, scores)


class TorchEngine:
    """Runs a checkpoint with torch.

    Args:
        path: A checkpoint (`.safetensors`).
        device: `auto`, `cpu` or `cuda`.
        threads: Threads of the CPU, or None for torch's choice.
    """

    def __init__(self, path: str | Path, *, device: str = "auto", threads: int | None = None) -> None:
        network, self.header = load_checkpoint(path)
        self._start(network, device, threads)

    @classmethod
    def of(cls, network: Network, header: Header, *, device: str = "cpu") -> TorchEngine:
        """Gives an engine for a network in memory (validation during training)."""
        engine = cls.__new__(cls)
        engine.header = header
        engine._start(network, device, None)
        return engine

    def _start(self, network: Network, device: str, threads: int | None) -> None:
        if device not in ("auto", "cpu") and not device.startswith("cuda"):
            raise ValueError(f"device {device!r} is unknown; use auto, cpu or cuda.")
        if device.startswith("cuda") and not torch.cuda.is_available():
            raise ValueError("device cuda was asked for, but torch finds no GPU; use --device cpu.")
        if threads:
            torch.set_num_threads(threads)
        self.device = (
            "cuda" if device == "auto" and torch.cuda.is_available() else device.replace("auto", "cpu")
        )
        self.graph = Exportable(network, self.header.size).eval().to(self.device)

    @torch.inference_mode()
    def __call__(self, images: UInt8[np.ndarray, "b h w 3"]) -> Output:
        """Gives what the network says about a batch of RGB images of its input size."""
        outputs = [o.cpu().numpy() for o in self.graph(torch.from_numpy(images).to(self.device))]
        return Output(outputs[0], outputs[1], outputs[2] if len(outputs) > 2 else None)
