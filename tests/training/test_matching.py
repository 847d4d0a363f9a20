"""Matching equals a literal reading of the paper: the closest pair of each cell, again and again."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.grid import Grid
from yolino.model.representations import REPRESENTATIONS, CartesianPoints
from yolino.training.matching import gap_cells, match, several_at
from yolino.training.targets import CellTargets, cell_targets, collate
from yolino.types import Polylines


def brute_force(params, targets, representation, directed=True, several=1):
    """Loops over cells and pairs: the paper's sentence, word by word, and again with the predictors left."""
    flat, pairs = params.flatten(0, 1), set()
    for cell in sorted(set(targets.cells.tolist())):
        lines, rounds = [], several
        free = list(range(flat.shape[1]))
        while (lines or rounds) and free:
            if not lines:
                lines = [j for j, c in enumerate(targets.cells.tolist()) if c == cell]
                rounds -= 1

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


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    predictors=st.integers(1, 7),
    several=st.integers(1, 5),
    name=st.sampled_from(list(REPRESENTATIONS)),
    directed=st.booleans(),
)
def test_several_for_each_segment_equal_brute_force(seed, predictors, several, name, directed):
    rng = np.random.default_rng(seed)
    targets = collate([random_targets(rng, 5, 4) for _ in range(2)])
    representation = REPRESENTATIONS[name]()
    raw = rng.normal(size=(2, 5, predictors, representation.num_params)).astype(np.float32)
    params = representation.activate(torch.from_numpy(raw))
    found = match(params, targets, representation, directed=directed, several=several)
    pairs = list(zip(found.targets.tolist(), found.cells.tolist(), found.predictors.tolist(), strict=True))
    assert set(pairs) == brute_force(params, targets, representation, directed, several)
    assert len({(cell, k) for _, cell, k in pairs}) == len(pairs), "a predictor answers for two segments"
    one = match(params, targets, representation, directed=directed)
    n = len(one.targets)
    assert found.surplus == one.surplus
    for both in (
        (one.targets, found.targets),
        (one.predictors, found.predictors),
        (one.encoded, found.encoded),
    ):
        assert torch.equal(both[0], both[1][:n]), "the first pairs are not those of the paper"


def test_each_segment_has_one_before_any_has_two():
    ends = np.array([[[0, 0], [1, 0]], [[0, 1], [1, 1]]], np.float32)
    targets = collate([CellTargets(np.zeros(2, np.int64), ends, np.zeros(2, np.int64), np.zeros(1, bool))])
    y = torch.tensor([0.1, 0.2, 0.3, 0.4])  # all nearer to the upper segment
    params = torch.stack([torch.zeros(4), y, torch.ones(4), y], dim=-1)[None, None]
    expected = {1: [(0, 0), (1, 3)], 2: [(0, 0), (1, 3), (0, 1), (1, 2)]}
    expected |= {3: expected[2], 9: expected[2]}
    for several, pairs in expected.items():
        found = match(params, targets, CartesianPoints(), several=several)
        assert list(zip(found.targets.tolist(), found.predictors.tolist(), strict=True)) == pairs


def test_the_number_for_each_segment_falls_one_by_one():
    numbers = [several_at(step, steps=100, several=4, until=0.3) for step in range(100)]
    assert numbers == [4] * 10 + [3] * 10 + [2] * 10 + [1] * 70
    assert [several_at(step, steps=4, several=2, until=0.5) for step in range(5)] == [2, 2, 1, 1, 1]
    assert [several_at(step, steps=4, several=3, until=1.0) for step in range(5)] == [3, 3, 2, 2, 1]
    assert several_at(0, steps=10, several=5, until=0.0) == 1
    assert {several_at(step, steps=7, several=1, until=0.9) for step in range(9)} == {1}


def test_the_gap_is_the_mean_distance_of_both_ends():
    a = torch.tensor([[0.0, 0.0], [1.0, 0.0]])
    assert gap_cells(a, torch.tensor([[0.0, 0.1], [1.3, 0.4]])).item() == pytest.approx((0.1 + 0.5) / 2)
    assert gap_cells(a, a).item() == 0


@pytest.mark.parametrize("name", list(REPRESENTATIONS))
@pytest.mark.parametrize("directed", [True, False])
def test_gaps_are_those_to_the_nearest_label_of_the_cell(name, directed):
    rng, representation = np.random.default_rng(4), REPRESENTATIONS[name]()
    targets = collate([random_targets(rng, 4, 3) for _ in range(2)])
    raw = rng.normal(size=(2, 4, 3, representation.num_params)).astype(np.float32)
    params = representation.activate(torch.from_numpy(raw))
    found = match(params, targets, representation, directed=directed, gaps=True).gaps_cells
    assert match(params, targets, representation).gaps_cells is None
    for cell, k in np.ndindex(8, 3):
        (x, y), (u, v) = representation.decode(params.flatten(0, 1)[cell, k]).tolist()
        nearest = np.inf
        for truth in targets.endpoints[targets.cells == cell].tolist():
            for (a, b), (c, d) in [truth] if directed else [truth, truth[::-1]]:
                nearest = min(nearest, (np.hypot(x - a, y - b) + np.hypot(u - c, v - d)) / 2)
        assert found[cell, k].item() == pytest.approx(nearest, rel=1e-5)


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
    found = match(torch.rand(1, 4, 2, 4), nothing, CartesianPoints(), several=3, gaps=True)
    assert len(found.targets) == found.surplus == 0
    assert torch.equal(found.gaps_cells, torch.full((4, 2), torch.inf))


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
