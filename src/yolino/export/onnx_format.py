"""ONNX files; int8 as pairs of quantize and dequantize nodes, by ONNX Runtime's quantizer."""

from __future__ import annotations

import importlib
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from yolino.export.calibration import Inputs
from yolino.export.formats import refuse_to_quantize
from yolino.export.metadata import with_header
from yolino.export.packages import needed
from yolino.header import Header
from yolino.inference.engines import Engine, OnnxEngine
from yolino.io import write_atomic

_QUANTIZED = ("Conv", "ConvTranspose")


class OnnxFormat:
    """`.onnx` files.

    Weights are quantized to 8 bits with a sign, a scale for each channel; activations to 8 bits without a
    sign, whose range is that of the calibration images. So the file means the same in ONNX Runtime and
    OpenVINO.
    """

    suffix = ".onnx"

    def check(self) -> None:
        """Raises ModuleNotFoundError if the package onnx is missing."""
        needed("onnx", "Exporting")

    def convert(self, data: bytes) -> bytes:
        """Gives the bytes as they are."""
        return data

    def quantize(self, data: bytes, inputs: Inputs) -> bytes:
        """Gives the model quantized to 8 bits (see `Format`)."""
        quantization = importlib.import_module("onnxruntime.quantization")
        model = needed("onnx", "Exporting").load_model_from_string(folded(data))
        for i, node in enumerate(model.graph.node):
            node.name = node.name or f"node_{i}"  # nodes are left out by name
        heads = head_names(model.graph)
        refuse_to_quantize(sum(node.op_type in _QUANTIZED for node in model.graph.node), len(heads))
        mark = model.metadata_props.add()  # or its quantizer asks on the log for what `folded` has done
        mark.key, mark.value = "onnx.quant.pre_process", "onnxruntime.quant"
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "int8.onnx"
            quantization.quantize_static(
                model,
                str(out),
                _Reader(inputs),
                quant_format=quantization.QuantFormat.QDQ,
                per_channel=True,
                activation_type=quantization.QuantType.QUInt8,
                weight_type=quantization.QuantType.QInt8,
                op_types_to_quantize=list(_QUANTIZED),
                nodes_to_exclude=heads,
            )
            return out.read_bytes()

    def save(self, model: bytes, header: Header, path: Path) -> None:
        """Writes the model with the header."""
        path.write_bytes(with_header(model, header))

    def open(self, path: Path) -> Engine:
        """Gives the ONNX Runtime engine."""
        return OnnxEngine(path, device="cpu")

    def place(self, trial: Path, out: Path) -> list[Path]:
        """Gives the file its name."""
        write_atomic(out, trial.read_bytes())
        return [out]


class _Reader:
    """Hands out inputs as ONNX Runtime's quantizer asks for them."""

    def __init__(self, inputs: Inputs) -> None:
        self._inputs: Iterator[UInt8[np.ndarray, "1 h w 3"]] = iter(inputs)

    def get_next(self) -> dict[str, UInt8[np.ndarray, "1 h w 3"]] | None:
        pixels = next(self._inputs, None)
        return None if pixels is None else {"images": pixels}


def folded(data: bytes) -> bytes:
    """Gives an ONNX model whose constants are computed and whose batch norms are part of the convolutions.

    The quantizers need the weights as they are when the network runs.
    """
    runtime = importlib.import_module("onnxruntime")
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "folded.onnx"
        options = runtime.SessionOptions()
        options.log_severity_level = 3
        options.graph_optimization_level = runtime.GraphOptimizationLevel.ORT_ENABLE_BASIC
        options.optimized_model_filepath = str(out)
        runtime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
        return out.read_bytes()


def head_names(graph: Any) -> list[str]:
    """Gives the names of the convolutions that no other one follows, of an `onnx.GraphProto`."""
    makers = {output: node for node in graph.node for output in node.output}
    heads, seen = set(), set()
    open_names = [output.name for output in graph.output]
    while open_names:
        name = open_names.pop()
        if name in seen or name not in makers:
            continue
        seen.add(name)
        node = makers[name]
        if node.op_type in _QUANTIZED:
            heads.add(node.name)
        else:
            open_names += node.input
    return sorted(heads)


__all__ = ["OnnxFormat", "folded", "head_names"]
