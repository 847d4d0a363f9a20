"""TOPO: values computed by hand, a literal twin, and what must not matter."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.metrics.graph import Graph, build_graph
from yolino.metrics.topo import TopoMetric, _largest_matching
from yolino.types import Polylines, Segments

SIZE = (200, 320)
FAR = 1000.0
lattice = st.tuples(st.integers(0, 8), st.integers(0, 5)).map(lambda p: (40 * p[0], 40 * p[1]))
lattice_lines = st.lists(st.lists(lattice, min_size=2, max_size=4), max_size=5)

TRUNK, LEFT, RIGHT = [[100, 190], [100, 100]], [[100, 100], [40, 100]], [[100, 100], [160, 100]]


def metric_of(**settings: float | bool) -> TopoMetric:
    scales = {"radius": 4.0, "spacing": 10.0, "reach": FAR, "seed_spacing": FAR, **settings}
    return TopoMetric(**scales)  # type: ignore[arg-type]


def counts(prediction: list, truth: list, ignore: tuple = (), **settings: float | bool) -> list[float]:
    """Matched and all marbles around the seeds of the prediction, then the same of the ground truth."""
    metric = metric_of(**settings)
    metric.update(Polylines.from_list(prediction), Polylines.from_list(truth), SIZE, ignore)
    return [float(count) for count in metric.rows[0]]


def reverse(lines: list) -> list:
    return [line[::-1] for line in lines]


# ---- by hand


def test_a_gap_costs_all_that_lies_behind_it() -> None:
    # Ground truth: marbles at x = 15, 25, ..., 105; the middle ones, 55 and 65, are seeds. Each sees all 10.
    truth = [[[10, 50], [110, 50]]]
    # Prediction: marbles at 15, ..., 65 and at 95, 105; seeds at 35 and 45, and at 95 and 105.
    broken = [[[10, 50], [70, 50]], [[90, 50], [110, 50]]]
    # Recall: the 6 marbles before the gap, twice. Precision: 6 and 6, 2 and 2 of as many.
    assert counts(broken, truth) == [16, 16, 12, 20]
    metric = metric_of()
    metric.update(Polylines.from_list(broken), Polylines.from_list(truth), SIZE)
    assert metric.compute() == pytest.approx({"precision": 1, "recall": 0.6, "f1": 0.75})
    # Within 20 px: 55 sees 35, ..., 75, and 35, ..., 65 of them are there; 65 sees 45, ..., 85: 45, 55, 65.
    assert counts(broken, truth, reach=20.0)[2:] == [7, 10]


def test_a_missing_branch_of_a_y_junction() -> None:
    # Marbles every 30 px: 3 on the trunk, 2 on each arm. Seeds: the middle one of the trunk, both of an arm.
    truth, missing = [TRUNK, LEFT, RIGHT], [TRUNK, LEFT]
    # Directed: the trunk's seed sees all 7, those of an arm see the arm and the trunk, 5. The seeds on the
    # right arm have no partner. The prediction is one line of 5 marbles at the same places; its seed sees 5.
    assert counts(missing, truth, spacing=30.0) == [5, 5, 5 + 2 * 5, 7 + 2 * 5 + 2 * 5]
    assert counts(truth, missing, spacing=30.0) == [5 + 2 * 5, 7 + 2 * 5 + 2 * 5, 5, 5]
    # Undirected, each of the 5 seeds sees all 7.
    assert counts(missing, truth, spacing=30.0, directed=False) == [5, 5, 3 * 5, 5 * 7]


def test_a_branch_that_is_not_connected_is_missing_from_the_trunk() -> None:
    # 20 px of the right arm are missing: of its marbles at x = 115 and 145 the prediction has one, at 140.
    apart = [TRUNK, LEFT, [[120, 100], [160, 100]]]
    found = counts(apart, [TRUNK, LEFT, RIGHT], spacing=30.0, radius=6.0)
    # Recall: trunk 5 of 7, left 2 * 5 of 2 * 5; right: 115 has no partner, 145 has one that sees 1 of 5.
    # Precision: 5 of 5, and the seed at 140 sees itself.
    assert found == [5 + 1, 5 + 1, 5 + 2 * 5 + 1, 7 + 2 * 5 + 2 * 5]


def test_a_wrong_connection_costs_precision() -> None:
    parallel = [[[10, 50], [110, 50]], [[10, 90], [110, 90]]]
    joined = [*parallel, [[110, 50], [110, 90]]]
    # The prediction is one line of 24 marbles; its seeds are the middle ones, on the joint, without partner.
    # With all marbles as seeds: the 4 of the joint have none, 20 see 24 marbles, of which 10 have a hole.
    assert counts(joined, parallel, directed=False) == [0, 2 * 24, 4 * 10, 4 * 10]
    assert counts(joined, parallel, directed=False, seed_spacing=10.0) == [20 * 10, 24 * 24, 20 * 10, 20 * 10]


def test_spurious_lines_cost_precision_and_missing_ones_recall() -> None:
    line, other = [[10, 50], [110, 50]], [[10, 150], [110, 150]]
    assert counts([line, other], [line]) == [20, 40, 20, 20]
    assert counts([line], [line, other]) == [20, 20, 20, 40]


def test_marbles_are_matched_one_to_one() -> None:
    # Beside the line there is another, 3 px away and joined to it: its marbles find no hole of their own.
    line = [[10, 50], [110, 50]]
    double = [line, [[10, 50], [10.0, 53], [110, 53]]]
    found = counts(double, [line], directed=False, seed_spacing=10.0)
    assert found[0] < 0.6 * found[1]
    assert found[2:] == [100, 100]


def test_directions_count_unless_undirected() -> None:
    lines = [TRUNK, LEFT, RIGHT]
    metric = metric_of()
    metric.update(Polylines.from_list(reverse(lines)), Polylines.from_list(lines), SIZE)
    assert metric.compute() == {"precision": 0, "recall": 0, "f1": 0}
    assert counts(reverse(lines), lines, directed=False) == counts(lines, lines, directed=False)


def test_a_directed_seed_sees_where_it_leads_and_what_leads_to_it() -> None:
    # A fork: from an arm one does not come to the other arm. A merge: neither.
    assert counts(reverse([TRUNK, LEFT, RIGHT]), reverse([TRUNK, LEFT, RIGHT]), spacing=30.0)[3] == 27
    ring = [[[60, 20], [100, 60], [60, 100], [20, 60], [60, 20]]]
    found = counts(ring, ring, reach=100.0)
    assert found[0] == found[1] == found[2] == found[3] > 0


def test_angles_and_radii_are_inclusive() -> None:
    line = [[10.0, 50], [110, 50]]
    for shift, matched in ((4.0, 20), (4.01, 0)):
        assert counts([[[x, y + shift] for x, y in line]], [line])[0] == matched
    slope = [[10.0, 10.0], [80.0, 80.0]]
    crossing = [[10.0, 45.0], [80.0, 45.0]]
    assert counts([slope], [crossing], spacing=FAR, angle_radius=math.pi / 4)[0] == 1
    assert counts([slope], [crossing], spacing=FAR, angle_radius=0.78)[0] == 0


def test_what_is_ignored_counts_on_neither_side() -> None:
    box = np.array([[0.0, 120.0], [320.0, 120.0], [320.0, 200.0], [0.0, 200.0]])
    line, other = [[10, 50], [110, 50]], [[10, 150], [110, 150]]
    assert counts([line, other], [line], (box,)) == [20, 20, 20, 20]
    assert counts([line], [line, other], (box,)) == [20, 20, 20, 20]
    assert counts([other], [[[10, 170], [110, 170]]], (box,)) == [0, 0, 0, 0]


def test_empty_sides_have_defined_scores() -> None:
    nothing, something = Polylines.from_list([]), Polylines.from_list([TRUNK])
    for prediction, truth, score in ((nothing, nothing, 1), (nothing, something, 0), (something, nothing, 0)):
        metric = TopoMetric()
        metric.update(prediction, truth, SIZE)
        assert metric.compute() == {"precision": score, "recall": score, "f1": score}


def test_images_are_averaged_by_their_marbles() -> None:
    metric = metric_of()
    short, long = [[10, 50], [30, 50]], [[10, 90], [70, 90]]
    metric.update(Polylines.from_list([short]), Polylines.from_list([short]), SIZE)  # 2 seeds, 2 marbles each
    metric.update(Polylines.from_list([]), Polylines.from_list([long]), SIZE)  # 2 seeds, 6 marbles each
    assert metric.compute() == pytest.approx({"precision": 1, "recall": 0.25, "f1": 0.4})


def test_the_defaults_follow_the_width_of_the_image() -> None:
    rng = np.random.default_rng(1)
    truth = Polylines.from_list(rng.uniform(0, 200, (4, 2)) for _ in range(5))
    prediction = truth.with_vertices(truth.vertices + rng.normal(0, 4, truth.vertices.shape))
    rows = []
    for scales in ({}, {"radius": 6.4, "spacing": 3.2, "reach": 80.0, "seed_spacing": 16.0}):
        metric = TopoMetric(**scales)
        metric.update(prediction, truth, SIZE)
        rows.append(metric.rows[0].tolist())
    assert rows[0] == rows[1]


# ---- the literal twin


def _marbles(graph: Graph, spacing: float) -> list[tuple[int, float, tuple, tuple]]:
    """Edge, length of the way from its start, place and direction of each marble."""
    found = []
    for edge, curve in enumerate(graph.curves):
        n = max(1, math.floor(graph.lengths[edge] / spacing + 0.5))
        for k in range(n):
            left = arc = (k + 0.5) * graph.lengths[edge] / n
            for start, end in itertools.pairwise(curve):
                length = math.dist(start, end)
                if left < length:
                    place = start + (end - start) * left / length
                    found.append((edge, arc, tuple(place), tuple((end - start) / length)))
                    break
                left -= length
    return found


def _ways(graph: Graph, marbles: list, start: int, backwards: bool) -> list[float]:
    """Dijkstra, without a heap, over the nodes and all marbles."""
    steps: dict[object, list] = {}
    for edge, (a, b) in enumerate(graph.edges.tolist()):
        stops = [(0.0, ("node", a))]
        stops += [(arc, i) for i, (e, arc, _, _) in enumerate(marbles) if e == edge]
        stops += [(graph.lengths[edge], ("node", b))]
        for (s, p), (t, q) in itertools.pairwise(stops):
            for u, v in [(p, q), (q, p)] if not graph.directed else [(q, p) if backwards else (p, q)]:
                steps.setdefault(u, []).append((t - s, v))
    ways, done = {start: 0.0}, set()
    while set(ways) - done:
        here = min(set(ways) - done, key=lambda p: ways[p])
        done.add(here)
        for length, there in steps.get(here, []):
            ways[there] = min(ways.get(there, math.inf), ways[here] + length)
    return [ways.get(i, math.inf) for i in range(len(marbles))]


def _largest(links: dict[int, list[int]]) -> int:
    """Kuhn's algorithm, recursive."""
    partner: dict[int, int] = {}

    def place(row: int, tried: set) -> bool:
        for column in links[row]:
            if column not in tried:
                tried.add(column)
                if column not in partner or place(partner[column], tried):
                    partner[column] = row
                    return True
        return False

    return sum(place(row, set()) for row in links)


