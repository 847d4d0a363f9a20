"""Responsibility: which predictor answers for which ground-truth segment (paper, Sec. 3)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from yolino.model.representations import Representation
from yolino.training.targets import Targets


class Matches(NamedTuple):
    """The pairs of ground-truth segment and responsible predictor.

    Attributes:
        targets: Index of the ground-truth segment (the paper's j).
        cells: Cell of the pair, counted over the batch (the paper's i).
        predictors: Responsible predictor in that cell (the paper's k).
        encoded: g of the ground-truth segment; reversed where an undirected line is predicted that way.
        surplus: Number of ground-truth segments left over in cells with more segments than predictors.
    """

    targets: Int[Tensor, " m"]
    cells: Int[Tensor, " m"]
    predictors: Int[Tensor, " m"]
    encoded: Float[Tensor, "m g"]
    surplus: int


def greedy_pairs(
    cost: Float[Tensor, "u l p"], turns: Int[Tensor, " n"], counts: Sequence[int]
) -> tuple[Tensor, Tensor, Tensor]:
    """Takes the closest pair of each cell again and again until its segments or its predictors are used up.

    All cells advance together, so the number of steps is min(l, p), not the number of pairs. Which cells take
    part in a step follows from the labels alone, so no step has to wait for the result of one before.

    Args:
        cost: Distance of each segment to each predictor of its cell, infinite where there is no segment.
        turns: The cells with at least one segment, those with at least two, and so on.
        counts: How many those are.

    Returns:
        Cell, segment place and predictor of each pair.
    """
    cells, _, predictors = cost.shape
    row = torch.arange(cells, device=cost.device)
    found: list[tuple[Tensor, Tensor, Tensor]] = []
    for chosen in torch.split(turns, list(counts))[:predictors]:
        at = cost.flatten(1).min(dim=1).indices
        place, predictor = at // predictors, at % predictors
        found.append((chosen, place[chosen], predictor[chosen]))
        cost[row, place] = torch.inf
        cost[row, :, predictor] = torch.inf
    if not found:
        empty = row[:0]
        return empty, empty, empty
    u, j, k = (torch.cat(parts) for parts in zip(*found, strict=True))
    return u, j, k


@torch.no_grad()
def match(
    params: Float[Tensor, "b s p g"],
    targets: Targets,
    representation: Representation,
    *,
    directed: bool = True,
) -> Matches:
    """Matches greedily on the geometric distance alone, in all cells of the batch at once.

    Args:
        params: Predicted g.
        targets: Labels of the batch.
        representation: Encodes the labels and measures the distance.
        directed: Whether a segment and its reverse differ; if not, the nearer of the two counts.
    """
    encoded = representation.encode(targets.endpoints)
    table = targets.table
    cells = targets.cells[table[:, :1].flatten()]
    here = params.flatten(0, 1)[cells]
    cost = representation.distance(encoded[table][:, :, None], here[:, None])
    if not directed:
        backward = representation.encode(targets.endpoints.flip(1))
        reverse_cost = representation.distance(backward[table][:, :, None], here[:, None])
        reverse = reverse_cost < cost
        cost = torch.minimum(cost, reverse_cost)
    cost = cost.masked_fill((table < 0)[..., None], torch.inf)
    u, j, k = greedy_pairs(cost, targets.turns, targets.counts)
    index = table[u, j]
    chosen = encoded[index]
    if not directed:
        chosen = torch.where(reverse[u, j, k][:, None], backward[index], chosen)
    return Matches(index, cells[u], k, chosen, len(targets.cells) - len(index))
