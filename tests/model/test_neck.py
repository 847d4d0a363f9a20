"""Every neck gives one map at the stride of the cells, takes part in learning, and exports as it is."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from yolino.export.graph import onnx_bytes
from yolino.header import Header
from yolino.inference.engines import OnnxEngine
from yolino.model.engine import TorchEngine
from yolino.model.neck import NECKS, PyramidNeck, UpsamplingNeck, build_neck
from yolino.model.network import Network

CHANNELS = (6, 8, 10)  # of the maps at strides 8, 16, 32
SMALL = {
    "backbone": "residual",
    "backbone_args": {"widths": [8, 8, 8, 8], "blocks": [1, 1, 1, 1], "stem": 4},
    "neck_width": 8,
    "predictors": 2,
}


def maps(height: int = 64, width: int = 96) -> list[torch.Tensor]:
    return [torch.rand(2, c, height // s, width // s) for c, s in zip(CHANNELS, (8, 16, 32), strict=True)]


@pytest.mark.parametrize("name", NECKS)
@pytest.mark.parametrize(("upsample", "stride"), [(0, 32), (1, 16), (2, 8)])
@pytest.mark.parametrize("size", [(64, 96), (32, 32)])
def test_a_neck_gives_one_map_at_the_stride_of_the_cells(name, upsample, stride, size):
    neck = build_neck(name, CHANNELS, upsample=upsample, width=4).eval()
    assert neck(maps(*size)).shape == (2, neck.out_channels, size[0] // stride, size[1] // stride)


@pytest.mark.parametrize("name", NECKS)
@pytest.mark.parametrize("upsample", [0, 1, 2])
def test_every_weight_of_a_neck_learns(name, upsample):
    neck = build_neck(name, CHANNELS, upsample=upsample, width=4)
    neck([each.requires_grad_() for each in maps()]).square().sum().backward()
    for weight, parameter in neck.named_parameters():
        assert parameter.grad is not None, weight
        assert torch.isfinite(parameter.grad).all(), weight


@pytest.mark.parametrize("name", NECKS)
@pytest.mark.parametrize("upsample", [0, 1, 2])
def test_a_network_with_any_neck_exports(name, upsample, tmp_path):
    torch.manual_seed(0)
    network = Network(**SMALL, neck=name, upsample=upsample, num_classes=3).eval()
    for module in network.modules():  # as after training: a norm that is the identity would hide mistakes
        if isinstance(module, torch.nn.BatchNorm2d):
            torch.nn.init.uniform_(module.running_mean, -0.2, 0.2)
            torch.nn.init.uniform_(module.running_var, 0.5, 1.5)
    header = Header("0", "tiny", (64, 96), 32 >> upsample, 2, "po", classes=("a", "b", "c"))
    path = tmp_path / "model.onnx"
    path.write_bytes(onnx_bytes(network, header))
    images = np.random.default_rng(0).integers(0, 256, (2, 64, 96, 3), dtype=np.uint8)
    expected, found = TorchEngine.of(network, header)(images), OnnxEngine(path, device="cpu")(images)
    np.testing.assert_allclose(found.endpoints, expected.endpoints, atol=1e-3)
    np.testing.assert_allclose(found.scores, expected.scores, atol=1e-4)
    np.testing.assert_allclose(found.probabilities, expected.probabilities, atol=1e-4)


def test_the_pyramid_adds_what_is_coarser_and_what_is_finer():
    """The same by hand: doubled pixels of the level above, and the finer map at half its resolution."""
    neck = PyramidNeck(CHANNELS, upsample=1, width=4).eval()
    fine, middle, coarse = maps()
    above = neck.smooth["32"](neck.lateral["32"](coarse))
    doubled = above.repeat_interleave(2, dim=2).repeat_interleave(2, dim=3)
    expected = neck.smooth["16"](neck.lateral["16"](middle) + doubled + neck.finer["8"](fine))
    torch.testing.assert_close(neck([fine, middle, coarse]), expected)


def test_which_maps_a_neck_looks_at():
    """The upsampling blocks see no map that is finer than the cells, the pyramid one."""
    for name, seen in (("upsampling", [False, True, True]), ("pyramid", [True, True, True])):
        inputs = [each.requires_grad_() for each in maps()]
        build_neck(name, CHANNELS, upsample=1, width=4)(inputs).sum().backward()
        assert [each.grad is not None for each in inputs] == seen
    assert not PyramidNeck(CHANNELS, upsample=2, width=4).finer  # nothing is finer than cells of 8 px


def test_the_width_of_the_pyramid_is_that_of_all_levels():
    assert PyramidNeck(CHANNELS, upsample=2, width=4).out_channels == 4
    assert UpsamplingNeck(CHANNELS, upsample=2, width=4).out_channels == 2


def test_the_names_of_the_upsampling_weights_are_those_of_earlier_checkpoints():
    names = {name.rsplit(".", 1)[0] for name, _ in Network(**SMALL).neck.named_parameters()}
    convolutions = {f"blocks.0.convs.{i}.{k}" for i in range(3) for k in (0, 1)}
    assert names == {"blocks.0.up.0", "blocks.0.up.1"} | convolutions
    assert isinstance(Network(**SMALL).neck, UpsamplingNeck)  # what no neck is named for


def test_a_wrong_name_is_told_the_right_ones():
    with pytest.raises(ValueError, match=r"did you mean 'pyramid'.*upsampling, pyramid"):
        Network(**SMALL, neck="pyramids")
    for name in NECKS:
        with pytest.raises(ValueError, match="0, 1 or 2"):
            build_neck(name, CHANNELS, upsample=3, width=4)
