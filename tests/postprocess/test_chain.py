"""The chain linker: links, duplicates, gaps, rings, scores."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yolino.postprocess import ChainLinker
from yolino.types import Segments

Chain = Callable[..., Segments]


def column(x: float, first: int, last: int) -> list[tuple[float, float]]:
    """Gives vertices from row to row of cells of 16 px, upwards."""
    return [(x, 320.0 - 16 * i) for i in range(first, last + 1)]


def test_gaps_are_joined_up_to_their_limit(chain: Chain, join: Chain) -> None:
    for gap, count in ((2, 1), (5, 1), (7, 2)):
        parts = join(chain(column(40, 0, 5)), chain(column(40, 5 + gap, 10 + gap)))
        assert len(ChainLinker(16.0)(parts)) == count
        assert len(ChainLinker(16.0, max_gap_cells=0.0)(parts)) == 2
    assert len(ChainLinker(16.0, max_gap_cells=8.0)(parts)) == 1


def test_gaps_are_joined_along_a_curve_but_not_around_a_corner(chain: Chain, join: Chain) -> None:
    a = np.linspace(0, np.pi / 2, 20)
    bow = np.stack([40 + 200 * (1 - np.cos(a)), 300 - 200 * np.sin(a)], axis=1)
    assert len(ChainLinker(16.0)(join(chain(bow[:9]), chain(bow[12:])))) == 1
    corner = join(chain(column(40, 0, 6)), chain([(72.0 + 16 * i, 192.0) for i in range(6)]))
    assert len(ChainLinker(16.0)(corner)) == 2


def test_two_stray_segments_are_not_joined_over_a_long_gap(chain: Chain, join: Chain) -> None:
    strays = join(chain(column(40, 0, 1)), chain(column(40, 6, 7)))
    assert len(ChainLinker(16.0)(strays)) == 0
    assert len(ChainLinker(16.0, min_length_cells=0.0)(strays)) == 2


def test_gaps_count_as_zero_in_the_score(chain: Chain, join: Chain) -> None:
    lines = ChainLinker(16.0)(join(chain(column(40, 0, 6), 0.9), chain(column(40, 10, 16), 0.6)))
    assert lines.scores == pytest.approx([(6 * 0.9 + 6 * 0.6) / 16], abs=1e-3)


@pytest.mark.parametrize(("distance", "count"), [(6.0, 1), (11.0, 1), (14.0, 2)])
def test_of_parallel_chains_the_strongest_stays(
    chain: Chain, join: Chain, distance: float, count: int
) -> None:
    twins = join(chain(column(40, 0, 10), 0.8), chain(column(40 + distance, 0, 10), 0.9))
    lines = ChainLinker(16.0)(twins)
    assert len(lines) == count
    if count == 1:
        assert lines.vertices[:, 0] == pytest.approx(40 + distance)
    assert len(ChainLinker(16.0, duplicate_radius_cells=0.0)(twins)) == 2


def test_a_chain_beside_another_for_less_than_half_its_length_stays(chain: Chain, join: Chain) -> None:
    for overlap, count in ((4, 2), (6, 1)):
        parts = join(chain(column(40, 0, 20)), chain(column(50, 20 - overlap, 30 - overlap)))
        assert len(ChainLinker(16.0, max_gap_cells=0.0)(parts)) == count


def test_opposite_directions_in_one_place_are_two_lines_or_one(chain: Chain, join: Chain) -> None:
    both = join(chain(column(40, 0, 8)), chain(column(40, 0, 8)[::-1]))
    lines = ChainLinker(16.0)(both)
    assert sorted(np.sign(line[-1, 1] - line[0, 1]) for line in lines) == [-1, 1]
    assert len(ChainLinker(16.0, directed=False)(both)) == 1


def test_undirected_lines_point_where_most_of_them_does(chain: Chain) -> None:
    endpoints = chain(column(40, 0, 9)).endpoints.copy()
    endpoints[[1, 5, 6]] = endpoints[[1, 5, 6], ::-1]
    (line,) = ChainLinker(16.0, directed=False)(Segments(endpoints))
    assert line[-1, 1] < line[0, 1]
    (line,) = ChainLinker(16.0, directed=False)(Segments(endpoints[:, ::-1].copy()))
    assert line[-1, 1] > line[0, 1]


@pytest.mark.parametrize("directed", [True, False])
def test_a_ring_ends_where_it_begins(chain: Chain, directed: bool) -> None:
    a = np.linspace(0, 2 * np.pi, 41)
    ring = np.stack([200 + 100 * np.cos(a), 160 + 100 * np.sin(a)], axis=1)
    (line,) = ChainLinker(16.0, directed=directed, smoothing=0.0)(chain(ring))
    np.testing.assert_allclose(line[0], line[-1], atol=1e-6)
    assert np.abs(np.linalg.norm(line - (200, 160), axis=1) - 100).max() < 1.5


def test_a_ring_opens_at_its_weakest_link(chain: Chain) -> None:
    a = np.linspace(0, 2 * np.pi, 41)
    endpoints = chain(np.stack([200 + 100 * np.cos(a), 160 + 100 * np.sin(a)], axis=1)).endpoints.copy()
    endpoints[17] += 3.0
    (line,) = ChainLinker(16.0)(Segments(endpoints))
    assert np.linalg.norm(line[0] - endpoints[17], axis=1).min() < 5


def test_turns_beyond_the_limit_break_a_chain(chain: Chain) -> None:
    zigzag = chain([(40.0, 300.0), (40.0, 280.0), (40.0, 260.0), (60.0, 260.0), (80.0, 260.0)])
    assert len(ChainLinker(16.0)(zigzag)) == 2
    (line,) = ChainLinker(16.0, max_turn=1.7)(zigzag)
    np.testing.assert_allclose(line[[0, -1]], [(40, 300), (80, 260)], atol=2)


def test_segments_that_overlap_do_not_fold_the_line(chain: Chain, join: Chain) -> None:
    overlapping = join(
        chain([(40.0, 300.0 - 10 * i) for i in range(20)]), chain([(41.0, 206.0), (41.0, 196.0)])
    )
    (line,) = ChainLinker(16.0)(overlapping)
    assert (np.diff(line[:, 1]) < 0).all()
    split = join(chain(column(40, 0, 8)), chain([(42.0, y + 14.0) for _, y in column(42, 8, 16)]))
    (line,) = ChainLinker(16.0)(split)
    assert (np.diff(line[:, 1]) < 0).all()


@given(
    scores=st.lists(st.sampled_from([0.2, 0.4, 0.6, 0.8]), min_size=1, max_size=12),
    lowest=st.floats(0.1, 0.9),
)
def test_weak_segments_leave_the_ends_and_nothing_else(
    chain: Chain, scores: list[float], lowest: float
) -> None:
    line = chain(column(40, 0, len(scores)))
    every = Segments(line.endpoints, scores)
    strong = [i for i, score in enumerate(scores) if score >= lowest]
    options = {"min_length_cells": 0.0, "duplicate_radius_cells": 0.0}
    found = ChainLinker(16.0, min_end_score=lowest, **options)(every)
    if not strong:
        assert len(found) == 0
        return
    wanted = ChainLinker(16.0, **options)(every[np.arange(strong[0], strong[-1] + 1)])
    np.testing.assert_allclose(found.vertices, wanted.vertices)
    np.testing.assert_allclose(found.scores, wanted.scores)


def test_weak_ends_are_taken_off_after_gaps_are_joined(chain: Chain, join: Chain) -> None:
    """A weak part between two strong ones bridges the gaps; the same part at an end goes."""
    parts = [chain(column(40, first, first + 4), score) for first, score in ((0, 0.9), (7, 0.5), (14, 0.9))]
    (line,) = ChainLinker(16.0, min_end_score=0.8)(join(*parts))
    assert line[[0, -1], 1] == pytest.approx([320, 320 - 16 * 18], abs=0.1)
    (line,) = ChainLinker(16.0, min_end_score=0.8)(join(*parts[:2]))
    assert line[[0, -1], 1] == pytest.approx([320, 320 - 16 * 4], abs=0.1)


def test_a_weak_ring_stays_and_a_weak_line_goes(chain: Chain, join: Chain) -> None:
    a = np.linspace(0, 2 * np.pi, 41)
    ring = chain(np.stack([200 + 100 * np.cos(a), 160 + 100 * np.sin(a)], axis=1), 0.5)
    every = join(chain(column(400, 0, 8), 0.5), ring, chain(column(600, 0, 8), 0.9, 1))
    found = ChainLinker(16.0, min_end_score=0.7)(every)
    assert sorted(zip(found.scores.round(3).tolist(), found.labels.tolist(), strict=True)) == [
        (0.5, 0),
        (0.9, 1),
    ]


def test_noisy_lanes_are_found_once_each(road: Callable[..., tuple]) -> None:
    rng = np.random.default_rng(0)
    truth, segments = road(5, 4)
    keep = rng.random(len(segments)) < 0.9
    endpoints = segments.endpoints[keep] + rng.normal(0, 1.0, (keep.sum(), 2, 2))
    lines = ChainLinker(16.0, min_length_cells=4.0)(Segments(endpoints))
    assert len(lines) == len(truth)


@pytest.mark.parametrize(
    "arguments",
    [
        {"link_radius_cells": 0.0},
        {"max_gap_cells": -1.0},
        {"duplicate_radius_cells": np.inf},
        {"max_turn": 3.5},
        {"min_end_score": -0.1},
        {"level_ends_cells": -1.0},
    ],
)
def test_bad_parameters_are_named(arguments: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=f"{next(iter(arguments))} is .* is needed"):
        ChainLinker(16.0, **arguments)
