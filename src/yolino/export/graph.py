"""A checkpoint -> an ONNX graph with normalization and decoding inside. Needs torch."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import onnx
import torch

from yolino.export.comparison import compare
from yolino.export.metadata import with_header
from yolino.header import Header
from yolino.inference.engines import OnnxEngine
from yolino.model.engine import Exportable, TorchEngine
from yolino.model.network import Network

TOLERANCES = (1e-3, 1e-4)  # pixels, score


def checked_bytes(network: Network, header: Header) -> bytes:
    """Gives what `onnx_bytes` gives, after running it beside the network.

    Raises:
        RuntimeError: It disagrees with torch by more than 1e-3 px.
    """
    data = onnx_bytes(network, header)
    with tempfile.TemporaryDirectory() as folder:
        trial = Path(folder) / "model.onnx"
        trial.write_bytes(data)
        compare(TorchEngine.of(network, header), OnnxEngine(trial, device="cpu"), TOLERANCES)
    return data


def onnx_bytes(network: Network, header: Header) -> bytes:
    """Gives the network as ONNX with a dynamic batch and the header as metadata `yolino`."""
    names = ["endpoints", "scores", "probabilities"][: 3 if network.num_classes else 2]
    example = torch.zeros(2, *header.size, 3, dtype=torch.uint8)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the tracer: the size is constant on purpose
        file = Path(folder) / "model.onnx"
        torch.onnx.export(
            Exportable(network, header.size).eval(),
            (example,),
            str(file),
            input_names=["images"],
            output_names=names,
            dynamic_axes={name: {0: "batch"} for name in ["images", *names]},
            opset_version=17,
            dynamo=False,
        )
        model = onnx.load(str(file))
    fold_pixel_std(model.graph)
    data = with_header(model, header)
    onnx.checker.check_model(data)
    return data


def fold_pixel_std(graph: onnx.GraphProto) -> None:
    """Moves the division by the pixels' standard deviation into the weights of the first convolution.

    The result is the same and a pass over the image is saved. (The subtraction of the mean stays: the border
    that the convolution adds is zero after it, and a bias could not say so.) A graph of another form is left
    as it is.
    """
    makers = {output: node for node in graph.node for output in node.output}
    readers: dict[str, list[onnx.NodeProto]] = {}
    for node in graph.node:
        for name in node.input:
            readers.setdefault(name, []).append(node)
    for division in [node for node in graph.node if node.op_type == "Div"]:
        image, divisor = division.input
        after = readers.get(division.output[0], [])
        if len(after) != 1 or after[0].op_type != "Conv":
            continue
        weights = [w for w in graph.initializer if w.name == after[0].input[1]]
        values = _constant(divisor, makers, graph)
        if len(weights) == 1 and values is not None:
            folded = onnx.numpy_helper.to_array(weights[0]) / values.reshape(1, -1, 1, 1)
            weights[0].CopyFrom(onnx.numpy_helper.from_array(folded, weights[0].name))
            after[0].input[0] = image
            graph.node.remove(division)
            if divisor in makers and len(readers[divisor]) == 1:
                graph.node.remove(makers[divisor])


def _constant(name: str, makers: Mapping[str, onnx.NodeProto], graph: onnx.GraphProto) -> np.ndarray | None:
    """Gives the value of an initializer or of the output of a constant node."""
    for value in graph.initializer:
        if value.name == name:
            return np.asarray(onnx.numpy_helper.to_array(value))
    if name in makers and makers[name].op_type == "Constant":
        return np.asarray(onnx.numpy_helper.to_array(makers[name].attribute[0].t))
    return None


__all__ = ["TOLERANCES", "checked_bytes", "fold_pixel_std", "onnx_bytes"]
