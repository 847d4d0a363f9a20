"""The files of a model that engines can read; quantized only to be timed, whatever that costs in accuracy."""

from __future__ import annotations

import dataclasses
from importlib import import_module
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from yolino.benchmark.measure import lacking
from yolino.benchmark.setup import Setup
from yolino.export import export
from yolino.export.calibration import Inputs
from yolino.export.run import FORMATS
from yolino.export.source import read_source
from yolino.inference import Predictor
from yolino.inference.loading import model_path
from yolino.types import Polylines, Sample


def model_files(setup: Setup) -> list[Path]:
    """Gives the model's file, and what is made of it: a checkpoint exported, an fp32 network quantized."""
    file = model_path(setup.model)
    files = [file]
    if file.suffix == ".safetensors" and not lacking("torch", "onnx"):
        files.append(export(file, out=setup.folder / f"{file.stem}.onnx").path)
    return [*files, *quantized_copies(files[-1], setup)]


def quantized_copies(file: Path, setup: Setup) -> list[Path]:
    """Gives the int8 copies of a model file, one for each format; none where it cannot be quantized here.

    Args:
        file: An fp32 .onnx file; of another file there are no copies.
        setup: The frame, and a folder for the copies.
    """
    if file.suffix != ".onnx" or lacking("nncf", "openvino", "onnx"):
        return []
    source = read_source(file)
    if source.header.precision == "int8" or not _has_convolutions(source.data):
        return []
    predictor = Predictor(FORMATS["onnx"]().open(file))
    inputs = Inputs(predictor, _Frame(setup.frame), 1, lambda indices, title: indices)
    copies = []
    for name, kind in FORMATS.items():
        target = kind()
        copy = setup.folder / f"{file.stem}-{name}-int8{target.suffix}"
        target.save(
            target.quantize(source.data, inputs), dataclasses.replace(source.header, precision="int8"), copy
        )
        copies.append(copy)
    return copies


def _has_convolutions(data: bytes) -> bool:
    """Tells whether there is more to quantize than the head."""
    graph = import_module("onnx").load_model_from_string(data).graph
    return [node.op_type for node in graph.node].count("Conv") > 1


class _Frame:
    """The frame as a dataset of one image."""

    def __init__(self, image: UInt8[np.ndarray, "h w 3"]) -> None:
        self.classes: tuple[str, ...] = ()
        self.directed = True
        self._sample = Sample("frame", image, Polylines.from_list([]))

    def __len__(self) -> int:
        return 1

    def __getitem__(self, index: int) -> Sample:
        return self._sample


__all__ = ["model_files", "quantized_copies"]
