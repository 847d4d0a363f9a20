"""A model file that detects bright lines on dark ground, by arithmetic and without any training.

Each cell looks at its own pixels alone: the brightness-weighted mean is the midpoint of its segment, the
spread along x and y its extent, the sign of the covariance says which diagonal. A cell answers where it holds
light. So the answer is the same in every window, to the last bits of float32.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from yolino.header import Header

STRIDE = 16


def striped_header(
    size: tuple[int, int] = (128, 128), scale: float = 1.0, classes: tuple[str, ...] = ()
) -> Header:
    return Header(
        version="0.1.0",
        name="striped",
        size=size,
        stride=STRIDE,
        predictors=1,
        representation="po",
        classes=classes,
        fit="window",
        scale=scale,
        directed=False,
        postprocess={"threshold": 0.5, "linker": "chain", "linker_options": {"min_length_cells": 2.0}},
        licence="none",
        data="none",
    )


def make_striped_model(path: Path, header: Header) -> Path:
    """Writes the model; with classes the first is that of steep segments, the second of flat ones."""
    import onnx

    node, value = onnx.helper.make_node, onnx.helper.make_tensor_value_info
    float32, uint8 = onnx.TensorProto.FLOAT, onnx.TensorProto.UINT8
    (height, width), n = header.size, header.size[0] * header.size[1] // STRIDE**2
    y, x = np.mgrid[:height, :width].astype(np.float32) % STRIDE + 0.5
    top, left = (np.mgrid[: height // STRIDE, : width // STRIDE] * STRIDE).astype(np.float32)
    constants = {
        "coordinates": np.stack([np.ones_like(x), x, y, x * x, y * y, x * y])[None],
        "corners": np.stack([left, top, left, top])[None],
        "dark": np.float32(128),
        "bright": np.full((1, 1, 1, 1), 20.0, np.float32),
        "least": np.full((1, 1, 1, 1), 1e-3, np.float32),
        "root3": np.full((1, 1, 1, 1), 3**0.5, np.float32),
        "zero": np.float32(0),
        "high": np.float32(0.9),
        "low": np.float32(0.1),
        "one": np.float32(1),
        "flat": np.array([0, n], np.int64),
        "points": np.array([0, n, 2, 2], np.int64),
        "column": np.array([0, n, 1], np.int64),
    }
    pool = {"kernel_shape": [STRIDE, STRIDE], "strides": [STRIDE, STRIDE]}
    nodes = [
        node("Cast", ["images"], ["pixels"], to=float32),
        node("ReduceMean", ["pixels"], ["gray"], axes=[3], keepdims=0),
        node("Sub", ["gray", "dark"], ["above"]),
        node("Relu", ["above"], ["light2"]),
        node("Unsqueeze", ["light2"], ["light"], axes=[1]),
        node("Mul", ["light", "coordinates"], ["weighted"]),
        node("AveragePool", ["weighted"], ["moments"], **pool),
        node("Split", ["moments"], ["m", "mx", "my", "mxx", "myy", "mxy"], axis=1),
        node("Max", ["m", "least"], ["mass"]),
        node("Div", ["mx", "mass"], ["cx"]),
        node("Div", ["my", "mass"], ["cy"]),
    ]
    for a, b in ("xx", "yy", "xy"):
        nodes += [
            node("Div", [f"m{a}{b}", "mass"], [f"e{a}{b}"]),
            node("Mul", [f"c{a}", f"c{b}"], [f"p{a}{b}"]),
            node("Sub", [f"e{a}{b}", f"p{a}{b}"], [f"v{a}{b}"]),
        ]
    nodes += [
        node("Relu", ["vxx"], ["rxx"]),
        node("Relu", ["vyy"], ["ryy"]),
        node("Sqrt", ["rxx"], ["sx"]),
        node("Sqrt", ["ryy"], ["sy"]),
        node("Mul", ["sx", "root3"], ["hx"]),  # half the length of an even line is root 3 times its spread
        node("Mul", ["sy", "root3"], ["hy0"]),
        node("Less", ["vxy", "zero"], ["falling"]),
        node("Neg", ["hy0"], ["hyn"]),
        node("Where", ["falling", "hyn", "hy0"], ["hy"]),
        node("Sub", ["cx", "hx"], ["x0"]),
        node("Sub", ["cy", "hy"], ["y0"]),
        node("Add", ["cx", "hx"], ["x1"]),
        node("Add", ["cy", "hy"], ["y1"]),
        node("Concat", ["x0", "y0", "x1", "y1"], ["local"], axis=1),
        node("Add", ["local", "corners"], ["placed"]),
        node("Transpose", ["placed"], ["last"], perm=[0, 2, 3, 1]),
        node("Reshape", ["last", "points"], ["endpoints"]),
        node("Greater", ["m", "bright"], ["lit"]),
        node("Where", ["lit", "high", "low"], ["scored"]),
        node("Reshape", ["scored", "flat"], ["scores"]),
        node("Less", ["hx", "hy0"], ["steep"]),
        node("Cast", ["steep"], ["steep_share"], to=float32),
        node("Reshape", ["steep_share", "column"], ["first"]),
        node("Sub", ["one", "first"], ["second"]),
        node("Concat", ["first", "second"], ["probabilities"], axis=2),
    ]
    outputs = {"endpoints": [n, 2, 2], "scores": [n]} | ({"probabilities": [n, 2]} if header.classes else {})
    graph = onnx.helper.make_graph(
        nodes,
        "striped",
        [value("images", uint8, ["batch", height, width, 3])],
        [value(name, float32, ["batch", *shape]) for name, shape in outputs.items()],
        [onnx.numpy_helper.from_array(np.asarray(array), name) for name, array in constants.items()],
    )
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 10)], ir_version=8)
    entry = model.metadata_props.add()
    entry.key, entry.value = "yolino", header.to_json()
    path.write_bytes(model.SerializeToString())
    return path
