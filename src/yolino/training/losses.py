"""The training objective: a weighted sum of four terms (paper, Eq. 4-7)."""

from __future__ import annotations

from typing import NamedTuple

import torch
import torch.distributed as dist
from jaxtyping import Bool, Float
from torch import Tensor, nn
from torch.nn import functional

from yolino.model.network import Prediction
from yolino.model.representations import Representation
from yolino.training.matching import Matches, match
from yolino.training.targets import Targets


class Losses(NamedTuple):
    """The four terms before their weights, and their weighted sum.

    Attributes:
        total: Weighted sum; what is minimized.
        loc: Localization, per responsible predictor.
        resp: Confidence of the responsible predictors, per responsible predictor.
        noresp: Confidence of the free predictors, per free predictor.
        classes: Classification, per responsible predictor.
    """

    total: Float[Tensor, ""]
    loc: Float[Tensor, ""]
    resp: Float[Tensor, ""]
    noresp: Float[Tensor, ""]
    classes: Float[Tensor, ""]


def localization_loss(
    params: Float[Tensor, "m g"], encoded: Float[Tensor, "m g"], representation: Representation
) -> Float[Tensor, ""]:
    """Sums d(g, g^) over the responsible predictors (paper, Eq. 4)."""
    return representation.distance(encoded, params).sum()


def responsible_loss(confidence: Float[Tensor, " m"]) -> Float[Tensor, ""]:
    """Sums (c - 1)^2 over the responsible predictors (paper, Eq. 5)."""
    return (confidence - 1).square().sum()


def free_loss(confidence: Float[Tensor, " *shape"], free: Bool[Tensor, " *shape"]) -> Float[Tensor, ""]:
    """Sums (c - 0)^2 over the free predictors (paper, Eq. 6)."""
    return (confidence.square() * free).sum()


def class_loss(probabilities: Float[Tensor, "m c"], labels: Tensor) -> Float[Tensor, ""]:
    """Sums the squared errors of the class probabilities over the responsible predictors (paper, Eq. 7)."""
    return (probabilities - functional.one_hot(labels, probabilities.shape[-1])).square().sum()


def _over_all_ranks(count: Tensor) -> Tensor:
    """Gives the mean of `count` over all processes, so that each one's share adds up to the global mean."""
    if dist.is_available() and dist.is_initialized():
        dist.all_reduce(count)
        count = count / dist.get_world_size()
    return count.clamp_min(1.0)


class Criterion(nn.Module):
    """Matches predictions with labels and weighs the four terms.

    The sums are those of the paper, which gives no normalization: `loc`, `resp` and `classes` are divided by
    the number of responsible predictors, `noresp` by that of the free ones, counted over all processes.

    Args:
        representation: Encodes the labels and measures distances.
        directed: Whether a segment and its reverse differ.
        loc: Weight of the localization.
        resp: Weight of the responsible predictors' confidence.
        noresp: Weight of the free predictors' confidence.
        classes: Weight of the classification.
    """

    def __init__(
        self,
        representation: Representation,
        *,
        directed: bool = True,
        loc: float = 2.0,
        resp: float = 1.0,
        noresp: float = 1.0,
        classes: float = 1.0,
    ) -> None:
        super().__init__()
        self.representation, self.directed = representation, directed
        self.weights = (loc, resp, noresp, classes)

    def forward(self, prediction: Prediction, targets: Targets) -> tuple[Losses, Matches]:
        """Gives the loss of a batch and who was responsible for what."""
        matches = self.match(prediction, targets)
        return self.losses(prediction, targets, matches), matches

    def match(self, prediction: Prediction, targets: Targets) -> Matches:
        """Gives who is responsible for what."""
        return match(prediction.params.detach(), targets, self.representation, directed=self.directed)

    def losses(self, prediction: Prediction, targets: Targets, matches: Matches) -> Losses:
        """Gives the loss of a batch whose responsible predictors are known."""
        at = (matches.cells, matches.predictors)
        confidence = prediction.confidence.flatten(0, 1)
        free = ~targets.ignored.flatten()[:, None].expand_as(confidence)
        free = free.index_put(at, torch.zeros((), dtype=torch.bool, device=free.device))
        # Filled, not copied: a copy to the GPU would wait for all that it still has to do.
        count = _over_all_ranks(torch.full((), float(len(matches.cells)), device=free.device))
        loc = (
            localization_loss(prediction.params.flatten(0, 1)[at], matches.encoded, self.representation)
            / count
        )
        resp = responsible_loss(confidence[at]) / count
        noresp = free_loss(confidence, free) / _over_all_ranks(free.sum().float())
        classes = confidence.new_zeros(())
        if prediction.classes.shape[-1]:
            classes = (
                class_loss(prediction.classes.flatten(0, 1)[at], targets.labels[matches.targets]) / count
            )
        terms = (loc, resp, noresp, classes)
        total = torch.stack([w * term for w, term in zip(self.weights, terms, strict=True)]).sum()
        return Losses(total, *terms)
