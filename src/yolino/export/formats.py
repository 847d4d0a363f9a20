"""What every file format of an exported network can do."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from yolino.export.calibration import Inputs
from yolino.header import Header
from yolino.inference.engines import Engine


@runtime_checkable
class Format(Protocol):
    """A file format.

    Attributes:
        suffix: Of its files.
    """

    suffix: str

    def check(self) -> None:
        """Raises ModuleNotFoundError, with what to do, if a package is missing."""
        ...

    def convert(self, data: bytes) -> Any:
        """Gives the model in memory, from an ONNX file without metadata."""
        ...

    def quantize(self, data: bytes, inputs: Inputs) -> Any:
        """Gives the model quantized to 8 bits, from an ONNX file without metadata.

        The head's convolution and the decoding after it stay in floating point.

        Raises:
            ValueError: It has nothing to quantize.
        """
        ...

    def save(self, model: Any, header: Header, path: Path) -> None:
        """Writes the model where nobody reads it yet."""
        ...

    def open(self, path: Path) -> Engine:
        """Gives the engine of this format, on the processor."""
        ...

    def place(self, trial: Path, out: Path) -> list[Path]:
        """Puts what `save` wrote to its final name, wholly or not at all; gives the files."""
        ...


def refuse_to_quantize(convolutions: int, heads: int) -> None:
    """Raises ValueError if no convolution is left beside the heads."""
    if convolutions <= heads:
        raise ValueError(
            f"There is nothing to quantize: the network has {convolutions} convolutions, and the last stays "
            "in floating point. Take --precision fp16."
        )


__all__ = ["Format", "refuse_to_quantize"]
