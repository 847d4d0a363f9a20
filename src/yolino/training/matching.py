"""Responsibility: which predictor answers for which ground-truth segment (paper, Sec. 3)."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
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


def greedy_pairs(cost: Float[Tensor, "u l p"], present: Bool[Tensor, "u l"]) -> tuple[Tensor, Tensor, Tensor]:
    """Takes the closest pair of each cell again and again until its segments or its predictors are used up.

    All cells advance together, so the number of steps is min(l, p), not the number of pairs.

    Args:
        cost: Distance of each segment to each predictor of its cell.
        present: Which of the l places of a cell hold a segment.

    Returns:
        Cell, segment place and predictor of each pair.
    """
    cells, places, predictors = cost.shape
    cost = cost.masked_fill(~present[..., None], torch.inf)
    row = torch.arange(cells, device=cost.device)
    found: list[tuple[Tensor, Tensor, Tensor]] = []
    for _ in range(min(places, predictors)):
        best, at = cost.flatten(1).min(dim=1)
        place, predictor = at // predictors, at % predictors
        valid = torch.isfinite(best)
        found.append((row[valid], place[valid], predictor[valid]))
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
    cells, compact = torch.unique_consecutive(targets.cells, return_inverse=True)
    places = int(targets.ranks.max()) + 1 if len(cells) else 0
    table = torch.full((len(cells), places), -1, dtype=torch.long, device=params.device)
    table[compact, targets.ranks] = torch.arange(len(targets.cells), device=params.device)
    here = params.flatten(0, 1)[cells]
    cost = representation.distance(encoded[table][:, :, None], here[:, None])
    if not directed:
        backward = representation.encode(targets.endpoints.flip(1))
        reverse_cost = representation.distance(backward[table][:, :, None], here[:, None])
        reverse = reverse_cost < cost
        cost = torch.minimum(cost, reverse_cost)
    u, j, k = greedy_pairs(cost, table >= 0)
    index = table[u, j]
    chosen = encoded[index]
    if not directed:
        chosen = torch.where(reverse[u, j, k][:, None], backward[index], chosen)
    return Matches(index, cells[u], k, chosen, len(targets.cells) - len(index))
