"""A checkpoint becomes an ONNX file that equals torch and carries its header."""

import dataclasses

import numpy as np
import onnx
import pytest
import torch

from yolino.export import export, onnx_bytes
from yolino.export.comparison import compare
from yolino.export.halves import halved
from yolino.header import Header
from yolino.inference import OnnxEngine
from yolino.model.checkpoint import load_checkpoint, save_checkpoint
from yolino.model.engine import TorchEngine
from yolino.model.network import Network
from yolino.model.representations import REPRESENTATIONS

TINY = {
    "backbone": "residual",
    "backbone_args": {"widths": [8, 8, 8, 8], "blocks": [1, 1, 1, 1], "stem": 4},
    "neck_width": 8,
    "predictors": 2,
}


def checkpoint(folder, representation="po", classes=(), **changes):
    torch.manual_seed(0)
    arguments = {**TINY, "representation": representation, "num_classes": len(classes), **changes}
    network = Network(**arguments).eval()
    with torch.no_grad():  # outputs that depend on the image
        network.head.weight.normal_(std=30)
    header = Header("0", "tiny", (64, 96), network.stride, 2, representation, classes=classes)
    path = folder / "tiny.safetensors"
    save_checkpoint(path, network.state_dict(), header, arguments)
    return path


@pytest.mark.parametrize("representation", list(REPRESENTATIONS))
@pytest.mark.parametrize("classes", [(), ("a", "b")])
def test_onnx_equals_torch_for_any_batch(tmp_path, representation, classes):
    path = checkpoint(tmp_path, representation, classes)
    engine, twin = OnnxEngine(export(path).path, device="cpu"), TorchEngine(path)
    assert engine.header == twin.header
    rng = np.random.default_rng(1)
    for batch in (1, 3):
        images = rng.integers(0, 256, (batch, 64, 96, 3), dtype=np.uint8)
        ours, theirs = engine(images), twin(images)
        np.testing.assert_allclose(ours.endpoints, theirs.endpoints, atol=1e-3)
        np.testing.assert_allclose(ours.scores, theirs.scores, atol=1e-5)
        assert (ours.probabilities is None) == (not classes)
        if classes:
            np.testing.assert_allclose(ours.probabilities, theirs.probabilities, atol=1e-5)
    assert np.ptp(theirs.scores[0]) > 1e-3  # not a comparison of constants


@pytest.mark.parametrize("upsample", [0, 1, 2])
def test_every_cell_size_exports(tmp_path, upsample):
    assert OnnxEngine(export(checkpoint(tmp_path, upsample=upsample)).path).header.stride == 32 >> upsample


def test_the_file_is_valid_and_named(tmp_path):
    done = export(checkpoint(tmp_path), out=tmp_path / "sub.onnx")
    out = tmp_path / "sub.onnx"
    assert (done.path, done.files, done.size) == (out, (out,), out.stat().st_size)
    assert OnnxEngine(out).header == done.header
    onnx.checker.check_model(onnx.load(out))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["sub.onnx", "tiny.safetensors"]


def test_the_header_can_be_changed(tmp_path):
    changes = ["name=mine", "postprocess.threshold=0.3", "postprocess.linker=tree"]
    header = OnnxEngine(export(checkpoint(tmp_path), changes=changes).path).header
    assert header.name == "mine"
    assert header.postprocess == {"threshold": 0.3, "linker": "tree"}
    for change, message in (
        ("nme=x", "unknown nme"),
        ("name", "key=value"),
        ("stride=much", "stride"),
        ("precision=int8", "use --precision"),
    ):
        with pytest.raises(ValueError, match=message):
            export(checkpoint(tmp_path), changes=[change])


def test_the_size_of_a_checkpoint_can_be_changed(tmp_path):
    engine = OnnxEngine(export(checkpoint(tmp_path), changes=["size=[128,160]"]).path)
    assert engine(np.zeros((1, 128, 160, 3), np.uint8)).scores.shape[1] == 2 * (
        128 // engine.header.stride
    ) * (160 // engine.header.stride)


def test_the_graph_alone_can_be_had(tmp_path):
    network, header = load_checkpoint(checkpoint(tmp_path))
    assert onnx_bytes(network, header) == export(tmp_path / "tiny.safetensors").path.read_bytes()


@pytest.mark.parametrize("backbone", ["residual", "darknet19", "timm:mobilenetv4_conv_small"])
def test_the_first_convolution_divides_by_the_deviation(tmp_path, backbone):
    arguments = TINY["backbone_args"] if backbone == "residual" else {}
    file = export(checkpoint(tmp_path, backbone=backbone, backbone_args=arguments)).path
    graph = onnx.load(file).graph
    kinds = [node.op_type for node in graph.node]
    assert "Div" not in kinds[: kinds.index("Conv")]
    read = {name for node in graph.node for name in node.input}
    assert all(node.op_type != "Constant" or node.output[0] in read for node in graph.node)


def test_16_bits_have_half_the_bytes_and_find_the_same(tmp_path):
    path = checkpoint(tmp_path, classes=("way", "link"))
    whole, small = (export(path, out=tmp_path / f"{p}.onnx", precision=p).path for p in ("fp32", "fp16"))
    weights = sum(p.numel() for p in load_checkpoint(path)[0].parameters())
    assert whole.stat().st_size - small.stat().st_size > 1.0 * weights
    images = np.random.default_rng(1).integers(0, 256, (1, 64, 96, 3), dtype=np.uint8)
    ours, theirs = (OnnxEngine(file, device="cpu")(images) for file in (whole, small))
    assert 0 < np.abs(ours.endpoints - theirs.endpoints).max() < 0.1
    assert np.abs(ours.scores - theirs.scores).max() < 0.01
    headers = [OnnxEngine(file).header for file in (whole, small)]
    assert [header.precision for header in headers] == ["fp32", "fp16"]
    assert dataclasses.replace(headers[1], precision="fp32") == headers[0]


def test_weights_that_16_bits_cannot_hold_stay_as_they_are(tmp_path):
    model = onnx.load_model_from_string(export(checkpoint(tmp_path)).path.read_bytes())
    big = max(model.graph.initializer, key=lambda w: np.prod(w.dims))
    values = onnx.numpy_helper.to_array(big).copy()
    values.flat[0] = 1e5
    big.CopyFrom(onnx.numpy_helper.from_array(values, big.name))
    small = onnx.load_model_from_string(halved(model.SerializeToString()))
    kept = {w.name: onnx.numpy_helper.to_array(w) for w in small.graph.initializer}
    assert np.array_equal(kept[big.name], values)
    assert any(w.dtype == np.float16 for w in kept.values())


def test_a_network_that_disagrees_with_its_source_is_refused(tmp_path):
    network, header = load_checkpoint(checkpoint(tmp_path))
    one = TorchEngine.of(network, header)
    compare(one, TorchEngine.of(network, header), (0.0, 0.0))

    class Moved:
        header, name, device, precision, streams = one.header, "moved", "cpu", "fp32", 1

        def __init__(self, by):
            self.by = by

        def __call__(self, batch):
            output = one(batch)
            return output._replace(endpoints=output.endpoints + np.float32(self.by))

    compare(one, Moved(0.05), (0.1, 0.01))
    for by in (0.2, np.nan):
        with pytest.raises(RuntimeError, match="differs from the one before"):
            compare(one, Moved(by), (0.1, 0.01))
