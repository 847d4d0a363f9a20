"""What tests of several rooms share: a tiny model file, and the real data where it is there."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from yolino.header import Header

HEADER = Header(
    version="0.1.0",
    name="tiny",
    size=(64, 128),
    stride=16,
    predictors=1,
    representation="po",
    postprocess={"threshold": 0.5, "linker": "chain"},
    licence="none",
    data="two made-up lines",
    metrics={"f1": 1.0},
    commit="0" * 40,
)


@pytest.fixture(scope="session")
def header() -> Header:
    """The header of `tiny_model`."""
    return HEADER


@pytest.fixture(scope="session")
def tiny_endpoints() -> np.ndarray:
    """What `tiny_model` sees in images that are not black: lines up at x = 40 and 88, in 4 pieces each."""
    steps = np.arange(4)
    pieces = [[[(x, 64 - 16 * i), (x, 48 - 16 * i)] for i in steps] for x in (40.0, 88.0)]
    return np.array(pieces, np.float32).reshape(8, 2, 2)


@pytest.fixture(scope="session")
def make_model(tiny_endpoints: np.ndarray) -> Callable[..., Path]:
    """Writes ONNX files like exported networks; the scores are .9 where an image is not black."""
    onnx = pytest.importorskip("onnx", reason="onnx builds the model of this test")
    node, value = onnx.helper.make_node, onnx.helper.make_tensor_value_info
    float32, uint8 = onnx.TensorProto.FLOAT, onnx.TensorProto.UINT8

    def make(
        path: Path,
        *,
        header: Header | str | None = HEADER,
        outputs: tuple[str, ...] = ("endpoints", "scores"),
        endpoints: np.ndarray = tiny_endpoints,
    ) -> Path:
        n, size = len(endpoints), header.size if isinstance(header, Header) else HEADER.size
        classes = len(header.classes) if isinstance(header, Header) else 0
        constants = {
            "every_endpoint": endpoints[None].astype(np.float32),
            "every_score": np.full((1, n), 0.9, np.float32),
            "every_class": np.tile(np.eye(max(classes, 1), dtype=np.float32)[-1], (1, n, 1)),
            "deep": np.array([-1, 1, 1, 1], np.int64),
            "flat": np.array([-1, 1], np.int64),
            "zero": np.zeros(1, np.float32),
        }
        nodes = [
            node("Cast", ["images"], ["pixels"], to=float32),
            node("ReduceMax", ["pixels"], ["brightest"], axes=[1, 2, 3], keepdims=0),
            node("Clip", ["brightest"], ["light"], min=0.0, max=1.0),
            node("Reshape", ["light", "flat"], ["light2"]),
            node("Mul", ["light2", "zero"], ["none2"]),
            node("Reshape", ["none2", "deep"], ["none4"]),
            node("Unsqueeze", ["none2"], ["none3"], axes=[2]),
            node("Mul", ["light2", "every_score"], ["scores"]),
            node("Add", ["none4", "every_endpoint"], ["endpoints"]),
            node("Add", ["none3", "every_class"], ["probabilities"]),
        ]
        ranks = {"scores": [n], "endpoints": [n, 2, 2], "probabilities": [n, max(classes, 1)]}
        graph = onnx.helper.make_graph(
            nodes,
            "tiny",
            [value("images", uint8, ["batch", *size, 3])],
            [value(name, float32, ["batch", *ranks[name]]) for name in outputs],
            [onnx.numpy_helper.from_array(array, name) for name, array in constants.items()],
        )
        model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 9)], ir_version=8)
        if header is not None:
            entry = model.metadata_props.add()
            entry.key, entry.value = "yolino", header if isinstance(header, str) else header.to_json()
        path.write_bytes(model.SerializeToString())
        return path

    return make


@pytest.fixture(scope="session")
def tiny_model(make_model: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model that sees the same two lines in every image that is not black; 64x128, stride 16."""
    return make_model(tmp_path_factory.mktemp("model") / "tiny.onnx")


@pytest.fixture(scope="session")
def class_model(make_model: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same with the classes "solid" and "dashed": both lines are dashed."""
    header = dataclasses.replace(HEADER, classes=("solid", "dashed"))
    outputs = ("endpoints", "scores", "probabilities")
    return make_model(tmp_path_factory.mktemp("model") / "classes.onnx", header=header, outputs=outputs)


@pytest.fixture(scope="session")
def tusimple_root() -> Path:
    """The TuSimple frames beside the checkout or in `$YOLINO_DATA`; without them the test is skipped."""
    data = os.environ.get("YOLINO_DATA") or Path(__file__).parents[2] / "shared" / "data"
    root = Path(data) / "tusimple"
    if not root.is_dir():
        pytest.skip(
            f"the TuSimple frames are not in {root}; set YOLINO_DATA to the folder that holds tusimple/"
        )
    return root
