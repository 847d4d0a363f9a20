"""The network has the paper's sizes, decodes into the right cells and rejects what it cannot take."""

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from yolino.model.backbones import BACKBONES, Darknet19, ResidualNet, build_backbone, load_darknet_weights
from yolino.model.network import PIXEL_MEAN, Network, Prediction
from yolino.model.representations import REPRESENTATIONS

SMALL = {
    "backbone": "residual",
    "backbone_args": {"widths": [8, 8, 8, 8], "blocks": [1, 1, 1, 1], "stem": 4},
    "neck_width": 8,
}


def count(module):
    return sum(p.numel() for p in module.parameters())


def test_darknet_19_has_the_layers_of_yolo9000():
    convolutions = [m for m in Darknet19().modules() if isinstance(m, torch.nn.Conv2d)]
    shapes = [(c.out_channels, c.kernel_size[0]) for c in convolutions]
    assert shapes == [
        *[(32, 3), (64, 3)],
        *[(128, 3), (64, 1), (128, 3)],
        *[(256, 3), (128, 1), (256, 3)],
        *[(512, 3), (256, 1), (512, 3), (256, 1), (512, 3)],
        *[(1024, 3), (512, 1), (1024, 3), (512, 1), (1024, 3)],
    ]


@pytest.mark.parametrize(("upsample", "stride"), [(0, 32), (1, 16), (2, 8)])
@pytest.mark.parametrize("size", [(64, 96), (32, 32)])
def test_cells_have_32_16_or_8_pixels(upsample, stride, size):
    network = Network(**SMALL, upsample=upsample, predictors=3, num_classes=2).eval()
    prediction = network(torch.rand(2, 3, *size) * 255)
    cells = size[0] * size[1] // stride**2
    assert network.stride == stride
    assert prediction.params.shape == (2, cells, 3, 4)
    assert prediction.confidence.shape == (2, cells, 3)
    torch.testing.assert_close(prediction.classes.sum(-1), torch.ones(2, cells, 3))


