"""Necks: from the backbone's maps to one map at the stride of the cells, 32, 16 or 8 px (paper, Sec. 3)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from yolino.config import suggest
from yolino.model.backbones import STRIDES, conv


class Neck(nn.Module, ABC):
    """What turns maps at strides 8, 16 and 32 into one map at the stride of the cells.

    Args:
        channels: Channels of the backbone's maps at strides 8, 16, 32.
        upsample: How often the resolution of the coarsest map is doubled: 0, 1 or 2 times.
        width: Channels inside; what exactly has so many, the subclass says.

    Attributes:
        out_channels: Channels of the map that it gives.

    Raises:
        ValueError: `upsample` is none of these.
    """

    out_channels: int

    def __init__(self, channels: Sequence[int], *, upsample: int, width: int) -> None:
        super().__init__()
        if upsample not in (0, 1, 2):
            raise ValueError(
                f"upsample is {upsample}, but 0, 1 or 2 blocks are possible (cells of 32, 16 or 8 px)."
            )

    @abstractmethod
    def forward(self, maps: Sequence[Tensor]) -> Tensor:
        """Gives one map at the stride of the cells."""


class UpsamplingBlock(nn.Module):
    """A transposed convolution, the skip connection joined to it, and three regular convolutions."""

    def __init__(self, in_channels: int, skip_channels: int, width: int) -> None:
        super().__init__()
        self.up = nn.Sequential(
            nn.ConvTranspose2d(in_channels, width, 2, 2, bias=False),
            nn.BatchNorm2d(width),
            nn.LeakyReLU(0.1, inplace=True),
        )
        self.convs = nn.Sequential(
            conv(width + skip_channels, width), conv(width, width // 2, kernel=1), conv(width // 2, width)
        )

    def forward(
        self, x: Float[Tensor, "b i h w"], skip: Float[Tensor, "b s h2 w2"]
    ) -> Float[Tensor, "b o h2 w2"]:
        """Doubles the resolution of `x` and refines it with the fine features of `skip`."""
        out: Tensor = self.convs(torch.cat([self.up(x), skip], dim=1))
        return out


class UpsamplingNeck(Neck):
    """The paper's: zero, one or two upsampling blocks with skip connections (its Fig. 7).

    `width` is that of the first block; each further block has half of it.
    """

    def __init__(self, channels: Sequence[int], *, upsample: int, width: int) -> None:
        super().__init__(channels, upsample=upsample, width=width)
        blocks, at = [], channels[-1]
        for i in range(upsample):
            blocks.append(UpsamplingBlock(at, channels[-2 - i], width >> i))
            at = width >> i
        self.blocks = nn.ModuleList(blocks)
        self.out_channels = at

    def forward(self, maps: Sequence[Tensor]) -> Tensor:
        """Gives one map at the stride of the cells."""
        x = maps[-1]
        for block, skip in zip(self.blocks, reversed(maps[:-1]), strict=False):
            x = block(x, skip)
        return x


class PyramidNeck(Neck):
    """A feature pyramid: every level is brought to one width and added to the upsampled level above it.

    From stride 32 down to that of the cells: a 1x1 convolution of the backbone's map, plus the level above
    with every pixel doubled, then a 3x3 convolution that smooths (Lin et al., Feature Pyramid Networks for
    Object Detection, 2017). The last level also gets the map that is finer than the cells, if there is one,
    through a convolution of stride 2: the upsampling blocks never see it, and thin dashes are sharpest there.

    `width` is that of all levels.
    """

    def __init__(self, channels: Sequence[int], *, upsample: int, width: int) -> None:
        super().__init__(channels, upsample=upsample, width=width)
        levels = [str(stride) for stride in reversed(STRIDES)]
        wide = dict(zip(levels, reversed(channels), strict=True))
        self.levels = levels[: upsample + 1]
        self.lateral = nn.ModuleDict(
            {level: conv(wide[level], width, kernel=1, act=nn.Identity()) for level in self.levels}
        )
        self.smooth = nn.ModuleDict({level: conv(width, width) for level in self.levels})
        self.finer = nn.ModuleDict(
            {
                level: conv(wide[level], width, stride=2, act=nn.Identity())
                for level in levels[upsample + 1 :][:1]
            }
        )
        self.out_channels = width

    def forward(self, maps: Sequence[Tensor]) -> Tensor:
        """Gives one map at the stride of the cells."""
        by_level = dict(zip((str(stride) for stride in STRIDES), maps, strict=True))
        x: Tensor | None = None
        for level in self.levels:
            total = self.lateral[level](by_level[level])
            if x is not None:
                total = total + functional.interpolate(x, scale_factor=2.0, mode="nearest")
            if level == self.levels[-1]:
                for fine, down in self.finer.items():
                    total = total + down(by_level[fine])
            x = self.smooth[level](total)
        assert x is not None
        return x


NECKS: dict[str, type[Neck]] = {"upsampling": UpsamplingNeck, "pyramid": PyramidNeck}


def build_neck(name: str, channels: Sequence[int], *, upsample: int, width: int) -> Neck:
    """Gives the neck `name` of `NECKS`; the other arguments are those of `Neck`.

    Raises:
        ValueError: The name is unknown, or `upsample` is none of 0, 1, 2.
    """
    if name not in NECKS:
        raise ValueError(f"neck {name!r} is unknown; {suggest(name, NECKS)}Known are {', '.join(NECKS)}.")
    return NECKS[name](channels, upsample=upsample, width=width)
