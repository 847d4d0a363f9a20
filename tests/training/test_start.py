"""Training begins with what of a checkpoint means the same, and says what is new."""

from __future__ import annotations

import logging
import re
from pathlib import Path
from typing import Any

import pytest
import torch

from yolino.header import Header
from yolino.model.checkpoint import save_checkpoint
from yolino.model.network import Network
from yolino.training.start import start_from

SMALL = {
    "backbone": "residual",
    "backbone_args": {"widths": [8, 8, 8, 8], "blocks": [1, 1, 1, 1], "stem": 4},
    "neck_width": 8,
    "predictors": 3,
}


def build(**changes: Any) -> Network:
    return Network(**{**SMALL, **changes})


@pytest.fixture(autouse=True)
def seed() -> None:
    torch.manual_seed(0)


@pytest.fixture
def save(tmp_path: Path):
    """Writes a checkpoint with random weights everywhere; gives its file and its network."""

    def write(classes: tuple[str, ...] = (), **changes: Any) -> tuple[Path, Network]:
        arguments = {**SMALL, "num_classes": len(classes), **changes}
        network = Network(**arguments)
        with torch.no_grad():
            for tensor in network.state_dict().values():
                tensor.copy_(torch.rand(tensor.shape) + 0.5)
        header = Header("0", "old", (64, 96), network.stride, network.predictors, "po", classes=classes)
        path = tmp_path / "old.safetensors"
        save_checkpoint(path, network.state_dict(), header, arguments)
        return path, network

    return write


def head(network: Network) -> torch.Tensor:
    """Weights and bias of the head by predictor and output."""
    joined = torch.cat([network.head.weight.flatten(1), network.head.bias[:, None]], dim=1)
    return joined.detach().view(network.predictors, network.outputs_per_predictor, -1)


def same(network: Network, source: Network, part: str) -> bool:
    mine, theirs = getattr(network, part).state_dict(), getattr(source, part).state_dict()
    return all(torch.equal(tensor, theirs[name]) for name, tensor in mine.items())


def test_the_same_network_begins_with_all_weights(save, caplog):
    path, source = save(classes=("a", "b"))
    network = build(num_classes=2)
    with caplog.at_level(logging.INFO, logger="yolino"):
        start_from(network, path, ("a", "b"))
    assert all(same(network, source, part) for part in ("backbone", "neck", "head"))
    assert caplog.messages == [
        f"begins with backbone, neck, 3 predictors, class a, class b of {path} (old)",
    ]


def test_classes_are_added_behind_what_is_known(save, caplog):
    path, source = save()
    network = build(num_classes=2)
    fresh = head(network)
    with caplog.at_level(logging.INFO, logger="yolino"):
        start_from(network, path, ("dashed", "solid"))
    assert same(network, source, "backbone")
    assert same(network, source, "neck")
    assert torch.equal(head(network)[:, :5], head(source))
    assert torch.equal(head(network)[:, 5:], fresh[:, 5:])
    (message,) = caplog.messages
    assert message.endswith("(old); new: class dashed, class solid")


def test_a_network_with_new_classes_finds_the_same_segments(save):
    path, source = save()
    network = build(num_classes=2).eval()
    start_from(network, path, ("dashed", "solid"))
    image = torch.rand(1, 3, 64, 96) * 255
    expected, found = source.eval()(image), network(image)
    torch.testing.assert_close(found.params, expected.params)
    torch.testing.assert_close(found.confidence, expected.confidence)


def test_classes_are_known_by_their_names(save):
    path, source = save(classes=("a", "b", "c"))
    network = build(num_classes=3)
    fresh = head(network)
    start_from(network, path, ("c", "new", "a"))
    mine, theirs = head(network), head(source)
    assert torch.equal(mine[:, 5], theirs[:, 7])
    assert torch.equal(mine[:, 6], fresh[:, 6])
    assert torch.equal(mine[:, 7], theirs[:, 5])


