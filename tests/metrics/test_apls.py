"""APLS: values computed by hand, a literal twin, and what must not matter."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.metrics.apls import AplsMetric
from yolino.metrics.graph import Graph, build_graph
from yolino.types import Polylines, Segments

SIZE = (200, 320)
FAR = 1000.0
lattice = st.tuples(st.integers(0, 8), st.integers(0, 5)).map(lambda p: (40 * p[0], 40 * p[1]))
lattice_lines = st.lists(st.lists(lattice, min_size=2, max_size=4), max_size=5)

TRUNK, LEFT, RIGHT = [[100, 190], [100, 100]], [[100, 100], [40, 100]], [[100, 100], [160, 100]]


def row(prediction: list, truth: list, ignore: tuple = (), **settings: float | bool) -> list[float]:
    """Penalties and pairs of the ground truth's control points, then of the prediction's."""
    scales = {"radius": 4.0, "spacing": FAR, **settings}
    metric = AplsMetric(**scales)  # type: ignore[arg-type]
    metric.update(Polylines.from_list(prediction), Polylines.from_list(truth), SIZE, ignore)
    return [float(value) for value in metric.rows[0]]


def reverse(lines: list) -> list:
    return [line[::-1] for line in lines]


# ---- by hand


def test_a_gap_breaks_the_ways_across_it() -> None:
    truth, broken = [[[10, 50], [110, 50]]], [[[10, 50], [70, 50]], [[90, 50], [110, 50]]]
    # Control points of the ground truth: x = 10, 60, 110. 10 -> 60 is kept, 10 -> 110 and 60 -> 110 are not.
    # Of the prediction: 10, 40, 70 and 90, 110. All their ways, 3 and 1, are in the ground truth.
    assert row(broken, truth, spacing=50.0) == [2, 3, 0, 4]
    assert row(broken, truth, spacing=50.0, directed=False) == [4, 6, 0, 8]
    metric = AplsMetric(radius=4.0, spacing=50.0)
    metric.update(Polylines.from_list(broken), Polylines.from_list(truth), SIZE)
    expected = {"apls": 0.5, "apls_truth_to_prediction": 1 / 3, "apls_prediction_to_truth": 1}
    assert metric.compute() == pytest.approx(expected)


def test_a_missing_branch_of_a_y_junction() -> None:
    truth, missing = [TRUNK, LEFT, RIGHT], [TRUNK, LEFT]
    # Bottom, junction, left, right: 5 ways lead along the directions, 2 of them to the right: not there.
    # In the prediction there is one way, from the bottom to the left.
    assert row(missing, truth) == [2, 5, 0, 1]
    # Undirected there are 4 * 3 ways, 6 of them from or to the right.
    assert row(missing, truth, directed=False) == [6, 12, 0, 2]
    metric = AplsMetric(radius=4.0, spacing=FAR)
    metric.update(Polylines.from_list(missing), Polylines.from_list(truth), SIZE)
    assert metric.compute()["apls"] == pytest.approx(2 * 0.6 / 1.6)


def test_a_way_of_another_length_costs_its_part() -> None:
    # The end at 110 moves to 100: 90 px instead of 100. The reverse moves nothing.
    short = [[[10, 50], [100, 50]]]
    assert row(short, [[[10, 50], [110, 50]]], radius=10.0) == pytest.approx([0.1, 1, 0, 1])
    # A detour of 2 * 30 px; its corners are too far away for the ground truth to have them as control points.
    detour = [[[10, 50], [10, 80], [110, 80], [110, 50]]]
    assert row(detour, [[[10, 50], [110, 50]]], angle_radius=math.pi) == pytest.approx([0.6, 1, 0.375, 1])
    # No more than 1 per way.
    longer = [[[10, 50], [10, 120], [110, 120], [110, 50]]]
    assert row(longer, [[[10, 50], [110, 50]]], angle_radius=math.pi)[:2] == [1, 1]


def test_a_wrong_connection_costs_the_ways_through_it() -> None:
    truth = [[[10, 50], [110, 50]], [[110, 60], [210, 60]]]
    joined = [[[10, 50], [110, 50], [110, 60], [210, 60]]]
    # Ground truth: 3 control points on each line, 3 ways each, all kept. Prediction: the points (10, 50) and
    # (80, 50), (140, 60) and (210, 60), 6 ways, of which the 4 from one pair to the other are wrong.
    assert row(joined, truth, spacing=70.0) == [0, 6, 4, 6]


def test_a_point_behind_a_fork_still_leads_to_both_sides() -> None:
    # The predicted fork is 3 px earlier, so the true one moves to one of the arms.
    truth = [TRUNK, [[100, 100], [60, 40]], [[100, 100], [140, 40]]]
    found = [[[100, 190], [100, 103]], [[100, 103], [60, 40]], [[100, 103], [140, 40]]]
    for a, b in ((found, truth), (reverse(found), reverse(truth))):
        penalty, pairs, *_ = row(a, b)
        assert pairs == 5
        assert 0 < penalty < 0.5


def test_directions_count_unless_undirected() -> None:
    lines = [TRUNK, LEFT, RIGHT]
    assert row(reverse(lines), lines) == [5, 5, 5, 5]
    assert row(reverse(lines), lines, directed=False) == [0, 12, 0, 12]


def test_a_point_moves_to_a_line_of_its_direction() -> None:
    # Another line is nearer to the right end of the line, but crosses it.
    line, moved = [[10, 50], [110, 50]], [[10, 53], [110, 53]]
    crossing = [[108, 10], [108, 90]]
    assert row([moved, crossing], [line])[:2] == [0, 1]
    assert row([moved, crossing], [line], angle_radius=math.pi)[:2] == [1, 1]
    # The opposite lane is nearer.
    opposite = [[110, 49], [10, 49]]
    assert row([moved, opposite], [line])[:2] == [0, 1]


def test_the_radius_is_inclusive() -> None:
    line = [[10, 50], [110, 50]]
    for shift, penalty in ((4.0, 0), (4.01, 1)):
        assert row([[[x, y + shift] for x, y in line]], [line])[0] == penalty


def test_a_ring_has_ways() -> None:
    ring = [[[60, 20], [100, 60], [60, 100], [20, 60], [60, 20]]]
    assert row(ring, ring) == [0, 2, 0, 2]
    assert row([], ring) == [2, 2, 0, 0]
    assert row(reverse(ring), ring)[:2] == [2, 2]


def test_what_is_ignored_counts_on_neither_side() -> None:
    box = np.array([[0.0, 120.0], [320.0, 120.0], [320.0, 200.0], [0.0, 200.0]])
    line, other = [[10, 50], [110, 50]], [[10, 150], [110, 150]]
    assert row([line, other], [line]) == [0, 1, 1, 2]
    assert row([line, other], [line], (box,)) == [0, 1, 0, 1]
    assert row([line], [line, other], (box,)) == [0, 1, 0, 1]


def test_empty_sides_have_defined_scores() -> None:
    nothing, something = Polylines.from_list([]), Polylines.from_list([TRUNK])
    for prediction, truth, score in ((nothing, nothing, 1), (nothing, something, 0), (something, nothing, 0)):
        for directed in (True, False):
            metric = AplsMetric(directed=directed)
            metric.update(prediction, truth, SIZE)
            assert set(metric.compute().values()) == {score}


def test_images_are_averaged_by_their_ways() -> None:
    metric = AplsMetric(radius=4.0, spacing=FAR)
    y, line = Polylines.from_list([TRUNK, LEFT, RIGHT]), Polylines.from_list([[[10, 50], [110, 50]]])
    metric.update(y, y, SIZE)  # 5 ways, all right on both sides
    metric.update(Polylines.from_list([]), line, SIZE)  # 1 way, lost
    assert metric.compute()["apls_truth_to_prediction"] == pytest.approx(5 / 6)
    assert metric.compute()["apls_prediction_to_truth"] == 1
    assert metric.compute()["apls"] == pytest.approx(2 * 5 / 6 / (1 + 5 / 6))


def test_the_defaults_follow_the_width_of_the_image() -> None:
    rng = np.random.default_rng(1)
    truth = Polylines.from_list(rng.uniform(0, 200, (4, 2)) for _ in range(5))
    prediction = truth.with_vertices(truth.vertices + rng.normal(0, 4, truth.vertices.shape))
    rows = []
    for scales in ({}, {"radius": 6.4, "spacing": 32.0}):
        metric = AplsMetric(**scales)
        metric.update(prediction, truth, SIZE)
        rows.append(metric.rows[0].tolist())
    assert rows[0] == rows[1]


# ---- the literal twin: control points become nodes of both graphs, all ways by Floyd and Warshall


def _at(curve: np.ndarray, arc: float) -> tuple[np.ndarray, np.ndarray]:
    """Place and direction after some length of a curve."""
    for start, end in itertools.pairwise(curve):
        length = math.dist(start, end)
        if arc <= length:
            return start + (end - start) * arc / length, (end - start) / length
        arc -= length
    return curve[-1], (curve[-1] - curve[-2]) / math.dist(curve[-1], curve[-2])


def _control(graph: Graph, spacing: float) -> list[tuple[tuple, np.ndarray, list]]:
    """Where each control point is - node or edge and length -, its place, and the directions there."""
    found = []
    for node, place in enumerate(graph.nodes):
        ends = [
            _at(curve, 0.0)[1] for curve, (a, _) in zip(graph.curves, graph.edges, strict=True) if a == node
        ]
        ends += [
            _at(curve, FAR)[1] for curve, (_, b) in zip(graph.curves, graph.edges, strict=True) if b == node
        ]
        found.append((("node", node), place, ends))
    for edge, curve in enumerate(graph.curves):
        parts = max(1, math.ceil(graph.lengths[edge] / spacing))
        for k in range(1, parts):
            place, tangent = _at(curve, graph.lengths[edge] * k / parts)
            found.append((("edge", edge, graph.lengths[edge] * k / parts), place, [tangent]))
    return found


def _named(graph: Graph, edge: int, arc: float) -> tuple:
    """The place as a node, if it is one."""
    if min(arc, graph.lengths[edge] - arc) < 1e-9:
        return ("node", int(graph.edges[edge, 0 if arc < 1e-9 else 1]))
    return ("edge", edge, arc)


def _moved(
    graph: Graph, place: np.ndarray, tangents: list, radius: float, angle_radius: float
) -> tuple | None:
    """The nearest place, then the one of the most similar direction, searched piece by piece."""
    best: tuple = (radius, 2.0, None)
    for edge, curve in enumerate(graph.curves):
        arc = 0.0
        for start, end in itertools.pairwise(curve):
            step, length = end - start, math.dist(start, end)
            cosines = [np.dot(step, tangent) / length for tangent in tangents]
            cosine = max(cosines if graph.directed else map(abs, cosines))
            t = min(max(np.dot(place - start, step) / length**2, 0.0), 1.0)
            distance = math.dist(place, start + t * step)
            if math.acos(max(min(cosine, 1.0), -1.0)) <= angle_radius:
                here = (round(distance, 6), -round(cosine, 6), _named(graph, edge, arc + t * length))
                best = min(best, here, key=lambda found: found[:2])
            arc += length
    return best[2]


def _all_ways(graph: Graph, stops: set) -> dict:
    points = [("node", i) for i in range(len(graph.nodes))] + sorted(stops)
    ways = {(p, q): 0.0 if p == q else math.inf for p in points for q in points}
    for edge, (a, b) in enumerate(graph.edges.tolist()):
        course = [(0.0, ("node", a)), *sorted((s[2], s) for s in stops if s[1] == edge)]
        course += [(graph.lengths[edge], ("node", b))]
        for (s, p), (t, q) in itertools.pairwise(course):
            ways[p, q] = min(ways[p, q], t - s)
            if not graph.directed:
                ways[q, p] = min(ways[q, p], t - s)
    for k, p, q in itertools.product(points, points, points):
        ways[p, q] = min(ways[p, q], ways[p, k] + ways[k, q])
    return ways


def _way(graph: Graph, ways: dict, p: tuple, q: tuple, slack: float) -> float:
    """A way that may begin and end against the direction of the edge it begins and ends in."""
    begins, ends = [(0.0, p)], [(0.0, q)]
    if graph.directed and p[0] == "edge" and p[2] <= slack:
        begins.append((p[2], ("node", int(graph.edges[p[1], 0]))))
    if graph.directed and q[0] == "edge" and graph.lengths[q[1]] - q[2] <= slack:
        ends.append((graph.lengths[q[1]] - q[2], ("node", int(graph.edges[q[1], 1]))))
    found = [s + ways[b, e] + t for (s, b), (t, e) in itertools.product(begins, ends)]
    if p[0] == q[0] == "edge" and p[1] == q[1] and 0 < p[2] - q[2] <= slack:
        found.append(p[2] - q[2])
    return min(found)


def twin(graph: Graph, other: Graph, radius: float, spacing: float, angle_radius: float) -> list[float]:
    control = _control(graph, spacing)
    moved = [_moved(other, place, tangents, radius, angle_radius) for _, place, tangents in control]
    own = _all_ways(graph, {where for where, _, _ in control if where[0] == "edge"})
    others = _all_ways(other, {where for where in moved if where and where[0] == "edge"})
    penalty = pairs = 0.0
    for (i, (a, _, _)), (j, (b, _, _)) in itertools.permutations(enumerate(control), 2):
        way = _way(graph, own, a, b, radius)
        if way < math.inf:
            known = moved[i] is not None and moved[j] is not None
            found = _way(other, others, moved[i], moved[j], radius) if known else math.inf
            penalty += min(1.0, abs(way - found) / way)
            pairs += 1
    return [penalty, pairs]


@pytest.mark.parametrize("directed", [True, False])
@pytest.mark.parametrize("angle_radius", [math.pi / 4, math.pi])
def test_rows_equal_the_literal_twin(directed: bool, angle_radius: float) -> None:
    rng = np.random.default_rng(8)
    for _ in range(6):
        places = rng.uniform([0, 0], [320, 200], (6, 2))
        truth = [places[rng.choice(6, 3, replace=False)] for _ in range(3)]
        prediction = [line + rng.normal(0, 5, line.shape) for line in [*truth[1:], places[:2]]]
        found, wanted = (
            build_graph(Polylines.from_list(side), SIZE, directed=directed) for side in (prediction, truth)
        )
        expected = twin(wanted, found, 12.0, 90.0, angle_radius) + twin(
            found, wanted, 12.0, 90.0, angle_radius
        )
        actual = row(
            prediction, truth, radius=12.0, spacing=90.0, angle_radius=angle_radius, directed=directed
        )
        assert actual == pytest.approx(expected)
        assert actual[1] > 5


# ---- what must not matter


def score(prediction: list, truth: list, **settings: bool) -> dict[str, float]:
    metric = AplsMetric(radius=15.0, **settings)
    metric.update(Polylines.from_list(prediction), Polylines.from_list(truth), SIZE)
    return metric.compute()


@settings(deadline=None, max_examples=25)
@given(lattice_lines, lattice_lines, st.randoms(use_true_random=False), st.booleans())
def test_order_pieces_and_sides_do_not_matter(pred: list, gt: list, random: object, directed: bool) -> None:
    expected = score(pred, gt, directed=directed)
    assert all(0 <= value <= 1 for value in expected.values())
    exchanged = score(gt, pred, directed=directed)
    assert exchanged["apls_truth_to_prediction"] == expected["apls_prediction_to_truth"]
    assert exchanged["apls"] == pytest.approx(expected["apls"], rel=1e-9)
    if not directed:
        assert score(reverse(pred), gt, directed=False) == pytest.approx(expected, rel=1e-9)
    pieces = [list(pair) for line in pred for pair in itertools.pairwise(line)]
    random.shuffle(pieces)  # type: ignore[attr-defined]
    random.shuffle(gt)  # type: ignore[attr-defined]
    assert score(pieces, gt, directed=directed) == pytest.approx(expected, rel=1e-9)


@settings(deadline=None, max_examples=25)
@given(lattice_lines, st.booleans())
def test_a_prediction_equal_to_the_labels_is_perfect(lines: list, directed: bool) -> None:
    assert set(score(lines[::-1], lines, directed=directed).values()) == {1}


@settings(deadline=None, max_examples=12)
@given(lattice_lines, lattice_lines, st.integers(0, 60), st.booleans())
def test_a_shift_of_both_sides_does_not_matter(pred: list, gt: list, shift: int, directed: bool) -> None:
    rows = []
    for by in (0, shift):
        sides = [[np.array(line) + by for line in lines] for lines in (pred, gt)]
        metric = AplsMetric(radius=15.0, spacing=50.0, directed=directed)
        metric.update(*(Polylines.from_list(side) for side in sides), (300, 400))
        rows.append(metric.rows[0].tolist())
    assert rows[0] == pytest.approx(rows[1], rel=1e-9)


def test_segments_and_polylines_may_meet() -> None:
    truth = Polylines.from_list([[[10, 10], [90, 10], [90, 70]]])
    metric = AplsMetric()
    metric.update(Segments(truth.endpoints), truth, SIZE)
    assert metric.compute()["apls"] == 1


def test_many_points_are_worked_off_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    sides = [[rng.uniform(0, 200, (3, 2)) for _ in range(6)] for _ in range(2)]
    expected = score(*sides)
    monkeypatch.setattr("yolino.metrics.apls._ROWS", 2)
    assert score(*sides) == pytest.approx(expected)


# ---- bad input


@pytest.mark.parametrize("name", ["radius", "spacing", "snap"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_scales_must_be_positive(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"{name} must be a positive number of pixels"):
        AplsMetric(**{name: value})  # type: ignore[arg-type]


def test_other_bad_arguments_are_named() -> None:
    for angle in (0.0, 45.0, math.nan):
        with pytest.raises(ValueError, match="radians"):
            AplsMetric(angle_radius=angle)
    good, bad = Polylines.from_list([TRUNK]), Polylines.from_list([[[math.nan, 0], [5, 5]]])
    for sides in ((good, bad), (bad, good)):
        metric = AplsMetric()
        with pytest.raises(ValueError, match="NaN or infinite"):
            metric.update(*sides, SIZE)
        assert len(metric) == 0
    with pytest.raises(ValueError, match="first image"):
        AplsMetric().compute()
