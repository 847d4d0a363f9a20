"""The graph linker: forks, merges, crossings, loops, dashes, classes, and exactly shared vertices."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from yolino.geometry import distance_to_segments, resample
from yolino.postprocess import GraphLinker
from yolino.types import Polylines, Segments

Chain = Callable[..., Segments]
CELL = 16.0


def path(*corners: tuple[float, float], spacing: float = 14.0) -> np.ndarray:
    """Gives points at most `spacing` apart along the line through the corners, corners included."""
    parts = [resample(np.array([a, b], float), spacing) for a, b in pairwise(corners)]
    return np.concatenate([parts[0], *(part[1:] for part in parts[1:])])


def arc(middle: tuple[float, float], radius: float, first: float, last: float, count: int = 25) -> np.ndarray:
    a = np.linspace(first, last, count)
    return np.stack([middle[0] + radius * np.cos(a), middle[1] + radius * np.sin(a)], axis=1)


def ends(lines: Polylines) -> tuple[Counter, Counter]:
    """Gives how often each place is a start, and an end: exactly the same coordinates, bit by bit."""
    starts = Counter(line[0].tobytes() for line in lines)
    return starts, Counter(line[-1].tobytes() for line in lines)


def joints(lines: Polylines) -> list[tuple[int, int]]:
    """Gives for each place where lines meet how many come in and how many go out."""
    starts, stops = ends(lines)
    return sorted(
        (stops[place], starts[place])
        for place in set(starts) | set(stops)
        if stops[place] + starts[place] > 1
    )


def at(lines: Polylines, places: str = "shared") -> np.ndarray:
    """Gives the places where more than one polyline starts or ends."""
    starts, stops = ends(lines)
    shared = [place for place, count in (starts + stops).items() if count > 1]
    return np.array([np.frombuffer(place) for place in shared]).reshape(-1, 2)


def rotated(points: np.ndarray, degrees: int) -> np.ndarray:
    c, s = {0: (1, 0), 90: (0, 1), 180: (-1, 0), 270: (0, -1)}[degrees]
    return points @ np.array([[c, s], [-s, c]], float)


TRUNK = path((200, 300), (200, 200))
LEFT = path((200, 200), (150, 130), (120, 60))
RIGHT = path((200, 200), (250, 130), (280, 60))


@pytest.mark.parametrize("smoothing", [0.0, 0.05])
def test_of_a_fork_one_comes_in_and_two_go_out(chain: Chain, join: Chain, smoothing: float) -> None:
    lines = GraphLinker(CELL, smoothing=smoothing)(join(chain(TRUNK), chain(LEFT), chain(RIGHT)))
    assert len(lines) == 3
    assert joints(lines) == [(1, 2)]
    np.testing.assert_allclose(at(lines), [(200, 200)], atol=1e-9)
    loose = {tuple(np.round(line[k]).astype(int)) for line in lines for k in (0, -1)}
    assert loose == {(200, 300), (200, 200), (120, 60), (280, 60)}


@pytest.mark.parametrize("smoothing", [0.0, 0.05])
def test_of_a_merge_two_come_in_and_one_goes_out(chain: Chain, join: Chain, smoothing: float) -> None:
    merge = join(chain(TRUNK[::-1]), chain(LEFT[::-1]), chain(RIGHT[::-1]))
    lines = GraphLinker(CELL, smoothing=smoothing)(merge)
    assert len(lines) == 3
    assert joints(lines) == [(2, 1)]
    np.testing.assert_allclose(at(lines), [(200, 200)], atol=1e-9)


def test_a_fork_into_three_has_one_vertex(chain: Chain, join: Chain) -> None:
    middle = path((200, 200), (200, 60))
    lines = GraphLinker(CELL)(join(chain(TRUNK), chain(LEFT), chain(RIGHT), chain(middle)))
    assert joints(lines) == [(1, 3)]
    np.testing.assert_allclose(at(lines), [(200, 200)], atol=1e-9)


def test_a_branch_leaves_from_the_middle_of_a_segment(chain: Chain, join: Chain) -> None:
    through = chain([(40.0 + 16 * i, 100.0) for i in range(13)])
    branch = chain(path((128.0, 100.0), (190.0, 160.0)))
    lines = GraphLinker(CELL, smoothing=0.0)(join(through, branch))
    assert joints(lines) == [(1, 2)]
    np.testing.assert_allclose(at(lines), [(128, 100)], atol=1e-9)


@pytest.mark.parametrize("distance", [2.0, 5.0])
def test_a_branch_that_starts_beside_a_line_meets_it_farther_back(
    chain: Chain, join: Chain, distance: float
) -> None:
    through = chain([(40.0 + 16 * i, 100.0) for i in range(13)])
    branch = chain(path((128.0, 100.0 + distance), (208.0, 140.0 + distance)))
    lines = GraphLinker(CELL, smoothing=0.0)(join(through, branch))
    assert joints(lines) == [(1, 2)]
    np.testing.assert_allclose(at(lines), [(128 - 2 * distance, 100)], atol=1e-6)


@pytest.mark.parametrize("directed", [True, False])
@pytest.mark.parametrize("angle", [30, 60, 90, 120])
def test_lines_that_cross_pass_each_other_uncut(
    chain: Chain, join: Chain, directed: bool, angle: int
) -> None:
    way = 100 * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    middle = np.array([200.0, 200.0])
    a, b = path((100, 200), (300, 200)), path(tuple(middle - way), tuple(middle + way))
    lines = GraphLinker(CELL, directed=directed)(join(chain(a), chain(b)))
    assert len(lines) == 2
    assert joints(lines) == []
    for truth in (a, b):
        assert min(np.abs(distance_to_segments(line, chain(truth).endpoints)).max() for line in lines) < 1


def test_opposite_directions_in_the_same_pixels_stay_two_lines(chain: Chain, join: Chain) -> None:
    there = path((40, 100), (300, 100), (400, 60))
    lines = GraphLinker(CELL)(join(chain(there), chain(there[::-1])))
    assert len(lines) == 2
    assert joints(lines) == [(1, 1), (1, 1)]
    np.testing.assert_allclose(sorted(line[0, 0] for line in lines), [40, 400])
    undirected = GraphLinker(CELL, directed=False)(join(chain(there), chain(there[::-1])))
    assert len(undirected) == 1


@pytest.mark.parametrize("directed", [True, False])
@pytest.mark.parametrize("smoothing", [0.0, 0.05])
def test_a_loop_is_closed_exactly(chain: Chain, directed: bool, smoothing: float) -> None:
    ring = arc((200, 200), 80, 0, 2 * np.pi, 41)
    (line,) = GraphLinker(CELL, directed=directed, smoothing=smoothing)(chain(ring))
    assert (line[0] == line[-1]).all()
    assert np.abs(np.linalg.norm(line - (200, 200), axis=1) - 80).max() < 1
    assert np.hypot(*np.diff(line, axis=0).T).sum() == pytest.approx(2 * np.pi * 80, rel=0.01)


def test_a_ring_is_cut_where_a_line_leaves_it(chain: Chain, join: Chain) -> None:
    ring = arc((200, 200), 80, 0, 2 * np.pi, 41)
    exit_ = path((200, 280), (120, 290), (60, 330))
    lines = GraphLinker(CELL)(join(chain(ring), chain(exit_)))
    assert len(lines) == 2
    assert joints(lines) == [(1, 2)]
    closed = [line for line in lines if (line[0] == line[-1]).all()]
    assert len(closed) == 1
    assert np.abs(np.linalg.norm(closed[0] - (200, 200), axis=1) - 80).max() < 1


def test_dashes_stay_dashes_and_small_gaps_are_bridged(chain: Chain, join: Chain) -> None:
    def dashes(gap: float) -> Segments:
        starts = [40 + k * (48 + gap) for k in range(4)]
        return join(*(chain(path((x, 100), (x + 48, 100))) for x in starts))

    assert len(GraphLinker(CELL)(dashes(2.5 * CELL))) == 4
    assert len(GraphLinker(CELL)(dashes(1.4 * CELL))) == 1
    assert len(GraphLinker(CELL, max_gap_cells=0.0)(dashes(1.4 * CELL))) == 4
    assert len(GraphLinker(CELL, max_gap_cells=3.0)(dashes(2.5 * CELL))) == 1


def test_a_branch_is_found_across_a_lost_segment(chain: Chain, join: Chain) -> None:
    lost = chain(RIGHT[1:])
    assert joints(GraphLinker(CELL)(join(chain(TRUNK), chain(LEFT), lost))) == [(1, 2)]
    apart = GraphLinker(CELL, max_gap_cells=0.0)(join(chain(TRUNK), chain(LEFT), lost))
    assert (len(apart), joints(apart)) == (2, [])


def test_a_line_that_ends_at_the_side_of_another_meets_it_if_undirected(chain: Chain, join: Chain) -> None:
    bar, stem = path((100, 200), (300, 200)), path((203, 60), (203, 195))
    lines = GraphLinker(CELL, directed=False)(join(chain(bar), chain(stem)))
    assert len(lines) == 3
    np.testing.assert_allclose(at(lines), [(203, 200)], atol=1e-6)
    assert len(GraphLinker(CELL)(join(chain(bar), chain(stem)))) == 2


def test_three_lines_from_one_point_share_it(chain: Chain, join: Chain) -> None:
    arms = [chain(path((200, 200), (200 + 100 * np.cos(a), 200 + 100 * np.sin(a)))) for a in (0.3, 2.4, 4.5)]
    lines = GraphLinker(CELL, directed=False)(join(*arms))
    assert len(lines) == 3
    starts, stops = ends(lines)
    assert max((starts + stops).values()) == 3
    np.testing.assert_allclose(at(lines), [(200, 200)], atol=1.0)


def test_a_short_piece_between_two_junctions_stays_and_a_spur_goes(chain: Chain, join: Chain) -> None:
    lower, upper = path((40, 100), (300, 100)), path((40, 124), (300, 124))
    change = chain(path((150, 100), (176, 124), spacing=9.0))
    spur = chain(path((230, 100), (243, 92), spacing=9.0))
    lines = GraphLinker(CELL, min_length_cells=4.0)(join(chain(lower), chain(upper), change, spur))
    assert joints(lines) == [(1, 2), (2, 1)]
    assert len(lines) == 5
    assert lines.vertices[:, 1].min() > 98
    assert lines.lengths.min() < 4 * CELL


def labelled(points: np.ndarray, labels: list[int], chain: Chain) -> Segments:
    return Segments(chain(points).endpoints, labels=labels)


def test_a_line_is_cut_where_its_class_changes(chain: Chain) -> None:
    points = [(40.0 + 16 * i, 100.0) for i in range(21)]
    lines = GraphLinker(CELL)(labelled(points, [3] * 8 + [5] * 12, chain))
    assert len(lines) == 2
    assert joints(lines) == [(1, 1)]
    np.testing.assert_allclose(at(lines), [(40 + 16 * 8, 100)], atol=1e-9)
    assert lines.labels[np.argsort(lines.vertices[lines.offsets[:-1], 0])].tolist() == [3, 5]
    assert lines.probabilities is None
    assert len(GraphLinker(CELL, split_classes=False)(labelled(points, [3] * 8 + [5] * 12, chain))) == 1


@pytest.mark.parametrize("wrong", [[9], [0], [19], [5, 12], [9, 10], [3, 9, 15]])
def test_single_segments_of_another_class_cut_nothing(chain: Chain, wrong: list[int]) -> None:
    points = [(40.0 + 16 * i, 100.0) for i in range(21)]
    labels = [1 if i in wrong else 0 for i in range(20)]
    lines = GraphLinker(CELL)(labelled(points, labels, chain))
    assert lines.labels.tolist() == [0]


def test_a_change_of_class_near_a_junction_is_at_the_junction(chain: Chain, join: Chain) -> None:
    way, link = chain(TRUNK, label=1), chain(LEFT, label=0)
    labels = way.labels.copy()
    labels[-1] = 0  # one segment too early
    other = chain(RIGHT, label=0)
    lines = GraphLinker(CELL)(join(Segments(way.endpoints, labels=labels), link, other))
    assert (len(lines), joints(lines)) == (3, [(1, 2)])
    assert sorted(lines.labels.tolist()) == [0, 0, 1]


def test_scores_and_class_shares_are_means_by_length(chain: Chain) -> None:
    endpoints = chain([(40.0, 100.0), (56.0, 100.0), (88.0, 100.0), (104.0, 100.0)]).endpoints
    shares = np.array([[0.9, 0.1], [0.6, 0.4], [0.2, 0.8]])
    (line,) = [GraphLinker(CELL)(Segments(endpoints, [0.5, 1.0, 0.25], probabilities=shares))]
    assert line.scores == pytest.approx([(16 * 0.5 + 32 * 1.0 + 16 * 0.25) / 64])
    weights = np.array([16 * 0.5, 32 * 1.0, 16 * 0.25])
    assert line.probabilities is not None
    np.testing.assert_allclose(line.probabilities, [weights @ shares / weights.sum()])
    assert line.labels.tolist() == [0]


def test_gaps_count_as_zero_in_the_score(chain: Chain, join: Chain) -> None:
    a, b = chain(path((40, 100), (104, 100), spacing=16.0), 0.8), chain(path((128, 100), (192, 100)), 0.4)
    lines = GraphLinker(CELL)(join(a, b))
    assert lines.scores == pytest.approx([(64 * 0.8 + 64 * 0.4) / 152])


def test_a_repeated_line_is_dropped_but_one_that_leaves_is_not(chain: Chain, join: Chain) -> None:
    line, beside = path((40, 100), (300, 100)), path((40, 104), (300, 104))
    lines = GraphLinker(CELL)(join(chain(line, 0.9), chain(beside, 0.8)))
    assert lines.scores == pytest.approx([0.9])
    assert len(GraphLinker(CELL, duplicate_radius_cells=0.0)(join(chain(line), chain(beside)))) == 2
    leaving = path((40, 104), (220, 104), (300, 170))
    assert len(GraphLinker(CELL)(join(chain(line, 0.9), chain(leaving, 0.8)))) >= 2


def test_without_smoothing_the_vertices_are_those_that_were_cut(chain: Chain) -> None:
    points = np.random.default_rng(3).normal(0, 2, (15, 2)) + path((40, 100), (240, 100), spacing=15.0)
    (line,) = GraphLinker(CELL, smoothing=0.0)(chain(points))
    np.testing.assert_allclose(line, points, atol=1e-9)


def test_smoothing_keeps_ends_and_junctions_and_straight_lines(chain: Chain, join: Chain) -> None:
    rng = np.random.default_rng(5)
    rough = join(*(chain(part + rng.normal(0, 0.7, part.shape)) for part in (TRUNK, LEFT, RIGHT)))
    raw, smooth = (GraphLinker(CELL, smoothing=s)(rough) for s in (0.0, 0.2))
    keys = [sorted({line[k].tobytes() for line in lines for k in (0, -1)}) for lines in (raw, smooth)]
    assert keys[0] == keys[1]
    (straight,) = GraphLinker(CELL)(chain(path((40, 80), (340, 200))))
    assert distance_to_segments(straight, np.array([[(40.0, 80.0), (340.0, 200.0)]])).max() < 1e-6


def scene(chain: Chain, join: Chain, seed: int = 2) -> Segments:
    """Gives a fork, a crossing, a ring and a two-way line with noise, so that there are no ties."""
    shapes = [
        TRUNK,
        LEFT,
        RIGHT,
        path((60, 250), (340, 230)),
        arc((420, 150), 60, 0, 2 * np.pi, 31),
        path((520, 40), (540, 300)),
        path((540, 300), (520, 40)),
    ]
    parts = join(*(chain(shape, label=k % 2) for k, shape in enumerate(shapes)))
    rng = np.random.default_rng(seed)
    noise = rng.normal(0, 0.5, parts.endpoints.shape)
    scores = rng.uniform(0.5, 1, len(parts))
    return Segments(parts.endpoints + noise, scores, parts.labels)


def as_sets(lines: Polylines) -> list[tuple[float, ...]]:
    """Gives ends, length, score and label of each polyline, sorted."""
    return sorted(
        (*np.round([*line[0], *line[-1], length], 3).tolist(), round(float(score), 6), int(label))
        for line, length, score, label in zip(lines, lines.lengths, lines.scores, lines.labels, strict=True)
    )


@pytest.mark.parametrize("directed", [True, False])
@pytest.mark.parametrize("degrees", [90, 180, 270])
@pytest.mark.parametrize("shift", [(0.0, 0.0), (13.0, -7.5)])
def test_a_turned_and_moved_scene_gives_turned_and_moved_lines(
    chain: Chain, join: Chain, directed: bool, degrees: int, shift: tuple[float, float]
) -> None:
    segments = scene(chain, join)
    linker = GraphLinker(CELL, directed=directed)
    lines = linker(segments)
    moved = linker(segments.with_endpoints(rotated(segments.endpoints, degrees) + shift))
    expected = lines.with_vertices(rotated(lines.vertices, degrees) + shift)
    if directed:
        np.testing.assert_allclose(as_sets(moved), as_sets(expected), atol=2e-2)
    assert len(moved) == len(lines)
    np.testing.assert_allclose(sorted(moved.lengths), sorted(expected.lengths), atol=0.2)


def test_an_undirected_scene_does_not_know_which_way_segments_point(chain: Chain, join: Chain) -> None:
    segments = scene(chain, join)
    flip = np.random.default_rng(1).random(len(segments)) < 0.5
    endpoints = np.where(flip[:, None, None], segments.endpoints[:, ::-1], segments.endpoints)
    linker = GraphLinker(CELL, directed=False)
    a, b = linker(segments), linker(segments.with_endpoints(endpoints))
    assert len(a) == len(b)
    np.testing.assert_allclose(sorted(a.lengths), sorted(b.lengths), atol=0.2)


finite = st.floats(-200, 400, width=32)


@settings(deadline=None, max_examples=60)
@given(
    endpoints=st.integers(1, 40).flatmap(lambda n: arrays(np.float64, (n, 2, 2), elements=finite)),
    seed=st.integers(0, 1000),
    directed=st.booleans(),
    smoothing=st.sampled_from([0.0, 0.05]),
)
def test_any_segments_give_finite_lines_with_known_labels(
    endpoints: np.ndarray, seed: int, directed: bool, smoothing: float
) -> None:
    rng = np.random.default_rng(seed)
    labels = rng.integers(3, 6, len(endpoints))
    segments = Segments(endpoints, rng.uniform(0, 1, len(endpoints)), labels)
    linker = GraphLinker(CELL, directed=directed, smoothing=smoothing, min_length_cells=0.0)
    lines = linker(segments)
    assert np.isfinite(lines.vertices).all()
    assert (np.diff(lines.offsets) >= 2).all()
    assert (lines.lengths > 0).all()
    assert set(lines.labels.tolist()) <= set(labels.tolist())
    assert ((lines.scores >= 0) & (lines.scores <= 1)).all()


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 10**6), n=st.integers(2, 60), directed=st.booleans())
def test_crowded_short_segments_give_finite_lines_in_any_order(seed: int, n: int, directed: bool) -> None:
    rng = np.random.default_rng(seed)
    middles, angles = rng.uniform(0, 64, (n, 2)), rng.uniform(-np.pi, np.pi, n)
    way = np.stack([np.cos(angles), np.sin(angles)], axis=1) * rng.uniform(2, 9, (n, 1))
    shares = rng.dirichlet(np.ones(3), n)
    segments = Segments(np.stack([middles - way, middles + way], axis=1), rng.random(n), probabilities=shares)
    linker = GraphLinker(CELL, directed=directed, min_length_cells=1.0, min_class_cells=1.0)
    lines = linker(segments)
    again = linker(segments[rng.permutation(n)])
    np.testing.assert_array_equal(lines.vertices, again.vertices)
    np.testing.assert_array_equal(lines.scores, again.scores)
    assert np.isfinite(lines.vertices).all()
    assert lines.probabilities is not None
    np.testing.assert_allclose(lines.probabilities.sum(axis=1), 1)
    np.testing.assert_array_equal(lines.labels, lines.probabilities.argmax(axis=1))


def test_no_segments_keep_their_classes() -> None:
    empty = Segments(np.zeros((0, 2, 2)), probabilities=np.zeros((0, 4)))
    lines = GraphLinker(CELL)(empty)
    assert len(lines) == 0
    assert lines.probabilities is not None
    assert lines.probabilities.shape == (0, 4)


@pytest.mark.parametrize(
    "arguments",
    [
        {"link_radius_cells": 0.0},
        {"max_gap_cells": -1.0},
        {"duplicate_radius_cells": np.inf},
        {"max_turn": 3.5},
        {"max_branch_turn": 0.0},
        {"min_class_cells": 0.0},
        {"min_length_cells": np.nan},
    ],
)
def test_bad_parameters_are_named(arguments: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=f"{next(iter(arguments))} is .* is needed"):
        GraphLinker(CELL, **arguments)