def twin(side: Graph, other: Graph, scales: dict, angle_radius: float) -> list[float]:
    """Matched and all marbles around the seeds of a side."""
    own, others = _marbles(side, scales["spacing"]), _marbles(other, scales["spacing"])

    def close(i: int, j: int) -> bool:
        cosine = np.dot(own[i][3], others[j][3])
        turn = math.acos(np.clip(cosine if side.directed else abs(cosine), -1, 1))
        return math.dist(own[i][2], others[j][2]) <= scales["radius"] and turn <= angle_radius

    def reached(graph: Graph, marbles: list, start: int) -> set[int]:
        both = [_ways(graph, marbles, start, backwards) for backwards in (False, True)]
        return {i for ways in both for i, way in enumerate(ways) if way <= scales["reach"]}

    matched = total = 0
    stride = max(1, round(scales["seed_spacing"] / scales["spacing"]))
    for edge in range(len(side.edges)):
        mine = [i for i, marble in enumerate(own) if marble[0] == edge]
        for rank, seed in enumerate(mine):
            if math.floor(abs(rank - (len(mine) - 1) / 2)) % stride:
                continue
            holes = reached(side, own, seed)
            total += len(holes)
            partners = [j for j in range(len(others)) if close(seed, j)]
            if partners:
                nearest = min(partners, key=lambda j: math.dist(own[seed][2], others[j][2]))
                marbles = reached(other, others, nearest)
                matched += _largest({i: [j for j in marbles if close(i, j)] for i in holes})
    return [matched, total]


