"""One network on every engine that is installed, in every precision."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from yolino.benchmark.setup import Setup
from yolino.inference import Predictor
from yolino.inference.engines import ENGINES, EngineKind, open_engine
from yolino.inference.loading import EngineChoice

# Torch's 16-bit floats on a processor take seconds: nobody would ask for them.
_SENSELESS = {("torch", "cpu", "fp16"), ("torch-compiled", "cpu", "fp16")}


class Contestants(NamedTuple):
    """What can race, and why the rest cannot.

    Attributes:
        predictors: By engine and precision, such as "openvino bf16".
        absent: A sentence for each engine that is not there.
    """

    predictors: dict[str, Predictor]
    absent: list[str]


def contestants(files: Sequence[Path], setup: Setup, *, threshold: float | None = None) -> Contestants:
    """Opens the files of one network with every engine that reads them, in every precision that it has.

    Args:
        files: The same network as checkpoint, .onnx, .xml, quantized or not; what there is.
        setup: Device, threads and streams.
        threshold: Lowest score of a segment; the header's by default.
    """
    quantized = {file: open_engine(file).header.precision == "int8" for file in files}
    device = "cuda" if setup.device == "cuda" else "cpu"
    found: dict[str, Predictor] = {}
    absent: list[str] = []
    for name, kind in ENGINES.items():
        if not (kind.automatic or device == "cuda") or device not in kind.precisions:
            continue
        if kind.missing is not None:
            absent.append(f"{name}: not measured, {kind.missing} is not installed ({kind.install})")
            continue
        for choice, file in _choices(name, kind, quantized, device, setup):
            try:
                engine = open_engine(file, **vars(choice))
            except ValueError as error:  # this processor has no such arithmetic
                absent.append(f"{name} {choice.precision}: not measured, {error}")
                continue
            key = f"{name} {engine.precision}"
            found.setdefault(key, Predictor(engine, threshold=threshold))
    return Contestants(found, absent)


def _choices(
    name: str, kind: EngineKind, files: Mapping[Path, bool], device: str, setup: Setup
) -> Iterator[tuple[EngineChoice, Path]]:
    """Gives each precision with the file that it runs from; `files` says which are quantized."""
    for file, quantized in files.items():
        for precision in kind.precisions[device] if file.suffix in kind.suffixes else ():
            if (precision == "int8") == quantized and (name, device, precision) not in _SENSELESS:
                yield EngineChoice(name, device, precision, setup.threads, setup.streams), file


__all__ = ["Contestants", "contestants"]
