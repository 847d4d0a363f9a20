"""Matching equals a literal reading of the paper: the closest pair of each cell, again and again."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.grid import Grid
from yolino.model.representations import REPRESENTATIONS, CartesianPoints
from yolino.training.matching import match
from yolino.training.targets import CellTargets, cell_targets, collate
from yolino.types import Polylines


def brute_force(params, targets, representation, directed=True):
    """Loops over cells and pairs: the paper's sentence, word by word."""
    flat, pairs = params.flatten(0, 1), set()
    for cell in sorted(set(targets.cells.tolist())):
        lines = [j for j, c in enumerate(targets.cells.tolist()) if c == cell]
        free = list(range(flat.shape[1]))
        while lines and free:

            def distance(j, k, cell=cell):
                ways = (
                    [targets.endpoints[j]]
                    if directed
                    else [targets.endpoints[j], targets.endpoints[j].flip(0)]
                )
                return min(
                    representation.distance(representation.encode(w), flat[cell, k]).item() for w in ways
                )

            j, k = min(((j, k) for j in lines for k in free), key=lambda pair: distance(*pair))
            pairs.add((j, cell, k))
            lines.remove(j)
            free.remove(k)
    return pairs


def random_targets(rng, cells, most):
    counts = rng.integers(0, most + 1, cells)
    numbers = np.repeat(np.arange(cells), counts)
    n = len(numbers)
    return CellTargets(
        numbers, rng.random((n, 2, 2), dtype=np.float32), np.zeros(n, np.int64), np.zeros(cells, bool)
    )


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10**6), predictors=st.integers(1, 4), most=st.integers(0, 5), directed=st.booleans()
)
def test_equals_brute_force(seed, predictors, most, directed):
    rng = np.random.default_rng(seed)
    for representation in (cls() for cls in REPRESENTATIONS.values()):
        targets = collate([random_targets(rng, 5, most) for _ in range(2)])
        raw = torch.from_numpy(
            rng.normal(size=(2, 5, predictors, representation.num_params)).astype(np.float32)
        )
        params = representation.activate(raw)
        found = match(params, targets, representation, directed=directed)
        pairs = set(zip(found.targets.tolist(), found.cells.tolist(), found.predictors.tolist(), strict=True))
        assert pairs == brute_force(params, targets, representation, directed)
        assert found.surplus == len(targets.cells) - len(pairs)


def test_the_order_of_the_labels_does_not_matter():
    rng = np.random.default_rng(3)
    one = random_targets(rng, 6, 4)
    back = np.concatenate([np.flatnonzero(one.cells == c)[::-1] for c in range(6)])
    other = CellTargets(one.cells[back], one.endpoints[back], one.labels[back], one.ignored)
    params = torch.rand(1, 6, 3, 4)
    results = []
    for sample in (one, other):
        found = match(params, collate([sample]), CartesianPoints())
        results.append(
            {
                (tuple(g.tolist()), c, k)
                for g, c, k in zip(
                    found.encoded, found.cells.tolist(), found.predictors.tolist(), strict=True
                )
            }
        )
    assert results[0] == results[1]


def test_surplus_segments_stay_unmatched_and_are_counted():
    ends = np.array([[[0, 0], [1, 1]], [[0, 0.5], [1, 0.5]], [[0.5, 0], [0.5, 1]]], np.float32)
    targets = collate([CellTargets(np.zeros(3, np.int64), ends, np.zeros(3, np.int64), np.zeros(1, bool))])
    found = match(torch.tensor([[[[0.0, 0.5, 1.0, 0.5]]]]), targets, CartesianPoints())
    assert found.targets.tolist() == [1]
    assert found.surplus == 2


def test_an_undirected_line_takes_the_nearer_direction():
    ends = np.array([[[0, 0], [1, 1]]], np.float32)
    targets = collate([CellTargets(np.zeros(1, np.int64), ends, np.zeros(1, np.int64), np.zeros(1, bool))])
    params = torch.tensor([[[[1.0, 1.0, 0.0, 0.1], [0.4, 0.0, 1.0, 1.0]]]])
    assert match(params, targets, CartesianPoints(), directed=True).predictors.tolist() == [1]
    reverse = match(params, targets, CartesianPoints(), directed=False)
    assert reverse.predictors.tolist() == [0]
    assert reverse.encoded[0].tolist() == [1, 1, 0, 0]


def test_no_labels_no_pairs():
    nothing = collate([random_targets(np.random.default_rng(0), 4, 0)])
    assert len(match(torch.rand(1, 4, 2, 4), nothing, CartesianPoints()).targets) == 0


def test_targets_are_numbered_through_the_batch():
    lines = Polylines.from_list([[[1, 1], [30, 1]], [[1, 3], [1, 30]]])
    one = cell_targets(lines, Grid((32, 32), 16), border=False)
    batch = collate([one, one])
    assert batch.cells.tolist() == [0, 0, 1, 2, 4, 4, 5, 6]
    assert batch.ranks.tolist() == [0, 1, 0, 0, 0, 1, 0, 0]


def test_ignored_cells_hold_no_labels():
    lines = Polylines.from_list([[[0, 8], [32, 8]]])
    square = np.array([[0.0, 0.0], [15.0, 0.0], [15.0, 15.0], [0.0, 15.0]])
    found = cell_targets(lines, Grid((32, 32), 16), border=False, ignore=[square])
    assert found.cells.tolist() == [1]
    assert found.ignored.tolist() == [True, False, False, False]


@pytest.mark.parametrize("border", [True, False])
def test_no_polylines_give_empty_targets(border):
    assert len(cell_targets(Polylines.from_list([]), Grid((32, 32), 16), border=border).cells) == 0
