"""What every linker keeps: an entry of LINKERS is tested the moment it is added."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.geometry import distance_to_segments, resample
from yolino.postprocess import LINKERS, NMS
from yolino.types import Polylines, Segments

linkers = pytest.mark.parametrize("name", LINKERS)
Chain = Callable[..., Segments]
UP = [(40.0, 160.0 - 12 * i) for i in range(8)]


def assert_same(a: Polylines, b: Polylines) -> None:
    np.testing.assert_array_equal(a.vertices, b.vertices)
    np.testing.assert_array_equal(a.offsets, b.offsets)
    np.testing.assert_array_equal(a.scores, b.scores)
    np.testing.assert_array_equal(a.labels, b.labels)


def recovered(truth: Polylines, found: Polylines, tolerance: float) -> float:
    """Gives the share of the true length near a polyline that runs along that line from end to end."""
    lengths, hits = 0.0, 0.0
    for line in truth:
        points = resample(line, 1.0)
        near = np.zeros(len(points), bool)
        for other in found:
            pieces = np.stack([line[:-1], line[1:]], axis=1)
            if distance_to_segments(resample(other, 1.0), pieces).max() <= tolerance:
                near |= distance_to_segments(points, np.stack([other[:-1], other[1:]], axis=1)) <= tolerance
        hits, lengths = hits + near.sum(), lengths + len(points)
    return hits / lengths


@linkers
def test_no_segments_give_no_polylines(name: str) -> None:
    assert len(LINKERS[name](16.0)(Segments([]))) == 0
    none = LINKERS[name](16.0)(Segments([], probabilities=np.zeros((0, 3))))
    assert none.probabilities is not None
    assert none.probabilities.shape == (0, 3)


@linkers
def test_one_segment_gives_a_line_if_short_ones_are_wanted(name: str, chain: Chain) -> None:
    one = chain([(20, 50), (24, 40)], score=0.7, label=3)
    lines = LINKERS[name](16.0, min_length_cells=0.0)(one)
    assert len(lines) == 1
    np.testing.assert_allclose(lines.vertices[[0, -1]], [(20, 50), (24, 40)])
    assert (lines.scores.tolist(), lines.labels.tolist()) == ([0.7], [3])
    assert len(LINKERS[name](16.0)(one)) == 0


@linkers
def test_a_chain_gives_one_polyline_from_end_to_end(name: str, chain: Chain) -> None:
    lines = LINKERS[name](16.0)(chain(UP, score=0.5, label=2))
    assert len(lines) == 1
    np.testing.assert_allclose(lines.vertices[[0, -1]], [UP[0], UP[-1]], atol=1e-6)
    assert np.abs(lines.vertices[:, 0] - 40).max() < 1e-6
    assert (lines.scores.tolist(), lines.labels.tolist()) == ([0.5], [2])


@linkers
def test_a_fork_gives_both_branches(name: str, chain: Chain, join: Chain) -> None:
    trunk = [(80.0, 200.0 - 12 * i) for i in range(6)]
    left = [(80.0 - 8 * i, 140.0 - 12 * i) for i in range(7)]
    right = [(80.0 + 8 * i, 140.0 - 12 * i) for i in range(7)]
    lines = LINKERS[name](16.0)(join(chain(trunk), chain(left), chain(right)))
    assert len(lines) == (3 if name == "graph" else 2)
    for end in (left[-1], right[-1]):
        assert np.linalg.norm(lines.vertices - end, axis=1).min() < 2
    assert lines.lengths.sum() > 0.95 * (60 + 2 * 6 * np.hypot(8, 12))


@linkers
def test_a_merge_gives_both_branches(name: str, chain: Chain, join: Chain) -> None:
    left = [(8.0 + 8 * i, 212.0 - 12 * i) for i in range(7)]
    right = [(104.0 - 8 * i, 212.0 - 12 * i) for i in range(7)]
    trunk = [(56.0, 140.0 - 12 * i) for i in range(6)]
    lines = LINKERS[name](16.0)(join(chain(trunk), chain(left), chain(right)))
    assert len(lines) == (3 if name == "graph" else 2)
    for start in (left[0], right[0]):
        assert np.linalg.norm(lines.vertices - start, axis=1).min() < 2
    assert lines.lengths.sum() > 0.95 * (60 + 2 * 6 * np.hypot(8, 12))


@linkers
def test_a_loop_is_neither_lost_nor_walked_forever(name: str, chain: Chain) -> None:
    a = np.linspace(0, 2 * np.pi, 25)
    ring = np.stack([100 + 48 * np.cos(a), 100 + 48 * np.sin(a)], axis=1)
    options = {"max_downward_cells": None} if name == "tree" else {}
    lines = LINKERS[name](16.0, **options)(chain(ring))
    assert len(lines) == 1
    assert np.abs(np.linalg.norm(lines.vertices - 100, axis=1) - 48).max() < 1.5
    assert lines.lengths[0] == pytest.approx(2 * np.pi * 48, rel=0.05)


@linkers
def test_lines_that_cross_stay_two(name: str, chain: Chain, join: Chain) -> None:
    rising = [(20.0 + 10 * i, 200.0 - 12 * i) for i in range(13)]
    falling = [(140.0 - 10 * i, 200.0 - 12 * i) for i in range(13)]
    lines = LINKERS[name](16.0)(join(chain(rising), chain(falling)))
    truth = Polylines.from_list([rising, falling])
    assert len(lines) == 2
    assert recovered(truth, lines, 2.0) > 0.97


@linkers
@pytest.mark.parametrize("stride", [8, 16, 32])
@pytest.mark.parametrize("merged", [False, True])
def test_lanes_that_meet_at_the_horizon_are_recovered(
    name: str, stride: int, merged: bool, road: Callable[..., tuple[Polylines, Segments]]
) -> None:
    shares = []
    for seed in range(8):
        truth, segments = road(seed, 4 + seed % 2, stride)
        lines = LINKERS[name](float(stride))(NMS(float(stride))(segments) if merged else segments)
        inside = Polylines.from_list(
            [line[(line[:, 0] >= 0) & (line[:, 0] <= 640)] for line in (resample(v, 1.0) for v in truth)]
        )
        shares.append(recovered(inside, lines, 0.25 * stride))
    assert np.mean(shares) >= (0.97 if not merged else 0.95), shares
    assert merged or min(shares) >= 0.97


@linkers
@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 10**6), n=st.integers(0, 150), directed=st.booleans())
def test_the_order_of_the_segments_does_not_matter(
    name: str, noisy: Callable[[int, int], Segments], seed: int, n: int, directed: bool
) -> None:
    segments = noisy(seed, n) if n else Segments([])
    linker = LINKERS[name](16.0, directed=directed, min_length_cells=0.0)
    shuffled = segments[np.random.default_rng(seed).permutation(n)]
    assert_same(linker(segments), linker(shuffled))


@linkers
def test_ties_do_not_depend_on_the_order_either(name: str, chain: Chain, join: Chain) -> None:
    grid = join(
        *(chain([(x, 160.0 - 16 * i) for i in range(6)], label=int(x)) for x in (16.0, 24.0, 24.0, 32.0))
    )
    linker = LINKERS[name](16.0)
    lines = linker(grid)
    for seed in range(10):
        assert_same(lines, linker(grid[np.random.default_rng(seed).permutation(len(grid))]))


@linkers
@pytest.mark.parametrize("factor", [0.25, 2.0, 1000.0])
def test_segments_and_cells_may_be_scaled_together(
    name: str, factor: float, road: Callable[..., tuple[Polylines, Segments]]
) -> None:
    _, segments = road(3, 4)
    lines = LINKERS[name](16.0)(segments)
    scaled = LINKERS[name](16.0 * factor)(segments.with_endpoints(segments.endpoints * factor))
    np.testing.assert_allclose(scaled.vertices, lines.vertices * factor, rtol=1e-6, atol=1e-6 * factor)


@linkers
def test_undirected_segments_are_linked_whichever_way_they_point(name: str, chain: Chain) -> None:
    segments = chain(UP)
    flipped = segments.endpoints.copy()
    flipped[::2] = flipped[::2, ::-1]
    mixed = segments.with_endpoints(flipped)
    lines = LINKERS[name](16.0, directed=False)(mixed)
    assert len(lines) == 1
    ends = lines.vertices[[0, -1]]
    np.testing.assert_allclose(ends[np.argsort(-ends[:, 1])], [UP[0], UP[-1]], atol=1e-6)


@linkers
def test_labels_are_voted_by_score_and_length(name: str) -> None:
    steps = np.array([(40.0, 160.0 - 12 * i) for i in range(6)])
    endpoints = np.stack([steps[:-1], steps[1:]], axis=1)
    linker = LINKERS[name](16.0)
    assert linker(Segments(endpoints, [1, 1, 0.2, 0.2, 0.2], [4, 4, 9, 9, 9])).labels.tolist() == [4]
    assert linker(Segments(endpoints, np.ones(5), [4, 4, 9, 9, 9])).labels.tolist() == [9]
    assert linker(Segments(endpoints)).probabilities is None
    sure = np.array([[0.9, 0.1]] * 2 + [[0.4, 0.6]] * 3)
    lines = linker(Segments(endpoints, np.ones(5), probabilities=sure))
    assert lines.labels.tolist() == [0]
    np.testing.assert_allclose(lines.probabilities, [[0.6, 0.4]])


@linkers
def test_short_and_unlikely_polylines_are_dropped(name: str, chain: Chain, join: Chain) -> None:
    both = join(chain(UP, 0.9), chain([(150.0, 160.0 - 12 * i) for i in range(5)], 0.4))
    kinds = LINKERS[name]
    assert len(kinds(16.0)(both)) == 2
    assert kinds(16.0, min_length_cells=48 / 16 + 0.01)(both).scores == pytest.approx([0.9])
    assert len(kinds(16.0, min_length_cells=48 / 16 - 0.01)(both)) == 2
    assert kinds(16.0, min_score=0.5)(both).scores == pytest.approx([0.9])


@linkers
def test_segments_without_length_and_without_score_do_no_harm(name: str, chain: Chain, join: Chain) -> None:
    points = Segments(np.repeat(np.array(UP)[2:5, None], 2, axis=1), [0.0, 0.0, 0.0])
    lines = LINKERS[name](16.0)(join(chain(UP, 0.0), points))
    assert np.isfinite(lines.vertices).all()
    assert lines.scores.tolist() == [0.0]
    assert len(LINKERS[name](16.0, min_length_cells=0.0)(points)) == 0


@linkers
def test_input_is_left_as_it_is(name: str, noisy: Callable[[int, int], Segments]) -> None:
    segments = noisy(5, 80)
    before = segments.endpoints.copy()
    LINKERS[name](16.0, directed=False)(segments)
    np.testing.assert_array_equal(segments.endpoints, before)


@linkers
@pytest.mark.parametrize(
    ("endpoint", "score", "message"),
    [
        (np.nan, 1.0, "NaN or infinity"),
        (1.0, np.inf, "NaN or infinity"),
        (1.0, -1.0, "at least 0"),
        (1e9, 1.0, "farther than"),
    ],
)
def test_bad_segments_are_named(name: str, endpoint: float, score: float, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        LINKERS[name](16.0)(Segments([[[0.0, 0.0], [0.0, endpoint]]], [score]))


@linkers
@pytest.mark.parametrize(
    "arguments",
    [
        {"cell_size": 0.0},
        {"cell_size": np.nan},
        {"smoothing": -1.0},
        {"min_score": np.nan},
        {"min_length_cells": -1.0},
    ],
)
def test_bad_parameters_are_named(name: str, arguments: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="is needed"):
        LINKERS[name](**{"cell_size": 16.0, **arguments})