@pytest.mark.parametrize("backbone", [*BACKBONES, "timm:mobilenetv4_conv_small"])
def test_every_backbone_gives_maps_at_8_16_32(backbone):
    model = build_backbone(backbone).eval()
    maps = model(torch.rand(1, 3, 64, 96))
    assert model.feature_info.reduction() == [8, 16, 32]
    for feature, channels, stride in zip(maps, model.feature_info.channels(), (8, 16, 32), strict=True):
        assert feature.shape == (1, channels, 64 // stride, 96 // stride)


@pytest.mark.parametrize(
    ("backbone", "arguments", "message"),
    [
        (
            "residual",
            {"blokcs": [1, 1]},
            r"'model\.backbone_args\.blokcs' of the backbone residual; .*'blocks'",
        ),
        ("residual", {"weights": "x"}, r"'model\.backbone_args\.weights' of the backbone residual"),
        ("darknet19", {"weihgts": "x"}, r"did you mean 'weights'\?"),
        ("timm:mobilenetv4_conv_small", {"blokcs": 1}, r"do not fit the backbone timm:mobilenet.*blokcs"),
    ],
)
def test_a_wrong_argument_of_a_backbone_is_a_mistake_in_the_file(backbone, arguments, message):
    with pytest.raises(ValueError, match=message):
        build_backbone(backbone, **arguments)


def test_the_default_neck_keeps_to_the_budget_of_the_paper():
    # The paper's 187 fps bound the network; 27 M parameters at 16 px, 28 M at 8 px.
    assert count(Network(upsample=0)) == pytest.approx(19.86e6, rel=1e-3)
    assert count(Network(upsample=1)) == pytest.approx(26.5e6, rel=1e-2)
    assert count(Network(upsample=2)) == pytest.approx(28.2e6, rel=1e-2)


@pytest.mark.parametrize("name", list(REPRESENTATIONS))
def test_decode_puts_each_segment_into_its_cell(name):
    network = Network(**SMALL, upsample=0, predictors=2, representation=name)
    representation = network.representation
    middle = torch.tensor([[0.5, 0.0], [0.5, 1.0]])  # straight down through the middle
    params = representation.encode(middle).expand(1, 6, 2, -1)
    prediction = Prediction(params, torch.rand(1, 6, 2), torch.zeros(1, 6, 2, 0))
    endpoints, scores, classes = network.decode(prediction, (64, 96))
    assert endpoints.shape == (1, 12, 2, 2)
    assert classes.shape == (1, 12, 0)
    torch.testing.assert_close(scores[0], prediction.confidence[0].flatten())
    # The last predictor of cell 4 (row 1, column 1) of 2 x 3 cells of 32 px.
    torch.testing.assert_close(endpoints[0, 9], torch.tensor([[48.0, 32.0], [48.0, 64.0]]), atol=1e-4, rtol=0)


def test_the_original_binary_weights_land_where_darknet_puts_them(tmp_path):
    reference = Darknet19()
    numbers = []
    rng = np.random.default_rng(0)
    for m in reference.modules():
        if isinstance(m, torch.nn.Sequential) and len(m) == 3 and isinstance(m[0], torch.nn.Conv2d):
            for tensor in (m[1].bias, m[1].weight, m[1].running_mean, m[1].running_var, m[0].weight):
                values = rng.random(tensor.numel(), dtype=np.float32)
                with torch.no_grad():
                    tensor.copy_(torch.from_numpy(values).view_as(tensor))
                numbers.append(values)
    header = np.array([0, 2, 0], "<i4").tobytes() + np.array([1234], "<u8").tobytes()
    file = tmp_path / "darknet19_448.conv.23"
    file.write_bytes(header + np.concatenate(numbers).astype("<f4").tobytes())
    loaded = Darknet19(weights=file)
    for (name, a), b in zip(reference.state_dict().items(), loaded.state_dict().values(), strict=True):
        assert torch.equal(a, b), name
    file.write_bytes(
        np.array([0, 1, 0, 77], "<i4").tobytes() + np.concatenate(numbers).astype("<f4").tobytes()
    )
    load_darknet_weights(loaded, file)  # the older header is 4 bytes shorter
    assert torch.equal(loaded.stages[0][0][1].bias, reference.stages[0][0][1].bias)


def test_wrong_weights_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nothing\.conv"):
        Darknet19(weights=tmp_path / "nothing.conv")
    short = tmp_path / "short"
    short.write_bytes(b"\0" * 400)
    with pytest.raises(ValueError, match="need 19831776"):
        Darknet19(weights=short)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"backbone": "resnet"}, "timm:NAME"),
        ({"backbone": "timm:nothing_at_all"}, "no model 'nothing_at_all'"),
        ({"backbone": "timm:vit_tiny_patch16_224"}, "strides"),
        ({"representation": "polar"}, "po, 1d, eu, md"),
        ({"upsample": 3}, "0, 1 or 2"),
        ({"predictors": 0}, "at least 1"),
        ({"pretrained": True}, "no weights to download"),
    ],
)
def test_wrong_arguments_say_what_is_allowed(arguments, message):
    with pytest.raises(ValueError, match=message):
        Network(
            **{
                **SMALL,
                "backbone_args": {} if "backbone" in arguments else SMALL["backbone_args"],
                **arguments,
            }
        )


def test_other_sizes_are_refused_with_a_sentence():
    with pytest.raises(ValueError, match="divisible by 32"):
        Network(**SMALL)(torch.zeros(1, 3, 50, 64))
    with pytest.raises(ValueError, match="four widths"):
        ResidualNet(widths=(8, 8))


def test_a_timm_backbone_starts_from_a_file_and_sees_the_pixels_that_its_weights_expect(tmp_path):
    name = "timm:tf_efficientnet_lite0"
    source = build_backbone(name)
    torch.nn.init.constant_(source.conv_stem.weight, 0.25)
    save_file(source.state_dict(), tmp_path / "weights.safetensors")
    network = Network(
        backbone=name, backbone_args={"weights": tmp_path / "weights.safetensors"}, neck_width=8
    )
    assert (network.backbone.conv_stem.weight == 0.25).all()
    assert network.pixel_mean.flatten().tolist() == [127.5] * 3
    assert network.pixel_std.flatten().tolist() == [127.5] * 3


def test_a_backbone_without_weights_of_its_own_sees_the_pixels_of_imagenet():
    network = Network(backbone="residual", neck_width=8)
    assert network.pixel_mean.flatten().tolist() == pytest.approx(PIXEL_MEAN)


def test_missing_weights_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no\.safetensors"):
        build_backbone("timm:resnet18", weights=tmp_path / "no.safetensors")
