"""Matching of segments and predictors in loops: over the pairs of each cell, and over cells alone."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from yolino.model.representations import Representation
from yolino.training.targets import Targets

Pairs = set[tuple[int, int, int]]


@torch.no_grad()
def match_pair_by_pair(
    params: Float[Tensor, "b s p g"], targets: Targets, representation: Representation
) -> Pairs:
    """Gives `(segment, cell, predictor)`: the distance of each pair of a cell, then the closest in turn."""
    flat, encoded = params.flatten(0, 1), representation.encode(targets.endpoints)
    found: Pairs = set()
    for cell, segments in _by_cell(targets).items():
        distances = {
            (j, k): representation.distance(encoded[j], flat[cell, k]).item()
            for j in segments
            for k in range(flat.shape[1])
        }
        while distances:
            j, k = min(distances, key=distances.__getitem__)
            found.add((j, cell, k))
            distances = {pair: d for pair, d in distances.items() if pair[0] != j and pair[1] != k}
    return found


@torch.no_grad()
def match_cell_by_cell(
    params: Float[Tensor, "b s p g"], targets: Targets, representation: Representation
) -> Pairs:
    """Gives the same: all distances of a cell at once, the closest again and again from that matrix."""
    flat, encoded = params.flatten(0, 1), representation.encode(targets.endpoints)
    found: Pairs = set()
    for cell, segments in _by_cell(targets).items():
        matrix = representation.distance(encoded[segments][:, None], flat[cell][None]).numpy().copy()
        for _ in range(min(matrix.shape)):
            j, k = divmod(int(matrix.argmin()), matrix.shape[1])
            found.add((segments[j], cell, k))
            matrix[j], matrix[:, k] = np.inf, np.inf
    return found


def _by_cell(targets: Targets) -> dict[int, list[int]]:
    segments = defaultdict(list)
    for j, cell in enumerate(targets.cells.tolist()):
        segments[cell].append(j)
    return segments


__all__ = ["Pairs", "match_cell_by_cell", "match_pair_by_pair"]
