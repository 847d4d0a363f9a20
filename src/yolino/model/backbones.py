"""Backbones: image -> feature maps at strides 8, 16 and 32.

All have the face of timm's `features_only` models: `forward` gives a list of maps, and
`feature_info.channels()` and `feature_info.reduction()` describe them. So any timm model needs no adapter:
`backbone: timm:resnet18`.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import timm
import torch
from jaxtyping import Float
from torch import Tensor, nn

from yolino.config import check_keys

STRIDES = (8, 16, 32)


class FeatureInfo:
    """Channels and strides of the maps that a backbone gives."""

    def __init__(self, channels: Sequence[int]) -> None:
        self._channels = list(channels)

    def channels(self) -> list[int]:
        """Channels of each map."""
        return self._channels

    def reduction(self) -> list[int]:
        """Stride of each map in pixels."""
        return list(STRIDES)


def conv(
    in_channels: int, out_channels: int, *, kernel: int = 3, stride: int = 1, act: nn.Module | None = None
) -> nn.Sequential:
    """Gives convolution, batch normalization and activation: Darknet's leaky ReLU of 0.1 unless given."""
    layers = [
        nn.Conv2d(in_channels, out_channels, kernel, stride, kernel // 2, bias=False),
        nn.BatchNorm2d(out_channels),
        nn.LeakyReLU(0.1, inplace=True) if act is None else act,
    ]
    return nn.Sequential(*layers)


class Darknet19(nn.Module):
    """Darknet-19 without its classifier, exactly as in YOLO9000: 18 convolutions and five poolings.

    Args:
        weights: The original binary file `darknet19_448.conv.23` to start from, or None.
    """

    # Output channels per stage; the kernel alternates 3, 1, 3, ... within a stage.
    STAGES = (
        (32,),
        (64,),
        (128, 64, 128),
        (256, 128, 256),
        (512, 256, 512, 256, 512),
        (1024, 512, 1024, 512, 1024),
    )

    def __init__(self, *, weights: str | Path | None = None) -> None:
        super().__init__()
        channels, stages = 3, []
        for i, widths in enumerate(self.STAGES):
            layers: list[nn.Module] = [] if i == 0 else [nn.MaxPool2d(2, 2)]
            for k, width in enumerate(widths):
                layers.append(conv(channels, width, kernel=1 if k % 2 else 3))
                channels = width
            stages.append(nn.Sequential(*layers))
        self.stages = nn.ModuleList(stages)
        self.feature_info = FeatureInfo([256, 512, 1024])
        if weights is not None:
            load_darknet_weights(self, weights)

    def forward(self, image: Float[Tensor, "b 3 h w"]) -> list[Tensor]:
        """Gives the maps at strides 8, 16 and 32."""
        maps = []
        for stage in self.stages:
            image = stage(image)
            maps.append(image)
        return maps[-3:]


def load_darknet_weights(model: nn.Module, path: str | Path) -> None:
    """Fills the convolutions and batch normalizations of `model`, in order, from a binary file of Darknet.

    The file has a header (major, minor, revision, images seen) and then float32 per layer: bias, weight, mean
    and variance of the normalization, weights of the convolution.

    Raises:
        FileNotFoundError: No such file.
        ValueError: The file holds fewer or more numbers than the network's 18 layers need.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(
            f"Darknet weights {path} do not exist; give the path of darknet19_448.conv.23."
        )
    raw = path.read_bytes()
    major, minor = np.frombuffer(raw[:8], "<i4") if len(raw) >= 20 else (0, 0)
    header = 20 if major * 10 + minor >= 2 else 16  # `seen` became 64 bit in version 0.2
    numbers = np.frombuffer(raw[header : len(raw) - (len(raw) - header) % 4], "<f4")
    targets: list[Tensor] = []
    layers = [m for m in model.modules() if isinstance(m, nn.Conv2d | nn.BatchNorm2d)]
    for convolution, norm in zip(layers[::2], layers[1::2], strict=True):
        assert isinstance(norm, nn.BatchNorm2d)
        assert norm.running_mean is not None
        assert norm.running_var is not None
        targets += [norm.bias, norm.weight, norm.running_mean, norm.running_var, convolution.weight]
    need = sum(t.numel() for t in targets)
    if len(numbers) != need:
        raise ValueError(
            f"{path} holds {len(numbers)} numbers, but the 18 convolutions of Darknet-19 need {need}; "
            "use the file darknet19_448.conv.23."
        )
    at = 0
    with torch.no_grad():
        for target in targets:
            target.copy_(torch.from_numpy(numbers[at : at + target.numel()].copy()).view_as(target))
            at += target.numel()


class ResidualBlock(nn.Module):
    """Two dense 3x3 convolutions with a shortcut."""

    def __init__(self, in_channels: int, out_channels: int, *, stride: int = 1) -> None:
        super().__init__()
        self.first = conv(in_channels, out_channels, stride=stride, act=nn.ReLU(inplace=True))
        self.second = conv(out_channels, out_channels, act=nn.Identity())
        same = stride == 1 and in_channels == out_channels
        self.shortcut = (
            nn.Identity() if same else conv(in_channels, out_channels, kernel=1, act=nn.Identity())
        )
        self.pool = nn.AvgPool2d(2, 2) if stride == 2 else nn.Identity()
        nn.init.zeros_(self.second[1].weight)  # type: ignore[arg-type]  # begins as the identity

    def forward(self, x: Float[Tensor, "b i h w"]) -> Float[Tensor, "b o h2 w2"]:
        """Adds the two convolutions to the shortcut."""
        return torch.relu(self.shortcut(self.pool(x)) + self.second(self.first(x)))


class ResidualNet(nn.Module):
    """A small residual network of dense 3x3 convolutions: on a CPU faster to train than depthwise ones.

    Args:
        widths: Channels at strides 4, 8, 16 and 32.
        blocks: Residual blocks at strides 4, 8, 16 and 32.
        stem: Channels at stride 2.
    """

    def __init__(
        self,
        *,
        widths: Sequence[int] = (32, 64, 128, 256),
        blocks: Sequence[int] = (1, 2, 2, 2),
        stem: int = 16,
    ) -> None:
        super().__init__()
        if len(widths) != 4 or len(blocks) != 4:
            raise ValueError(
                f"ResidualNet needs four widths and four block counts, got {widths} and {blocks}."
            )
        self.stem = conv(3, stem, stride=2, act=nn.ReLU(inplace=True))
        channels, stages = stem, []
        for width, count in zip(widths, blocks, strict=True):
            layers = [
                ResidualBlock(channels if i == 0 else width, width, stride=2 if i == 0 else 1)
                for i in range(count)
            ]
            stages.append(nn.Sequential(*layers))
            channels = width
        self.stages = nn.ModuleList(stages)
        self.feature_info = FeatureInfo(widths[1:])

    def forward(self, image: Float[Tensor, "b 3 h w"]) -> list[Tensor]:
        """Gives the maps at strides 8, 16 and 32."""
        x, maps = self.stem(image), []
        for stage in self.stages:
            x = stage(x)
            maps.append(x)
        return maps[1:]


BACKBONES: dict[str, Callable[..., nn.Module]] = {"darknet19": Darknet19, "residual": ResidualNet}


def build_backbone(
    name: str, *, pretrained: bool = False, weights: str | Path | None = None, **arguments: object
) -> nn.Module:
    """Gives the backbone `name` of `BACKBONES`, or any timm model with strides 8, 16, 32 as `timm:<name>`.

    Args:
        name: Name of the backbone.
        pretrained: Start a timm model from its published weights, which are downloaded.
        weights: File to start from: Darknet's for `darknet19`, a state dict (.safetensors) for a timm model.
        arguments: Arguments of the backbone.

    Raises:
        ValueError: The name or an argument is unknown, or the timm model has other strides.
        FileNotFoundError: There is no file of that name.
    """
    if name in BACKBONES:
        if pretrained:
            raise ValueError(
                f"backbone {name} has no weights to download; for darknet19 give backbone_args.weights."
            )
        given = arguments if weights is None else {**arguments, "weights": weights}
        allowed = inspect.signature(BACKBONES[name]).parameters
        check_keys("model.backbone_args", given, allowed, owner=f"the backbone {name}")
        return _create(name, BACKBONES[name], **given)
    if not name.startswith("timm:"):
        raise ValueError(f"backbone {name!r} is unknown; use one of {', '.join(BACKBONES)} or timm:NAME.")
    if name[5:] not in timm.list_models():
        raise ValueError(f"timm has no model {name[5:]!r}; timm.list_models() names all, e.g. timm:resnet18.")
    probe = _create(name, timm.create_model, name[5:], features_only=True, pretrained=False, **arguments)
    reduction: list[int] = probe.feature_info.reduction()  # type: ignore[union-attr,operator]
    if not set(STRIDES) <= set(reduction):
        raise ValueError(
            f"timm model {name[5:]!r} gives maps at strides {reduction}, but 8, 16 and 32 are needed."
        )
    indices = [reduction.index(s) for s in STRIDES]
    if weights is not None:
        if not Path(weights).is_file():
            raise FileNotFoundError(f"There are no weights {weights} for {name}: give a .safetensors file.")
        arguments["pretrained_cfg_overlay"] = {"file": str(weights)}
    return _create(
        name,
        timm.create_model,
        name[5:],
        features_only=True,
        pretrained=pretrained or weights is not None,
        out_indices=indices,
        **arguments,
    )


def _create(name: str, build: Callable[..., nn.Module], *positional: str, **arguments: object) -> nn.Module:
    """Calls what builds the backbone `name`; a TypeError then comes from the arguments in the file."""
    try:
        return build(*positional, **arguments)
    except TypeError as error:
        raise ValueError(f"model.backbone_args do not fit the backbone {name}: {error}.") from error
