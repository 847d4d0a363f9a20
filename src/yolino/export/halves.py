"""Weights of 16 bits, in half the bytes."""

from __future__ import annotations

import numpy as np

from yolino.export.packages import needed

_FEW = 256  # numbers: biases are small and stay as they are
_LARGEST_HALF = 60_000.0


def halved(model: bytes) -> bytes:
    """Gives an ONNX model whose weights are stored with 16 bits and widened to 32 when it is loaded."""
    onnx = needed("onnx", "Exporting")
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


__all__ = ["halved"]