@pytest.mark.parametrize("directed", [True, False])
@pytest.mark.parametrize("reach", [45.0, 500.0])
def test_counts_equal_the_literal_twin(directed: bool, reach: float) -> None:
    rng = np.random.default_rng(5)
    scales = {"radius": 12.0, "spacing": 15.0, "reach": reach, "seed_spacing": 45.0}
    for _ in range(3):
        places = rng.uniform([0, 0], [200, 160], (6, 2))
        truth = [places[rng.choice(6, 3, replace=False)] for _ in range(4)]
        prediction = [line + rng.normal(0, 5, 2) * (rng.random() < 0.5) for line in truth[1:]]
        metric = TopoMetric(**scales, directed=directed)  # type: ignore[arg-type]
        metric.update(Polylines.from_list(prediction), Polylines.from_list(truth), SIZE)
        found, wanted = (
            build_graph(Polylines.from_list(side), SIZE, directed=directed) for side in (prediction, truth)
        )
        expected = twin(found, wanted, scales, math.pi / 4) + twin(wanted, found, scales, math.pi / 4)
        assert metric.rows[0].tolist() == expected


@settings(deadline=None)
@given(st.lists(st.lists(st.integers(0, 7), unique=True, max_size=5), max_size=9))
def test_the_largest_matching_equals_the_twin(links: list) -> None:
    bounds = np.cumsum([0, *map(len, links)])
    columns = np.array([column for row in links for column in row], np.int64)
    assert _largest_matching(bounds, columns, 8) == _largest(dict(enumerate(links)))


