"""What the confidence of a predictor is compared with, and how: `loss.confidence` of an experiment."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from yolino.config import suggest

# Distance in cells at which a segment fits by 1/e. Of a trained network's responsible predictors half lie
# nearer than .03 and one in ten farther than .1: their fit spreads from .9 to .6.
FIT_CELLS = 0.2

Penalty = Callable[[Tensor, Tensor | float], Tensor]


def squared(
    confidence: Float[Tensor, "*shape"], target: Float[Tensor, "*shape"] | float
) -> Float[Tensor, "*shape"]:
    """Gives (c - target)^2 of each predictor (paper, Eq. 5 and 6)."""
    return (confidence - target).square()


def focal(
    confidence: Float[Tensor, "*shape"],
    target: Float[Tensor, "*shape"] | float,
    *,
    weights: tuple[float, float] = (0.25, 0.75),
    gamma: float = 2.0,
) -> Float[Tensor, "*shape"]:
    """Gives the cross entropy of each predictor times |target - c|^gamma: those that are right count little.

    For targets 0 and 1 this is the focal loss (Lin et al., Focal Loss for Dense Object Detection, 2017, with
    alpha .25 and gamma 2), for targets between them the quality focal loss (Li et al., Generalized Focal
    Loss, 2020). It is 0 where the confidence equals the target.

    Args:
        confidence: c, in 0..1.
        target: What it should be, in 0..1.
        weights: Of the cross entropy's parts for target 1 (alpha) and for target 0 (1 - alpha).
        gamma: Power of the distance to the target.
    """
    # Bounded, since a sigmoid in 32 bits reaches 0 and 1: the logarithms and their slopes stay finite.
    above = confidence.clamp_min(1e-12).log()
    below = (1 - confidence).clamp_min(1e-7).log()
    entropy = -(weights[0] * target * above + weights[1] * (1 - target) * below)
    return (confidence - target).abs().pow(gamma) * entropy


class Confidence(NamedTuple):
    """An entry of `CONFIDENCES`.

    Attributes:
        penalty: What a confidence costs, given its target.
        fitted: Whether the target of a responsible predictor is how well its segment fits, instead of 1.
        near: Whether the target of a free predictor is how well its segment fits, too, instead of 0.
        per_responsible: Whether the sum over the free predictors is divided by the number of responsible ones
            instead of their own.
    """

    penalty: Penalty
    fitted: bool = False
    near: bool = False
    per_responsible: bool = False


# A focal penalty nearly vanishes for the free predictors that are right, which are most: divided by the
# number of all free ones, those that are wrong would count nothing. So it is divided as in the literature.
CONFIDENCES: dict[str, Confidence] = {
    "squared": Confidence(squared),
    "focal": Confidence(focal, per_responsible=True),
    "quality": Confidence(squared, fitted=True),
    "quality_focal": Confidence(partial(focal, weights=(1.0, 1.0)), fitted=True, per_responsible=True),
    "nearness": Confidence(squared, fitted=True, near=True),
}


def build_confidence(name: str) -> Confidence:
    """Gives the entry of that name.

    Raises:
        ValueError: There is none.
    """
    if name not in CONFIDENCES:
        known = ", ".join(CONFIDENCES)
        raise ValueError(
            f"loss.confidence {name!r} is unknown; {suggest(name, CONFIDENCES)}Known are {known}."
        )
    return CONFIDENCES[name]


@torch.no_grad()
def fit(gaps_cells: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """Gives how well segments fit that lie so far from the truth: exp(-gap / .2 cells), from 1 down to 0."""
    return torch.exp(-gaps_cells / FIT_CELLS)
