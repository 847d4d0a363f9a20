"""What becomes a node, what an edge: shapes by hand, a literal twin, and what must not matter."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.metrics.graph import Graph, build_graph
from yolino.metrics.joints import near_pieces
from yolino.types import Polylines, Segments

SIZE = (200, 320)
# 40 px apart: no point of the lattice lies within 4 px of a line between others without lying on it.
lattice = st.tuples(st.integers(0, 8), st.integers(0, 5)).map(lambda p: (40 * p[0], 40 * p[1]))
lattice_lines = st.lists(st.lists(lattice, min_size=2, max_size=5), max_size=6)


def graph_of(*lines: list, directed: bool = False, snap: float = 1.0, ignore: tuple = ()) -> Graph:
    return build_graph(Polylines.from_list(lines), SIZE, ignore, snap=snap, directed=directed)


def summary(graph: Graph) -> tuple[list, list]:
    """The nodes, and the lengths of the edges with their nodes (without directions in any order)."""
    nodes = np.round(graph.nodes, 6) + 0.0
    ends = [[tuple(nodes[i]) for i in pair] for pair in graph.edges]
    ends = ends if graph.directed else [sorted(pair) for pair in ends]
    edges = sorted((*pair, round(length, 6)) for pair, length in zip(ends, graph.lengths, strict=True))
    return sorted(map(tuple, nodes)), edges


# ---- the literal twin: everything in loops and dictionaries


def _touches(point: tuple, start: tuple, end: tuple) -> bool:
    step = np.subtract(end, start)
    t = np.dot(np.subtract(point, start), step) / np.dot(step, step)
    return 0 < t < 1 and math.dist(point, np.add(start, t * step)) <= 1


def _lies_on(point: tuple, start: tuple, end: tuple, edges: set) -> bool:
    """Whether a line goes on from the point along the way from start to end, or the reverse way."""
    step = np.subtract(end, start)
    ways = [np.subtract(b, a) for a, b in edges if point in (a, b)]
    return any(step[0] * way[1] == step[1] * way[0] for way in ways)


def _is_passed(point: tuple, edges: set, directed: bool) -> bool:
    after = {b for a, b in edges if a == point}
    before = {a for a, b in edges if b == point}
    if directed:
        return len(after) == len(before) == 1 and after != before
    return len(after | before) == 2


def twin(lines: list, directed: bool) -> tuple[set, set]:
    """All edges between vertices after splitting, and the vertices that are not just passed."""
    edges = {(a, b) for line in lines for a, b in itertools.pairwise(line) if a != b}
    ends = {p for edge in edges for p in edge if not _is_passed(p, edges, directed)}
    split = set()
    for a, b in edges:
        onto = {p for edge in edges for p in edge if _lies_on(p, a, b, edges)}
        stops = [a, *sorted((p for p in ends | onto if _touches(p, a, b)), key=lambda p: math.dist(p, a)), b]
        split |= set(itertools.pairwise(stops))
    return split, {p for edge in split for p in edge if not _is_passed(p, split, directed)}


def floyd_warshall(edges: set, directed: bool) -> dict:
    points = sorted({p for edge in edges for p in edge})
    ways = {(a, b): 0.0 if a == b else math.inf for a in points for b in points}
    for a, b in edges:
        ways[a, b] = min(ways[a, b], math.dist(a, b))
        if not directed:
            ways[b, a] = min(ways[b, a], math.dist(a, b))
    for k, a, b in itertools.product(points, points, points):
        ways[a, b] = min(ways[a, b], ways[a, k] + ways[k, b])
    return ways


@settings(deadline=None, max_examples=35)
@given(lattice_lines, st.booleans())
def test_nodes_and_ways_equal_the_literal_twin(lines: list, directed: bool) -> None:
    graph = graph_of(*lines, directed=directed)
    edges, stops = twin(lines, directed)
    nodes = [tuple(node) for node in graph.nodes]
    assert stops <= set(nodes)
    rings = graph.edges[graph.edges[:, 0] == graph.edges[:, 1]]
    assert all(i in rings for i, node in enumerate(nodes) if node not in stops)
    drawn = edges if directed else {tuple(sorted(edge)) for edge in edges}
    assert graph.lengths.sum() == pytest.approx(sum(math.dist(a, b) for a, b in drawn))
    ways = floyd_warshall(edges, directed)
    expected = np.array([ways[a, b] for a in nodes for b in nodes]).reshape(len(nodes), len(nodes))
    np.testing.assert_allclose(graph.distances(np.arange(len(nodes))), expected)


# ---- shapes by hand


def test_a_line_is_two_nodes_and_one_edge_with_its_course() -> None:
    graph = graph_of([[30, 10], [30, 50], [60, 90]], directed=True)
    np.testing.assert_allclose(graph.nodes, [[30, 10], [60, 90]])
    assert graph.edges.tolist() == [[0, 1]]
    np.testing.assert_allclose(graph.lengths, [90])
    np.testing.assert_allclose(graph.curves.vertices, [[30, 10], [30, 50], [60, 90]])


def test_lines_that_share_an_end_branch() -> None:
    graph = graph_of(
        [[100, 190], [100, 100]], [[100, 100], [40, 100]], [[100, 100], [160, 100]], directed=True
    )
    np.testing.assert_allclose(graph.nodes, [[40, 100], [100, 100], [100, 190], [160, 100]])
    assert sorted(map(tuple, graph.edges.tolist())) == [(1, 0), (1, 3), (2, 1)]
    assert sorted(graph.lengths) == [60, 60, 90]


def test_lines_that_continue_each_other_are_one_edge() -> None:
    graph = graph_of([[10, 10], [50, 10]], [[50, 10], [50, 40]], directed=True)
    assert (len(graph.nodes), graph.lengths.tolist()) == (2, [70])
    meeting = graph_of([[10, 10], [50, 10]], [[50, 40], [50, 10]], directed=True)
    assert len(meeting.edges) == 2
    assert len(graph_of([[10, 10], [50, 10]], [[50, 40], [50, 10]]).edges) == 1


@pytest.mark.parametrize(("gap", "joined"), [(0.0, True), (0.9, True), (1.0, True), (1.1, False)])
def test_an_end_near_a_line_is_a_t_junction(gap: float, joined: bool) -> None:
    graph = graph_of([[10, 100], [110, 100]], [[50, 20], [50, 100 - gap]])
    assert len(graph.edges) == (3 if joined else 2)
    if joined:
        assert sorted(np.round(graph.lengths)) == [40, 60, 80]
        assert graph.distances(np.array([0])).max() < 140.01


@pytest.mark.parametrize(("gap", "joined"), [(0.0, True), (0.5, True), (1.0, True), (1.5, False)])
def test_ends_near_each_other_are_joined(gap: float, joined: bool) -> None:
    graph = graph_of([[10, 100], [50, 100]], [[50 + gap, 100], [90, 100]], directed=True)
    assert len(graph.edges) == (1 if joined else 2)
    assert len(graph_of([[10, 100], [50, 100]], [[60, 100], [90, 100]], snap=10.0).edges) == 1


def test_crossing_lines_stay_apart_unless_they_share_a_vertex() -> None:
    assert len(graph_of([[10, 50], [90, 50]], [[50, 10], [50, 90]]).edges) == 2
    shared = graph_of([[10, 50], [50, 50], [90, 50]], [[50, 10], [50, 50], [50, 90]])
    assert (len(shared.nodes), len(shared.edges)) == (5, 4)
    near = graph_of([[10, 50], [50, 50], [90, 50]], [[50.5, 10], [50.5, 50], [50.5, 90]])
    assert len(near.edges) == 2


def test_a_line_whose_ends_meet_is_a_ring_with_its_leftmost_vertex_as_node() -> None:
    for end in ([60, 20], [60, 20.9]):
        ring = graph_of([[60, 20], [90, 50], [60, 80], [30, 50], end])
        assert ring.edges.tolist() == [[0, 0]]
    np.testing.assert_allclose(graph_of([[60, 20], [90, 50], [30, 50], [60, 20]]).nodes, [[30, 50]])
    open_ring = graph_of([[60, 20], [90, 50], [60, 80], [30, 50], [58, 20]])
    assert len(open_ring.nodes) == 2


def test_the_node_of_a_ring_is_no_end() -> None:
    ring = [[60, 20], [90, 50], [60, 80], [30.5, 50], [60, 20]]
    assert len(graph_of(ring, [[30, 0], [30, 100]]).edges) == 2


def test_an_end_can_touch_its_own_line() -> None:
    six = graph_of([[50, 10], [50, 150], [100, 150], [100, 100], [50.5, 100]])
    assert (len(six.nodes), len(six.edges)) == (2, 2)
    assert sorted(np.round(six.lengths)) == [90, 200]


def test_the_same_line_twice_is_one_unless_it_goes_both_ways() -> None:
    there, back = [[10, 10], [50, 10]], [[50, 10], [10, 10]]
    assert len(graph_of(there, there, directed=True).edges) == 1
    assert len(graph_of(there, back, directed=True).edges) == 2
    assert len(graph_of(there, back).edges) == 1


def test_lines_that_lie_on_each_other_are_one_until_they_part() -> None:
    straight, leaving = [[10, 50], [170, 50]], [[10, 50], [50, 50], [90, 50], [130, 90]]
    for directed in (True, False):
        graph = graph_of(straight, leaving, directed=directed)
        np.testing.assert_allclose(graph.nodes, [[10, 50], [90, 50], [130, 90], [170, 50]])
        assert sorted(graph.lengths.round(3).tolist()) == [56.569, 80, 80]
    # A vertex on a line is no fork where the line is only crossed.
    assert len(graph_of(straight, [[90, 10], [90, 50], [90, 90]]).edges) == 2


def test_a_line_with_dense_vertices_does_not_collapse() -> None:
    dense = [[10 + 0.25 * i, 20] for i in range(161)]
    for graph in (graph_of(dense), build_graph(Segments(Polylines.from_list([dense]).endpoints), SIZE)):
        np.testing.assert_allclose(graph.nodes, [[10, 20], [50, 20]], atol=1e-9)
        np.testing.assert_allclose(graph.lengths, [40])


def test_a_short_line_keeps_its_ends_apart() -> None:
    assert graph_of([[10, 20], [10.5, 20]]).lengths.tolist() == [0.5]


def test_a_directed_way_does_not_go_back() -> None:
    graph = graph_of([[10, 10], [50, 10]], [[50, 10], [90, 10]], [[50, 10], [50, 60]], directed=True)
    start, end = (int(np.flatnonzero((graph.nodes == p).all(axis=1))[0]) for p in ([10, 10], [90, 10]))
    assert graph.distances(np.array([start]))[0, end] == 80
    assert graph.distances(np.array([end]))[0, start] == math.inf
    assert graph.distances(np.array([end]), backwards=True)[0, start] == 80
    assert graph.distances(np.array([start]), limit=79.0)[0, end] == math.inf


def test_of_two_edges_between_the_same_nodes_the_shorter_is_the_way() -> None:
    direct, around = [[10, 50], [90, 50]], [[10, 50], [50, 90], [90, 50]]
    for directed in (True, False):
        graph = graph_of(direct, around, [[90, 50], [150, 50]], [[0, 50], [10, 50]], directed=directed)
        assert sorted(graph.lengths.round(3).tolist()) == [10, 60, 80, 113.137]
        assert graph.distances(np.array([0]))[0].tolist() == [0, 10, 90, 150]


def test_parts_outside_the_image_are_cut_off() -> None:
    graph = graph_of([[-50, 50], [50, 50]], [[300, -30], [300, 20], [400, 20]], [[-9, -9], [-5, -5]])
    np.testing.assert_allclose(graph.nodes, [[0, 50], [50, 50], [300, 0], [320, 20]])
    np.testing.assert_allclose(np.sort(graph.lengths), [40, 50])


def test_ignored_polygons_are_cut_out_exactly() -> None:
    box = np.array([[40.0, 0.0], [70.25, 0.0], [70.25, 100.0], [40.0, 100.0]])
    graph = graph_of([[10, 50], [55, 50], [110, 50]], [[50, 20], [60, 30]], ignore=(box,))
    np.testing.assert_allclose(graph.nodes, [[10, 50], [40, 50], [70.25, 50], [110, 50]])
    np.testing.assert_allclose(np.sort(graph.lengths), [30, 39.75])
    concave = np.array([[20, 0], [80, 0], [80, 99], [60, 99], [60, 40], [40, 40], [40, 99], [20, 99.0]])
    line = [[10, 50], [110, 50]]
    np.testing.assert_allclose(np.sort(graph_of(line, ignore=(concave,)).lengths), [10, 20, 30])
    shifted = concave + np.array([15, 0])
    np.testing.assert_allclose(np.sort(graph_of(line, ignore=(concave, shifted)).lengths), [5, 10, 15])


def test_a_line_through_a_corner_or_a_vertex_on_the_border_is_cut_once() -> None:
    diamond = np.array([[50, 20], [80, 50], [50, 80], [20, 50.0]])
    for line in ([[10, 50], [110, 50]], [[10, 50], [20, 50], [50, 50], [80, 50], [110, 50]]):
        graph = graph_of(line, ignore=(diamond,))
        np.testing.assert_allclose(np.sort(graph.lengths), [10, 30])
        assert len(graph.nodes) == 4


def test_a_branch_whose_trunk_is_ignored_ends_at_the_border() -> None:
    box = np.array([[90.0, 90], [110, 90], [110, 110], [90, 110]])
    y = ([[100, 190], [100, 100]], [[100, 100], [40, 100]], [[100, 100], [160, 100]])
    graph = graph_of(*y, ignore=(box,))
    assert (len(graph.nodes), sorted(graph.lengths)) == (6, [50, 50, 80])


# ---- what must not matter


@settings(deadline=None, max_examples=35)
@given(lattice_lines, st.randoms(use_true_random=False), st.booleans())
def test_order_and_cuts_do_not_matter(lines: list, random: object, directed: bool) -> None:
    expected = summary(graph_of(*lines, directed=directed))
    pieces = [list(pair) for line in lines for pair in itertools.pairwise(line)]
    random.shuffle(pieces)  # type: ignore[attr-defined]
    assert summary(graph_of(*pieces, directed=directed)) == expected
    segments = Segments(np.array(pieces, float).reshape(-1, 2, 2))
    assert summary(build_graph(segments, SIZE, directed=directed)) == expected
    back = [line[::-1] for line in lines]
    if directed:
        nodes, edges = summary(graph_of(*back, directed=True))
        assert nodes == expected[0]
        assert sorted((b, a, length) for a, b, length in edges) == expected[1]
    else:
        assert summary(graph_of(*back)) == expected


@settings(deadline=None, max_examples=20)
@given(lattice_lines, st.booleans())
def test_nodes_are_bitwise_the_same_for_any_order(lines: list, directed: bool) -> None:
    skewed = [np.array(line) @ np.array([[0.9, 0.1], [-0.05, 0.8]]) + [12.3, 4.5] for line in lines]
    one, other = (graph_of(*each, directed=directed) for each in (skewed, skewed[::-1]))
    np.testing.assert_array_equal(one.nodes, other.nodes)
    np.testing.assert_array_equal(one.edges, other.edges)
    np.testing.assert_array_equal(one.curves.vertices, other.curves.vertices)


def test_what_is_cut_out_and_what_is_left_add_up() -> None:
    rng = np.random.default_rng(2)
    frame = np.array([[-9.0, -9.0], [400.0, -9.0], [400.0, 300.0], [-9.0, 300.0], [-9.0, -9.0]])
    for _ in range(20):
        lines = [rng.uniform(0, 200, (4, 2)) for _ in range(5)]
        triangle = rng.uniform(0, 200, (3, 2))
        rest = np.concatenate([frame, triangle[[0, 1, 2, 0]], frame[:1]])  # even-odd: all but the triangle
        whole = graph_of(*lines).lengths.sum()
        parts = [graph_of(*lines, ignore=(polygon,)).lengths.sum() for polygon in (triangle, rest)]
        assert sum(parts) == pytest.approx(whole)


@settings(deadline=None, max_examples=40)
@given(st.lists(st.tuples(*[st.floats(0, 100)] * 4), max_size=6), st.floats(0.5, 60))
def test_near_pieces_equal_a_loop(rows: list, radius: float) -> None:
    pieces, points = np.array(rows).reshape(-1, 2, 2), np.array([[10.0, 20], [50, 50], [90, 10]])
    near = near_pieces(points, pieces, radius)
    found = {
        (int(p), int(k)): float(d) for p, k, d in zip(near.points, near.pieces, near.distances, strict=True)
    }
    for (i, point), (k, (start, end)) in itertools.product(enumerate(points), enumerate(pieces)):
        steps = start + np.linspace(0, 1, 2001)[:, None] * (end - start)
        distance = np.hypot(*(steps - point).T).min()
        if distance < radius - 0.1:
            assert found[i, k] == pytest.approx(distance, abs=0.1)
        elif distance > radius + 0.1:
            assert (i, k) not in found
    np.testing.assert_allclose(
        pieces[near.pieces, 0] + near.along[:, None] * (pieces[near.pieces, 1] - pieces[near.pieces, 0]),
        near.places,
        atol=1e-9,
    )


def test_nothing_gives_nothing() -> None:
    box = np.array([[0.0, 0], [9, 0], [9, 9], [0, 9]])
    for lines in (
        Polylines.from_list([]),
        Polylines.from_list([[[3, 3]], []]),
        Segments(np.zeros((0, 2, 2))),
    ):
        for directed in (True, False):
            graph = build_graph(lines, SIZE, [box], directed=directed)
            assert (len(graph.nodes), len(graph.edges), len(graph.curves)) == (0, 0, 0)
            assert graph.distances(np.zeros(0, np.int64)).shape == (0, 0)
    assert len(graph_of([[2, 2], [7, 7]], ignore=(box,)).edges) == 0
    assert len(graph_of([[5, 5], [5, 5]]).edges) == 0


def test_bad_arguments_are_named() -> None:
    line = [[10, 10], [50, 50]]
    for value in (np.nan, np.inf):
        with pytest.raises(ValueError, match="NaN or infinite"):
            graph_of([[value, 0], [5, 5]])
    with pytest.raises(ValueError, match="at least 3 finite corners"):
        graph_of(line, ignore=(np.zeros((2, 2)),))
    with pytest.raises(ValueError, match="size must be a positive"):
        build_graph(Polylines.from_list([line]), (0, 10))
    for snap in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(ValueError, match="snap must be a positive number of pixels"):
            graph_of(line, snap=snap)
