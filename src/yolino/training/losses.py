"""The training objective: a weighted sum of four terms (paper, Eq. 4-7), and one more."""

from __future__ import annotations

from typing import NamedTuple

import torch
import torch.distributed as dist
from jaxtyping import Bool, Float
from torch import Tensor, nn
from torch.nn import functional

from yolino.model.network import Prediction
from yolino.model.representations import Representation
from yolino.training.confidence import Penalty, build_confidence, fit, squared
from yolino.training.matching import Matches, gap_cells, match
from yolino.training.targets import Targets

# Segments shorter than this, in cells, have no direction worth learning, and its slope would be too steep.
SHORT_CELLS = 0.1


class Losses(NamedTuple):
    """The terms before their weights, and their weighted sum.

    Attributes:
        total: Weighted sum; what is minimized.
        loc: Localization, per responsible predictor.
        resp: Confidence of the responsible predictors, per responsible predictor.
        noresp: Confidence of the free predictors, per free predictor.
        classes: Classification, per responsible predictor.
        direction: Error of the direction, per responsible predictor; 0 where it has no weight.
    """

    total: Float[Tensor, ""]
    loc: Float[Tensor, ""]
    resp: Float[Tensor, ""]
    noresp: Float[Tensor, ""]
    classes: Float[Tensor, ""]
    direction: Float[Tensor, ""]


def localization_loss(
    params: Float[Tensor, "m g"], encoded: Float[Tensor, "m g"], representation: Representation
) -> Float[Tensor, ""]:
    """Sums d(g, g^) over the responsible predictors (paper, Eq. 4)."""
    return representation.distance(encoded, params).sum()


def responsible_loss(
    confidence: Float[Tensor, " m"],
    target: Float[Tensor, " m"] | float = 1.0,
    penalty: Penalty = squared,
) -> Float[Tensor, ""]:
    """Sums (c - 1)^2 over the responsible predictors (paper, Eq. 5), or what `CONFIDENCES` has instead."""
    return penalty(confidence, target).sum()


def free_loss(
    confidence: Float[Tensor, " *shape"],
    free: Bool[Tensor, " *shape"],
    target: Float[Tensor, " *shape"] | float = 0.0,
    penalty: Penalty = squared,
) -> Float[Tensor, ""]:
    """Sums (c - 0)^2 over the free predictors (paper, Eq. 6), or what `CONFIDENCES` has instead."""
    return (penalty(confidence, target) * free).sum()


def class_loss(probabilities: Float[Tensor, "m c"], labels: Tensor) -> Float[Tensor, ""]:
    """Sums the squared errors of the class probabilities over the responsible predictors (paper, Eq. 7)."""
    return (probabilities - functional.one_hot(labels, probabilities.shape[-1])).square().sum()


def direction_loss(segments: Float[Tensor, "m 2 2"], truth: Float[Tensor, "m 2 2"]) -> Float[Tensor, ""]:
    """Sums 1 - cosine of the angle between the segments (end points in cells) and their true directions.

    A predicted segment shorter than `SHORT_CELLS` counts as if its cosine were smaller in proportion, which
    makes it longer; a true one that short has no direction and counts 0.
    """
    way, true_way = segments[:, 1] - segments[:, 0], truth[:, 1] - truth[:, 0]
    length = torch.linalg.vector_norm(way, dim=-1).clamp_min(SHORT_CELLS)
    true_length = torch.linalg.vector_norm(true_way, dim=-1)
    cosine = (way * true_way).sum(-1) / (length * true_length.clamp_min(SHORT_CELLS))
    total: Tensor = ((1 - cosine) * (true_length >= SHORT_CELLS)).sum()
    return total


def _over_all_ranks(count: Tensor) -> Tensor:
    """Gives the mean of `count` over all processes, so that each one's share adds up to the global mean."""
    if dist.is_available() and dist.is_initialized():
        dist.all_reduce(count)
        count = count / dist.get_world_size()
    return count.clamp_min(1.0)


