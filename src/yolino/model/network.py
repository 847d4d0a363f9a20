"""The network: RGB pixels -> P directed segments with confidence and classes per cell (paper, Sec. 3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from yolino.model.backbones import build_backbone
from yolino.model.neck import build_neck
from yolino.model.representations import REPRESENTATIONS, Representation

# Mean and standard deviation of ImageNet's RGB pixels in 0..255, for backbones that do not state their own.
PIXEL_MEAN = (123.675, 116.28, 103.53)
PIXEL_STD = (58.395, 57.12, 57.375)


def pixel_statistics(backbone: nn.Module) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Gives the mean and standard deviation of RGB pixels in 0..255 that the weights of a backbone expect."""
    stated: Any = getattr(backbone, "pretrained_cfg", {})
    if "mean" not in stated or "std" not in stated:
        return PIXEL_MEAN, PIXEL_STD
    return tuple(255.0 * m for m in stated["mean"]), tuple(255.0 * s for s in stated["std"])


class Prediction(NamedTuple):
    """What P predictors say in each of the cells S = rows * cols, row by row (paper: P = (g, l, c)).

    Attributes:
        params: g, activated, in cell units.
        confidence: c, in 0..1.
        classes: l, probabilities; the last axis is empty for a network without classes.
    """

    params: Float[Tensor, "b s p g"]
    confidence: Float[Tensor, "b s p"]
    classes: Float[Tensor, "b s p c"]


class Network(nn.Module):
    """Backbone, neck and one 1x1 convolution that predicts `P * (g + 1 + C)` numbers per cell.

    Args:
        backbone: Name in `BACKBONES`, or `timm:<name>`.
        backbone_args: Arguments of the backbone.
        pretrained: Start a timm backbone from its published weights.
        upsample: How often the neck doubles the resolution: cells of 32, 16 or 8 px for 0, 1, 2.
        neck: Name in `NECKS`.
        neck_width: Channels of the neck: of its first upsampling block, or of every level of the pyramid.
        predictors: P, segments per cell.
        representation: Name in `REPRESENTATIONS`.
        num_classes: C; 0 for a network that predicts no classes.
    """

    def __init__(
        self,
        *,
        backbone: str = "darknet19",
        backbone_args: Mapping[str, Any] | None = None,
        pretrained: bool = False,
        upsample: int = 1,
        neck: str = "upsampling",
        neck_width: int = 448,
        predictors: int = 8,
        representation: str = "po",
        num_classes: int = 0,
    ) -> None:
        super().__init__()
        if representation not in REPRESENTATIONS:
            raise ValueError(
                f"representation {representation!r} is unknown; use one of {', '.join(REPRESENTATIONS)}."
            )
        if predictors < 1 or num_classes < 0:
            raise ValueError(
                f"predictors is {predictors} and num_classes {num_classes}; at least 1 and 0 are needed."
            )
        self.representation: Representation = REPRESENTATIONS[representation]()
        self.predictors, self.num_classes, self.stride = predictors, num_classes, 32 >> upsample
        self.backbone = build_backbone(backbone, pretrained=pretrained, **(backbone_args or {}))
        channels: list[int] = self.backbone.feature_info.channels()  # type: ignore[union-attr,operator]
        self.neck = build_neck(neck, channels, upsample=upsample, width=neck_width)
        self.head = nn.Conv2d(self.neck.out_channels, predictors * self.outputs_per_predictor, 1)
        self._init_head()
        self.pixel_mean: Tensor
        self.pixel_std: Tensor
        mean, std = pixel_statistics(self.backbone)
        self.register_buffer("pixel_mean", torch.tensor(mean).view(1, 3, 1, 1), persistent=False)
        self.register_buffer("pixel_std", torch.tensor(std).view(1, 3, 1, 1), persistent=False)

    @property
    def outputs_per_predictor(self) -> int:
        """Numbers per predictor: g, one confidence, C classes."""
        return self.representation.num_params + 1 + self.num_classes

    def _init_head(self) -> None:
        """Begins with little confidence and diverse segments, else the predictors of a cell are twins."""
        nn.init.normal_(self.head.weight, std=0.01)
        g = self.representation.num_params
        bias = torch.zeros(self.predictors, self.outputs_per_predictor)
        bias[:, :g] = torch.randn(self.predictors, g)
        bias[:, g] = -3.0
        with torch.no_grad():
            assert self.head.bias is not None
            self.head.bias.copy_(bias.flatten())

    def forward(self, images: Float[Tensor, "b 3 h w"]) -> Prediction:
        """Predicts from RGB pixels in 0..255.

        Raises:
            ValueError: Height or width is not divisible by 32.
        """
        height, width = images.shape[-2:]
        if height % 32 or width % 32:
            raise ValueError(
                f"The image is {height} x {width}; both must be divisible by 32 (the backbone's stride)."
            )
        raw = self.head(self.neck(self.backbone((images - self.pixel_mean) / self.pixel_std)))
        raw = (
            raw.flatten(2)
            .transpose(1, 2)
            .unflatten(-1, (self.predictors, self.outputs_per_predictor))
            .float()
        )
        g = self.representation.num_params
        params = self.representation.activate(raw[..., :g])
        classes = raw[..., g + 1 :].softmax(-1) if self.num_classes else raw[..., g + 1 :]
        return Prediction(params, raw[..., g].sigmoid(), classes)

    def decode(self, prediction: Prediction, size: Sequence[int]) -> tuple[Tensor, Tensor, Tensor]:
        """Turns a prediction into segments in pixels of the network's input: the last step before the seam.

        Args:
            prediction: What `forward` gave.
            size: Height and width of the input in pixels.

        Returns:
            End points `(b, n, 2, 2)`, scores `(b, n)` and class probabilities `(b, n, c)`, with n = S * P.
        """
        rows, cols = size[0] // self.stride, size[1] // self.stride
        device = prediction.params.device
        y, x = torch.meshgrid(
            torch.arange(rows, device=device), torch.arange(cols, device=device), indexing="ij"
        )
        corner = torch.stack([x, y], dim=-1).reshape(1, rows * cols, 1, 1, 2).to(prediction.params.dtype)
        # Written out for every predictor: ONNX Runtime adds arrays of one shape in a tenth of the time.
        corner = corner.expand(-1, -1, self.predictors, 2, -1).contiguous()
        endpoints = (self.representation.decode(prediction.params) + corner) * float(self.stride)
        return endpoints.flatten(1, 2), prediction.confidence.flatten(1), prediction.classes.flatten(1, 2)
