"""Export: a checkpoint becomes an ONNX file with decoding, normalization and header inside."""

from __future__ import annotations

import json
import logging
import tempfile
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import onnx
import torch

from yolino.config import override
from yolino.header import Header
from yolino.inference.engines import Engine, OnnxEngine
from yolino.io import write_atomic
from yolino.model.checkpoint import load_checkpoint
from yolino.model.engine import Exportable, TorchEngine
from yolino.model.network import Network

logger = logging.getLogger(__name__)
FORMATS = ("onnx",)
TOLERANCE_PX = 1e-3
TOLERANCE_SCORE = 1e-4
# What rounding the weights to 16 bits may change; beyond, something else is wrong.
COMPACT_PX = 0.1
COMPACT_SCORE = 0.01
_FEW = 256  # numbers: biases are small and stay as they are
_LARGEST_HALF = 60_000.0


def export(
    checkpoint: str | Path,
    *,
    format: str = "onnx",
    out: str | Path | None = None,
    changes: Sequence[str] = (),
    compact: bool = False,
) -> Path:
    """Writes the network of a checkpoint as one file that needs no torch.

    The file is run beside the torch network before it gets its name: end points must agree to 1e-3 px.
    A compact one is compared, too: rounding moves its end points by up to 0.1 px.

    Args:
        checkpoint: A `.safetensors` file of `yolino train`.
        format: `onnx`.
        out: The file to write; beside the checkpoint if None.
        changes: `key=value` changes to the header, such as `postprocess.threshold=0.3` after tuning.
        compact: Whether to store the weights with 16 bits, in half the bytes; the network still computes with
            32 bits and is as fast.

    Returns:
        The file that was written.

    Raises:
        ValueError: Unknown format, or a checkpoint that cannot be read.
        RuntimeError: The exported network disagrees with torch.
    """
    if format not in FORMATS:
        raise ValueError(f"format {format!r} is unknown; use one of {', '.join(FORMATS)}.")
    network, header = load_checkpoint(checkpoint)
    header = changed_header(header, changes)
    out = Path(out) if out is not None else Path(checkpoint).with_suffix(".onnx")
    data = onnx_bytes(network, header)
    with tempfile.TemporaryDirectory() as folder:
        trial = Path(folder) / "model.onnx"
        trial.write_bytes(data)
        exact = OnnxEngine(trial, device="cpu")
        _compare(TorchEngine.of(network, header), exact, header, (TOLERANCE_PX, TOLERANCE_SCORE))
        if compact:
            data = compact_bytes(data)
            rounded = Path(folder) / "compact.onnx"
            rounded.write_bytes(data)
            _compare(exact, OnnxEngine(rounded, device="cpu"), header, (COMPACT_PX, COMPACT_SCORE))
    write_atomic(out, data)
    return out


def changed_header(header: Header, changes: Sequence[str]) -> Header:
    """Gives the header with `key=value` changes.

    Raises:
        ValueError: A change is not of that form, names an unknown key, or has a value that is not allowed.
    """
    values = json.loads(header.to_json())
    for change in changes:
        override(values, change)
    return Header.from_json(json.dumps(values)) if changes else header


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
    entry = model.metadata_props.add()
    entry.key, entry.value = "yolino", header.to_json()
    onnx.checker.check_model(model)
    serialized: bytes = model.SerializeToString()
    return serialized


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


def compact_bytes(model: bytes) -> bytes:
    """Gives an ONNX model whose weights are stored with 16 bits and widened to 32 when it is loaded."""
    proto = onnx.load_model_from_string(model)
    graph = proto.graph
    casts = []
    for weights in graph.initializer:
        values = onnx.numpy_helper.to_array(weights)
        if values.dtype != np.float32 or values.size < _FEW or np.abs(values).max() > _LARGEST_HALF:
            continue
        name = weights.name
        weights.CopyFrom(onnx.numpy_helper.from_array(values.astype(np.float16), f"{name}_half"))
        casts.append(onnx.helper.make_node("Cast", [f"{name}_half"], [name], to=onnx.TensorProto.FLOAT))
    nodes = [*casts, *graph.node]
    del graph.node[:]
    graph.node.extend(nodes)
    onnx.checker.check_model(proto)
    serialized: bytes = proto.SerializeToString()
    return serialized


def _compare(one: Engine, other: Engine, header: Header, tolerances: tuple[float, float]) -> None:
    """Runs both on random pixels.

    Raises:
        RuntimeError: They differ by more than the tolerances, in pixels and in score.
    """
    images = np.random.default_rng(0).integers(0, 256, (2, *header.size, 3), dtype=np.uint8)
    ours, theirs = one(images), other(images)
    pixels = float(np.abs(ours[0] - theirs[0]).max())
    scores = float(np.abs(ours[1] - theirs[1]).max())
    if pixels > tolerances[0] or scores > tolerances[1]:
        raise RuntimeError(
            f"The exported network differs from the one before by {pixels:.2g} px and {scores:.2g} in score."
        )
    logger.info("exported network equals the one before to %.1e px", pixels)
