"""A checkpoint holds everything that is needed, runs no code, and says what is wrong with another file."""

import json

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from yolino.header import Header
from yolino.model.checkpoint import load_checkpoint, save_checkpoint
from yolino.model.engine import TorchEngine
from yolino.model.network import Network

ARGUMENTS = {
    "backbone": "residual",
    "backbone_args": {"widths": [8, 8, 8, 8], "blocks": [1, 1, 1, 1], "stem": 4},
    "neck_width": 8,
    "predictors": 2,
    "num_classes": 3,
}
HEADER = Header("0", "tiny", (64, 96), 16, 2, "po", classes=("a", "b", "c"), postprocess={"threshold": 0.25})


@pytest.fixture
def saved(tmp_path):
    torch.manual_seed(0)
    network = Network(**ARGUMENTS).eval()
    path = tmp_path / "tiny.safetensors"
    save_checkpoint(path, network.state_dict(), HEADER, ARGUMENTS)
    return path, network


def test_what_is_saved_comes_back(saved):
    path, network = saved
    again, header = load_checkpoint(path)
    assert header == HEADER
    assert not again.training
    image = torch.rand(1, 3, 64, 96) * 255
    for a, b in zip(network(image), again(image), strict=True):
        assert torch.equal(a, b)


def test_the_torch_engine_gives_pixels_scores_and_probabilities(saved):
    path, network = saved
    images = np.random.default_rng(0).integers(0, 256, (2, 64, 96, 3), dtype=np.uint8)
    output = TorchEngine(path)(images)
    with torch.no_grad():
        prediction = network(torch.from_numpy(images).permute(0, 3, 1, 2).float())
        endpoints, scores, classes = network.decode(prediction, (64, 96))
    np.testing.assert_allclose(output.endpoints, endpoints.numpy(), atol=1e-4)
    np.testing.assert_allclose(output.scores, scores.numpy(), atol=1e-6)
    np.testing.assert_allclose(output.probabilities, classes.numpy(), atol=1e-6)
    assert TorchEngine(path).header == HEADER


def test_other_files_are_refused(tmp_path, saved):
    with pytest.raises(FileNotFoundError, match="does not exist"):
        load_checkpoint(tmp_path / "nothing.safetensors")
    wrong = tmp_path / "wrong.safetensors"
    wrong.write_bytes(b"not a checkpoint at all")
    with pytest.raises(ValueError, match="not a safetensors file"):
        load_checkpoint(wrong)
    save_file({"x": torch.zeros(1)}, wrong)
    with pytest.raises(ValueError, match="no header"):
        load_checkpoint(wrong)
    save_file({"x": torch.zeros(1)}, wrong, {"yolino": HEADER.to_json(), "network": json.dumps(ARGUMENTS)})
    with pytest.raises(ValueError, match="do not fit its network"):
        load_checkpoint(wrong)


def test_unknown_devices_are_refused(saved):
    with pytest.raises(ValueError, match="use auto, cpu or cuda"):
        TorchEngine(saved[0], device="tpu")
