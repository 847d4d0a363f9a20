"""The tree linker: the paper's figure, and what it takes not to lose lines."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from yolino.postprocess import TreeLinker
from yolino.postprocess.tree import LinkCounts
from yolino.types import Segments

Chain = Callable[..., Segments]
EXACT = {"smoothing": 0.0, "min_length_cells": 0.0}

# The paper's figure: 1, 2 and 3 share the successor 6, 4 has 7, 6 and 7 share 8; 5 has none.
FIGURE = np.array(
    [
        [(100, 300), (100, 288)],
        [(104, 300), (102, 288)],
        [(97, 300), (98, 288)],
        [(108, 300), (106, 288)],
        [(180, 300), (180, 288)],
        [(101, 287), (102, 275)],
        [(105, 287), (104, 275)],
        [(103, 274), (103, 262)],
    ],
    float,
)
SCORES = np.array([0.9, 0.8, 0.5, 0.7, 1.0, 0.6, 0.8, 0.9])


def levels() -> np.ndarray:
    """The averaged levels of the figure, the deepest first."""
    groups = ([0, 1, 2, 3], [5, 6], [7])
    return np.array([np.average(FIGURE[g], axis=0, weights=SCORES[g]) for g in groups])


def test_the_tree_of_the_papers_figure() -> None:
    lines = TreeLinker(16.0, min_segments=3, **EXACT)(Segments(FIGURE, SCORES))
    assert len(lines) == 1
    means = levels()
    through = [means[0, 0], *means.mean(axis=1), means[2, 1]]
    for point in through:
        assert np.linalg.norm(lines.vertices - point, axis=1).min() < 4.0
    np.testing.assert_allclose(lines.vertices[[0, -1]], [means[0, 0], means[2, 1]], atol=1e-6)
    fine = TreeLinker(16.0, min_segments=3, **EXACT)
    fine._spline = (0.001, *fine._spline[1:])
    for point in through:
        assert np.linalg.norm(fine(Segments(FIGURE, SCORES)).vertices - point, axis=1).min() < 0.02


def test_tau_s_counts_levels() -> None:
    for tau, expected in ((1, 2), (2, 1), (3, 1), (4, 0)):
        lines, counts = TreeLinker(16.0, min_segments=tau, **EXACT).link_with_counts(Segments(FIGURE, SCORES))
        assert len(lines) == expected
        assert counts == LinkCounts(downward=0, cycles=0, branches=0, short=2 - expected)


def test_the_score_is_the_mean_of_the_levels_by_length() -> None:
    lines = TreeLinker(16.0, min_segments=3, **EXACT)(Segments(FIGURE, SCORES))
    groups = ([0, 1, 2, 3], [5, 6], [7])
    means = np.array([(SCORES[g] ** 2).sum() / SCORES[g].sum() for g in groups])
    lengths = np.linalg.norm(levels()[:, 1] - levels()[:, 0], axis=1)
    gaps = 2 * 1.0
    assert lines.scores[0] == pytest.approx((means * lengths).sum() / (lengths.sum() + gaps), rel=0.02)


def test_segments_that_point_downwards_are_discarded_and_counted() -> None:
    slightly, too_much = [(0.0, 100.0), (16.0, 104.0)], [(0.0, 200.0), (16.0, 204.1)]
    lines, counts = TreeLinker(16.0, **EXACT).link_with_counts(Segments([slightly, too_much]))
    assert counts.downward == 1
    assert lines.vertices[:, 1].max() < 105
    assert len(TreeLinker(16.0, max_downward_cells=None, **EXACT)(Segments([slightly, too_much]))) == 2
    assert TreeLinker(16.0, **EXACT).link_with_counts(Segments([too_much]))[1] == LinkCounts(1, 0, 0, 0)


def test_the_successor_is_the_nearest_start_within_the_radius(chain: Chain) -> None:
    for gap, count in ((11.9, 1), (12.1, 2)):
        pair = Segments([[(50.0, 100.0), (50.0, 88.0)], [(50.0, 88.0 - gap), (50.0, 64.0)]])
        assert len(TreeLinker(16.0, **EXACT)(pair)) == count
    nearest = Segments(
        [[(50.0, 100.0), (50.0, 88.0)], [(52.0, 88.0), (52.0, 76.0)], [(45.0, 88.0), (45.0, 76.0)]]
    )
    lines = TreeLinker(16.0, **EXACT)(nearest)
    assert sorted(np.round(line[-1, 0]) for line in lines) == [45, 52]
    assert {len(line) > 3: round(line[-1, 0]) for line in lines}[True] == 52


def test_no_successor_starts_in_the_bottom_half_of_the_last_row() -> None:
    for start, count in ((311.0, 1), (313.0, 2)):
        pair = Segments([[(40.0, 319.0), (50.0, 312.0)], [(52.0, start), (62.0, start - 10)]])
        assert len(TreeLinker(16.0, image_height=320.0, **EXACT)(pair)) == count
        assert len(TreeLinker(16.0, **EXACT)(pair)) == 1


def test_a_successor_lies_ahead() -> None:
    for start, count in ((93.0, 1), (95.0, 2), (99.0, 2)):
        pair = Segments([[(40.0, 100.0), (40.0, 88.0)], [(41.0, start), (41.0, start - 12)]])
        lines, counts = TreeLinker(16.0, **EXACT).link_with_counts(pair)
        assert (len(lines), counts.cycles) == (count, 0)


def test_of_equally_near_successors_the_straightest_goes_on() -> None:
    steps = np.arange(5) * 12.0
    rising = np.stack([100 + steps, 100 - steps], axis=1)
    falling = np.stack([100 - steps, 100 - steps], axis=1)
    pieces = [
        np.stack([v[:-1], v[1:]], axis=1) for v in (rising, falling, 200 - rising[::-1], 200 - falling[::-1])
    ]
    lines = TreeLinker(16.0, **EXACT)(Segments(np.concatenate(pieces)))
    assert sorted(np.sign((line[-1, 0] - 100) * (line[0, 0] - 100)) for line in lines) == [-1, -1]


def test_cycles_are_cut_at_the_widest_link_and_counted() -> None:
    a = np.linspace(0, 2 * np.pi, 13)
    ring = np.stack([100 + 24 * np.cos(a), 100 + 24 * np.sin(a)], axis=1)
    endpoints = np.stack([ring[:-1], ring[1:]], axis=1)
    endpoints[4, 1] += (endpoints[4, 0] - endpoints[4, 1]) * 0.3
    lines, counts = TreeLinker(16.0, max_downward_cells=None, **EXACT).link_with_counts(Segments(endpoints))
    assert (len(lines), counts.cycles) == (1, 1)
    np.testing.assert_allclose(lines.vertices[[0, -1]], [endpoints[5, 0], endpoints[4, 1]], atol=1e-6)


def test_branches_that_part_are_cut_and_those_that_do_not_are_averaged(chain: Chain, join: Chain) -> None:
    trunk = [(100.0, 200.0 - 12 * i) for i in range(6)]
    for spread, branches in ((0.8, 0), (9.0, 1)):
        left = [(100 - spread * (6 - i), 272.0 - 12 * i) for i in range(7)]
        right = [(100 + spread * (6 - i), 272.0 - 12 * i) for i in range(7)]
        lines, counts = TreeLinker(16.0).link_with_counts(join(chain(trunk), chain(left), chain(right)))
        assert (counts.branches, len(lines)) == (branches, 1 + branches)
    merged = TreeLinker(16.0, branch_radius_cells=100.0)(join(chain(trunk), chain(left), chain(right)))
    assert np.abs(merged.vertices[:, 0] - 100).max() < 1e-6


def test_a_short_branch_beside_a_line_is_averaged_into_it(chain: Chain, join: Chain) -> None:
    line = [(100.0, 300.0 - 12 * i) for i in range(16)]
    twin = [(104.0, 300.0 - 12 * i) for i in range(5, 8)]
    lines, counts = TreeLinker(16.0).link_with_counts(join(chain(line), chain(twin)))
    assert (len(lines), counts.branches) == (1, 0)
    assert 100.5 < lines.vertices[:, 0].max() < 104


def test_two_predictions_of_a_branch_stay_together_when_it_is_cut(chain: Chain, join: Chain) -> None:
    trunk = [(100.0, 200.0 - 12 * i) for i in range(9)]
    below = [(100.0, 272.0 - 12 * i) for i in range(7)]
    side = [[(100 + x + 9 * (6 - i), 272.0 - 12 * i) for i in range(7)] for x in (1, 3)]
    lines, counts = TreeLinker(16.0).link_with_counts(join(*map(chain, (trunk, below, *side))))
    assert (len(lines), counts.branches) == (2, 1)
    assert min(abs(line[0, 0] - (102 + 54)) for line in lines) < 0.5


def test_undirected_segments_are_turned_upwards() -> None:
    lines = TreeLinker(16.0, directed=False, **EXACT)(
        Segments(
            [[(40.0, 88.0), (40.0, 100.0)], [(40.0, 88.0), (40.0, 76.0)], [(200.0, 50.0), (180.0, 50.0)]]
        )
    )
    ends = sorted(tuple(np.round(line[[0, -1]]).ravel()) for line in lines)
    assert ends == [(40, 100, 40, 76), (180, 50, 200, 50)]


@pytest.mark.parametrize(
    "arguments", [{"successor_radius_cells": 0.0}, {"branch_radius_cells": -1.0}, {"image_height": np.nan}]
)
def test_bad_parameters_are_named(arguments: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=f"{next(iter(arguments))} is .* is needed"):
        TreeLinker(16.0, **arguments)