def test_the_largest_matching_of_long_chains_is_found_at_once() -> None:
    rng = np.random.default_rng(0)
    links = [np.sort(rng.permutation(np.clip(np.arange(i, i + 5), 0, 19_999))) for i in range(20_000)]
    assert _largest_matching(np.arange(20_001) * 5, np.concatenate(links), 20_000) == 20_000


# ---- what must not matter


def score(prediction: list, truth: list, **settings: bool) -> dict[str, float]:
    metric = TopoMetric(radius=15.0, **settings)
    metric.update(Polylines.from_list(prediction), Polylines.from_list(truth), SIZE)
    return metric.compute()


@settings(deadline=None, max_examples=25)
@given(lattice_lines, lattice_lines, st.randoms(use_true_random=False), st.booleans())
def test_order_pieces_and_sides_do_not_matter(pred: list, gt: list, random: object, directed: bool) -> None:
    expected = score(pred, gt, directed=directed)
    assert all(0 <= value <= 1 for value in expected.values())
    exchanged = score(gt, pred, directed=directed)
    assert (exchanged["precision"], exchanged["recall"]) == (expected["recall"], expected["precision"])
    if not directed:
        assert score(reverse(pred), gt, directed=False) == expected
    pieces = [list(pair) for line in pred for pair in itertools.pairwise(line)]
    random.shuffle(pieces)  # type: ignore[attr-defined]
    random.shuffle(gt)  # type: ignore[attr-defined]
    assert score(pieces, gt, directed=directed) == expected


@settings(deadline=None, max_examples=25)
@given(lattice_lines, st.booleans())
def test_a_prediction_equal_to_the_labels_is_perfect(lines: list, directed: bool) -> None:
    assert score(lines[::-1], lines, directed=directed) == {"precision": 1, "recall": 1, "f1": 1}


@settings(deadline=None, max_examples=12)
@given(lattice_lines, lattice_lines, st.integers(0, 60), st.booleans())
def test_a_shift_of_both_sides_does_not_matter(pred: list, gt: list, shift: int, directed: bool) -> None:
    rows = []
    for by in (0, shift):
        sides = [[np.array(line) + by for line in lines] for lines in (pred, gt)]
        metric = TopoMetric(radius=15.0, spacing=8.0, reach=90.0, seed_spacing=16.0, directed=directed)
        metric.update(*(Polylines.from_list(side) for side in sides), (300, 400))
        rows.append(metric.rows[0].tolist())
    assert rows[0] == rows[1]


def test_segments_and_polylines_may_meet() -> None:
    truth = Polylines.from_list([[[10, 10], [90, 10], [90, 70]]])
    metric = TopoMetric()
    metric.update(Segments(truth.endpoints), truth, SIZE)
    assert metric.compute()["f1"] == 1


def test_many_seeds_are_worked_off_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    sides = [[rng.uniform(0, 200, (3, 2)) for _ in range(6)] for _ in range(2)]
    expected = score(*sides)
    monkeypatch.setattr("yolino.metrics.topo._PAIRS", 1)
    assert score(*sides) == expected


# ---- bad input


@pytest.mark.parametrize("name", ["radius", "spacing", "reach", "seed_spacing", "snap"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_scales_must_be_positive(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"{name} must be a positive number of pixels"):
        TopoMetric(**{name: value})  # type: ignore[arg-type]


def test_other_bad_arguments_are_named() -> None:
    for angle in (0.0, 45.0, math.nan):
        with pytest.raises(ValueError, match="radians"):
            TopoMetric(angle_radius=angle)
    good, bad = Polylines.from_list([TRUNK]), Polylines.from_list([[[math.nan, 0], [5, 5]]])
    for sides in ((good, bad), (bad, good)):
        metric = TopoMetric()
        with pytest.raises(ValueError, match="NaN or infinite"):
            metric.update(*sides, SIZE)
        assert len(metric) == 0
    with pytest.raises(ValueError, match="first image"):
        TopoMetric().compute()
