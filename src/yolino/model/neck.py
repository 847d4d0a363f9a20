"""The neck: upsampling blocks with skip connections, for cells of 32, 16 or 8 px (paper, Sec. 3)."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from yolino.model.backbones import conv


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


class Neck(nn.Module):
    """Zero, one or two upsampling blocks on the maps at strides 8, 16 and 32.

    Args:
        channels: Channels of the backbone's maps at strides 8, 16, 32.
        upsample: Number of blocks; the cells have `32 / 2**upsample` pixels.
        width: Channels of the first block; each further block has half of them.
    """

    def __init__(self, channels: Sequence[int], *, upsample: int, width: int) -> None:
        super().__init__()
        if upsample not in (0, 1, 2):
            raise ValueError(
                f"upsample is {upsample}, but 0, 1 or 2 blocks are possible (cells of 32, 16 or 8 px)."
            )
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
