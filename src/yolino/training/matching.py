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
        gaps_cells: Distance in cells of each predictor to the nearest ground-truth segment of its cell,
            infinite where there is none; only where it was asked for.
    """

    targets: Int[Tensor, " m"]
    cells: Int[Tensor, " m"]
    predictors: Int[Tensor, " m"]
    encoded: Float[Tensor, "m g"]
    surplus: int
    gaps_cells: Float[Tensor, "cells p"] | None = None


def gap_cells(a: Float[Tensor, "*#shape 2 2"], b: Float[Tensor, "*#shape 2 2"]) -> Float[Tensor, "*#shape"]:
    """Gives how far segments lie apart, whatever their representation: the mean over both end points."""
    gap: Tensor = torch.linalg.vector_norm(a - b, dim=-1).mean(-1)
    return gap


def several_at(step: int, *, steps: int, several: int, until: float) -> int:
    """Gives how many predictors answer for each segment at a step.

    It falls from `several` to 1 one by one, at equal distances: with each fall predictors that were told to
    be confident are told not to be, and so that is only a part of them at a time.

    Args:
        step: Steps done.
        steps: Steps in all.
        several: Number at the beginning.
        until: Share of the steps after which it is 1.
    """
    return several - int((several - 1) * step / (until * steps)) if step < until * steps else 1


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


def repeated_pairs(
    cost: Float[Tensor, "u l p"], targets: Targets, several: int
) -> tuple[Tensor, Tensor, Tensor]:
    """Takes `greedy_pairs` several times, each time of the predictors that are left.

    So each segment has one predictor before any has two, and the first pairs are those of the paper.

    Args:
        cost: Distance of each segment to each predictor of its cell, infinite where there is no segment.
        targets: Labels of the batch.
        several: Predictors per segment, where its cell has enough of them.

    Returns:
        Cell, segment place and predictor of each pair.
    """
    found = [greedy_pairs(cost.clone(), targets.turns, targets.counts)]
    order = (targets.table >= 0).sum(dim=1).argsort(stable=True)
    for done in range(1, several):
        cells, _, predictors = found[-1]
        cost[cells, :, predictors] = torch.inf
        spans = _turns_left(targets.counts, cost.shape[-1], done)
        if not spans:
            break
        turns = torch.cat([order[first:last] for first, last in spans])
        found.append(greedy_pairs(cost.clone(), turns, [last - first for first, last in spans]))
    u, j, k = (torch.cat(parts) for parts in zip(*found, strict=True))
    return u, j, k


def _turns_left(counts: Sequence[int], predictors: int, done: int) -> list[tuple[int, int]]:
    """Gives which cells still take part in each step, after `done` predictors answer for each segment.

    A cell of l segments does in step s if it has such a segment, l > s, and a predictor, done * l + s < p.
    With the cells sorted by l those are a span, whose ends follow from the labels: no GPU need be asked.
    """

    def with_at_most(segments: int) -> int:
        return counts[0] - counts[segments] if segments < len(counts) else counts[0]

    spans = [
        (with_at_most(step), with_at_most((predictors - 1 - step) // done))
        for step in range(min(len(counts), predictors))
    ]
    return [(first, last) for first, last in spans if first < last]


@torch.no_grad()
def match(
    params: Float[Tensor, "b s p g"],
    targets: Targets,
    representation: Representation,
    *,
    directed: bool = True,
    several: int = 1,
    gaps: bool = False,
) -> Matches:
    """Matches greedily on the geometric distance alone, in all cells of the batch at once.

    Args:
        params: Predicted g.
        targets: Labels of the batch.
        representation: Encodes the labels and measures the distance.
        directed: Whether a segment and its reverse differ; if not, the nearer of the two counts.
        several: Predictors that answer for each segment; 1 is the paper's matching.
        gaps: Whether to measure how far every predictor lies from the labels of its cell.
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
    if several > 1:
        u, j, k = repeated_pairs(cost, targets, several)
    else:
        u, j, k = greedy_pairs(cost, targets.turns, targets.counts)
    index = table[u, j]
    chosen = encoded[index]
    if not directed:
        chosen = torch.where(reverse[u, j, k][:, None], backward[index], chosen)
    surplus = len(targets.cells) - sum(targets.counts[: params.shape[2]])
    found = Matches(index, cells[u], k, chosen, surplus)
    if gaps:
        found = found._replace(gaps_cells=_nearest_gaps(params, targets, representation, directed=directed))
    return found


def _nearest_gaps(
    params: Float[Tensor, "b s p g"], targets: Targets, representation: Representation, *, directed: bool
) -> Float[Tensor, "cells p"]:
    """Gives the distance in cells of each predictor to the nearest label of its cell, infinite if none."""
    everywhere = params.new_full((params.shape[0] * params.shape[1], params.shape[2]), torch.inf)
    if not targets.counts:
        return everywhere
    cells = targets.cells[targets.table[:, :1].flatten()]
    segments = representation.decode(params.flatten(0, 1)[cells])[:, None]
    truth = targets.endpoints[targets.table][:, :, None]
    gap = gap_cells(truth, segments)
    if not directed:
        gap = torch.minimum(gap, gap_cells(truth.flip(-2), segments))
    gap = gap.masked_fill((targets.table < 0)[..., None], torch.inf)
    return everywhere.index_put((cells,), gap.amin(dim=1))