class Criterion(nn.Module):
    """Matches predictions with labels and weighs the terms.

    The sums are those of the paper, which gives no normalization: `noresp` is divided by the number of free
    predictors, the others by that of the responsible ones, counted over all processes.

    Args:
        representation: Encodes the labels and measures distances.
        directed: Whether a segment and its reverse differ.
        loc: Weight of the localization.
        resp: Weight of the responsible predictors' confidence.
        noresp: Weight of the free predictors' confidence.
        classes: Weight of the classification.
        direction: Weight of the direction; the paper has no such term.
        confidence: Name in `CONFIDENCES`.
        spare: Free predictors nearer than this to a true segment, in cells, are not punished.

    Raises:
        ValueError: There is no such confidence.
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
        direction: float = 0.0,
        confidence: str = "squared",
        spare: float = 0.0,
    ) -> None:
        super().__init__()
        self.representation, self.directed, self.spare = representation, directed, spare
        self.confidence = build_confidence(confidence)
        self.weights = (loc, resp, noresp, classes)
        self.direction = direction

    def forward(self, prediction: Prediction, targets: Targets, several: int = 1) -> tuple[Losses, Matches]:
        """Gives the loss of a batch and who was responsible for what, `several` for each segment."""
        matches = self.match(prediction, targets, several)
        return self.losses(prediction, targets, matches), matches

    def match(self, prediction: Prediction, targets: Targets, several: int = 1) -> Matches:
        """Gives who is responsible for what, `several` for each segment."""
        return match(
            prediction.params.detach(),
            targets,
            self.representation,
            directed=self.directed,
            several=several,
            gaps=self.confidence.near or self.spare > 0,
        )

    def losses(self, prediction: Prediction, targets: Targets, matches: Matches) -> Losses:
        """Gives the loss of a batch whose responsible predictors are known."""
        at = (matches.cells, matches.predictors)
        params = prediction.params.flatten(0, 1)[at]
        # Filled, not copied: a copy to the GPU would wait for all that it still has to do.
        count = _over_all_ranks(torch.full((), float(len(matches.cells)), device=params.device))
        loc = localization_loss(params, matches.encoded, self.representation) / count
        resp, noresp = self._confidences(prediction, targets, matches, count)
        classes, direction = count.new_zeros(()), count.new_zeros(())
        if prediction.classes.shape[-1]:
            classes = (
                class_loss(prediction.classes.flatten(0, 1)[at], targets.labels[matches.targets]) / count
            )
        terms = (loc, resp, noresp, classes)
        weighted = [w * term for w, term in zip(self.weights, terms, strict=True)]
        if self.direction:
            decode = self.representation.decode
            direction = direction_loss(decode(params), decode(matches.encoded)) / count
            weighted.append(self.direction * direction)
        return Losses(torch.stack(weighted).sum(), *terms, direction)

    def _confidences(
        self, prediction: Prediction, targets: Targets, matches: Matches, count: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Gives the terms of the responsible and of the free predictors, divided by their numbers."""
        at = (matches.cells, matches.predictors)
        confidence, gaps, kind = prediction.confidence.flatten(0, 1), matches.gaps_cells, self.confidence
        free = ~targets.ignored.flatten()[:, None].expand_as(confidence)
        free = free.index_put(at, torch.zeros((), dtype=torch.bool, device=free.device))
        if gaps is not None and self.spare:
            free = free & (gaps >= self.spare)
        target: Tensor | float = 1.0
        if kind.fitted:
            decode = self.representation.decode
            target = fit(gap_cells(decode(prediction.params.flatten(0, 1)[at]), decode(matches.encoded)))
        resp = responsible_loss(confidence[at], target, kind.penalty) / count
        away = fit(gaps) if gaps is not None and kind.near else 0.0
        noresp = free_loss(confidence, free, away, kind.penalty)
        return resp, noresp / (count if kind.per_responsible else _over_all_ranks(free.sum().float()))