@pytest.mark.parametrize("predictors", [2, 5])
def test_predictors_that_both_have_are_taken(save, caplog, predictors):
    path, source = save()
    network = build(predictors=predictors)
    fresh, both = head(network), min(predictors, 3)
    with caplog.at_level(logging.INFO, logger="yolino"):
        start_from(network, path)
    assert torch.equal(head(network)[:both], head(source)[:both])
    assert torch.equal(head(network)[both:], fresh[both:])
    assert f"{both} predictors" in caplog.text
    assert ("new: 2 predictors" in caplog.text) == (predictors == 5)


@pytest.mark.parametrize(
    ("changes", "neck_taken", "told"),
    [
        ({"representation": "md"}, True, "backbone, neck of .*; new: head"),
        ({"representation": "1d"}, True, "backbone, neck of .*; new: head"),
        ({"neck": "pyramid"}, False, "backbone of .*; new: neck, head"),
        ({"neck_width": 16}, False, "backbone of .*; new: neck, head"),
        ({"upsample": 2}, False, "backbone, part of the neck of .*; new: the rest of it, head"),
    ],
)
def test_a_head_that_means_something_else_begins_as_new(save, caplog, changes, neck_taken, told):
    path, source = save()
    network = build(**changes)
    fresh = network.head.weight.detach().clone()
    with caplog.at_level(logging.INFO, logger="yolino"):
        start_from(network, path)
    assert same(network, source, "backbone")
    if neck_taken:
        assert same(network, source, "neck")
    assert torch.equal(network.head.weight, fresh)
    (message,) = caplog.messages
    assert re.search(told, message)


def test_a_first_upsampling_block_is_taken_for_two(save):
    path, source = save()
    network = build(upsample=2)
    start_from(network, path)
    mine, theirs = network.neck.blocks[0].state_dict(), source.neck.blocks[0].state_dict()
    assert all(torch.equal(tensor, theirs[name]) for name, tensor in mine.items())


def test_heads_on_other_necks_are_not_mistaken_for_the_same(save):
    """Without upsampling the paper's neck has no weights, so all of them fit."""
    path, _ = save(upsample=0, neck="pyramid")
    network = build(upsample=0)
    fresh = network.head.weight.detach().clone()
    start_from(network, path)
    assert torch.equal(network.head.weight, fresh)


@pytest.mark.parametrize(
    "other",
    [
        {"backbone_args": {"widths": [8, 8, 8, 16], "blocks": [1, 1, 1, 1], "stem": 4}},
        {"backbone_args": {"widths": [8, 8, 8, 8], "blocks": [1, 1, 1, 2], "stem": 4}},
        {"backbone": "timm:mobilenetv4_conv_small", "backbone_args": {}},
    ],
)
def test_another_backbone_is_a_mistake_and_changes_nothing(save, other):
    path, _ = save()
    network = build(**other)
    before = {name: tensor.clone() for name, tensor in network.state_dict().items()}
    with pytest.raises(ValueError, match=r"nothing of .* \(old\) fits, as its backbone is another one"):
        start_from(network, path)
    assert all(torch.equal(tensor, before[name]) for name, tensor in network.state_dict().items())


def test_only_checkpoints_are_begun_with(tmp_path):
    onnx = tmp_path / "model.onnx"
    onnx.write_bytes(b"x")
    for given in (onnx, Path("default")):
        with pytest.raises(ValueError, match=r"start_from is .*give the best\.safetensors"):
            start_from(build(), given)
    with pytest.raises(FileNotFoundError, match=r"start_from: The checkpoint .*none\.safetensors does not"):
        start_from(build(), tmp_path / "none.safetensors")
    broken = tmp_path / "broken.safetensors"
    broken.write_bytes(b"x")
    with pytest.raises(ValueError, match=r"start_from: .* is not a safetensors file"):
        start_from(build(), broken)
