from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.geometry import clip_polylines, distance_to_segments, sample_segments
from yolino.grid import Grid, cells_to_pixels, deviation, discretize, surplus
from yolino.types import CellSegments, Polylines, Segments

GRID = Grid((48, 64), 16)

# Quarters of a pixel make corners, borders, repeated vertices and lines along borders frequent.
quarters = st.integers(-4 * 20, 4 * 84).map(lambda n: n / 4)
on_grid = st.integers(-1, 5).map(lambda n: 16.0 * n)
coordinate = st.one_of(quarters, on_grid)
lines = st.lists(st.tuples(coordinate, coordinate), min_size=0, max_size=7).map(
    lambda v: np.array(v, np.float64).reshape(-1, 2)
)
# Rounded, since what lies nearer to a border than 1e-9 cells is moved onto it.
anywhere = st.floats(-30, 90).map(lambda x: round(x, 5))
smooth_lines = st.lists(st.tuples(anywhere, anywhere), min_size=2, max_size=6).map(np.array)


def cut(*vertices: tuple[float, float], border: bool = False, grid: Grid = GRID) -> CellSegments:
    return discretize(Polylines.from_list([np.array(vertices)]), grid, border=border)


# A literal twin in exact fractions: one polyline, one piece, one crossing at a time.


def exact_clip(a, b, limits):
    low, high = Fraction(0), Fraction(1)
    for axis in (0, 1):
        d = b[axis] - a[axis]
        if d == 0:
            if not 0 <= a[axis] <= limits[axis]:
                return None
            continue
        t = sorted((-a[axis] / d, (limits[axis] - a[axis]) / d))
        low, high = max(low, t[0]), min(high, t[1])
    if low >= high:
        return None
    return tuple(tuple(a[k] + t * (b[k] - a[k]) for k in (0, 1)) for t in (low, high))


def exact_parts(vertices, grid):
    points = [tuple(Fraction(float(x)) / grid.stride for x in v) for v in vertices]
    limits = (grid.cols, grid.rows)
    pieces = [exact_clip(a, b, limits) for a, b in pairwise(points) if a != b]
    for a, b in (piece for piece in pieces if piece is not None):
        at = {Fraction(0), Fraction(1)}
        for axis in (0, 1):
            for line in range(limits[axis] + 1):
                d = b[axis] - a[axis]
                if d and 0 < (line - a[axis]) / d < 1:
                    at.add((line - a[axis]) / d)
        stops = [tuple(a[k] + t * (b[k] - a[k]) for k in (0, 1)) for t in sorted(at)]
        for p, q in pairwise(stops):
            cell = tuple(min(int((p[k] + q[k]) / 2 // 1), limits[k] - 1) for k in (0, 1))
            yield cell, p, q


def exact_visits(vertices, grid):
    visits = []
    for cell, p, q in exact_parts(vertices, grid):
        if visits and visits[-1][0] == cell and visits[-1][2] == p:
            visits[-1][2] = q
        else:
            visits.append([cell, p, q])
    return [
        (c, tuple(p[k] - c[k] for k in (0, 1)), tuple(q[k] - c[k] for k in (0, 1)))
        for c, p, q in visits
        if p != q
    ]


def exact_border(visits):
    for cell, p, q in visits:
        d = [q[k] - p[k] for k in (0, 1)]
        spans = [sorted((-p[k] / d[k], (1 - p[k]) / d[k])) for k in (0, 1) if d[k]]
        low, high = max(s[0] for s in spans), min(s[1] for s in spans)
        loose = [all(0 < x < 1 for x in e) for e in (p, q)]
        if any(loose) and not (high - low) / 2 < 1:
            continue
        start = tuple(p[k] + low * d[k] for k in (0, 1)) if loose[0] else p
        end = tuple(p[k] + high * d[k] for k in (0, 1)) if loose[1] else q
        yield cell, start, end


@settings(deadline=None, max_examples=300)
@given(st.lists(lines, max_size=3), st.booleans())
def test_equals_the_literal_twin(drawn, border):
    polylines = Polylines.from_list(drawn, labels=list(range(len(drawn))))
    found = discretize(polylines, GRID, border=border)
    expected = []
    for owner, vertices in enumerate(polylines):
        visits = exact_visits(vertices, GRID)
        expected += [(owner, *v) for v in (exact_border(visits) if border else visits)]
    assert found.owners.tolist() == [e[0] for e in expected]
    assert found.labels.tolist() == found.owners.tolist()
    assert found.cells.tolist() == [[e[1][1], e[1][0]] for e in expected]
    want = np.array([[e[2], e[3]] for e in expected], np.float64).reshape(-1, 2, 2)
    np.testing.assert_allclose(found.endpoints, want, atol=1e-9)


@settings(deadline=None)
@given(smooth_lines)
def test_chords_lie_in_their_cells_one_after_the_other_and_keep_the_direction(vertices):
    found = cut(*vertices)
    assert np.all((found.endpoints >= 0) & (found.endpoints <= 1))
    assert np.all((found.cells >= 0) & (found.cells < (GRID.rows, GRID.cols)))
    assert np.all(np.abs(np.diff(found.endpoints, axis=1)).max(axis=(1, 2)) > 0)
    back = discretize(Polylines.from_list([vertices[::-1]]), GRID, border=False)
    if (vertices % 16 != 0).all():
        np.testing.assert_allclose(back.endpoints[::-1, ::-1], found.endpoints, atol=1e-6)


@settings(deadline=None)
@given(st.tuples(anywhere, anywhere), st.tuples(anywhere, anywhere))
def test_a_straight_polyline_is_covered_exactly(start, end):
    inside = clip_polylines(Polylines.from_list([[list(start), list(end)]]), GRID.size)
    segments = cells_to_pixels(cut(start, end), GRID)
    assert segments.lengths.sum() == pytest.approx(inside.lengths.sum(), abs=1e-3)
    if len(segments):
        assert deviation(inside, segments) < 1e-4
        np.testing.assert_allclose(segments.starts[1:], segments.ends[:-1], atol=1e-4)
        assert np.all(((segments.ends - segments.starts) @ (np.array(end) - start)) > 0)


@settings(deadline=None)
@given(smooth_lines)
def test_no_chord_leaves_its_polyline_by_more_than_a_cell(vertices):
    inside = clip_polylines(Polylines.from_list([vertices]), GRID.size)
    segments = cells_to_pixels(cut(*vertices), GRID)
    if len(segments):
        points, _ = sample_segments(segments.endpoints, 1.0)
        assert distance_to_segments(points, inside.endpoints).max() < 16 * np.sqrt(2)


@settings(deadline=None)
@given(
    st.lists(st.tuples(st.integers(1, 4 * 31), st.integers(1, 4 * 31)), min_size=2, max_size=6), st.booleans()
)
def test_moving_by_one_cell_moves_the_cells_by_one(quarter_pixels, border):
    vertices = np.array(quarter_pixels) / 4
    here = cut(*vertices, border=border)
    there = cut(*np.add(vertices, (32, 16)), border=border)
    np.testing.assert_array_equal(there.cells, np.add(here.cells, (1, 2)))
    np.testing.assert_allclose(there.endpoints, here.endpoints, atol=1e-9)


def test_inner_vertices_become_one_chord_per_visit():
    found = cut((0, 8), (8, 4), (20, 8), (24, 10), (32, 8))
    np.testing.assert_array_equal(found.cells, [[0, 0], [0, 1]])
    y = 4 + 4 * 8 / 12
    np.testing.assert_allclose(found.endpoints * 16, [[[0, 8], [16, y]], [[0, y], [16, 8]]])


def test_a_polyline_may_visit_a_cell_twice():
    found = cut((8, 2), (24, 2), (24, 10), (8, 10))
    np.testing.assert_array_equal(found.cells, [[0, 0], [0, 1], [0, 0]])
    np.testing.assert_allclose(found.endpoints[:, :, 1] * 16, [[2, 2], [2, 10], [10, 10]])


def test_leaving_the_image_ends_a_visit_exactly_at_its_border():
    found = cut((8, 8), (8, -8), (12, -8), (12, 8))
    np.testing.assert_array_equal(found.cells, [[0, 0], [0, 0]])
    np.testing.assert_array_equal(found.endpoints * 16, [[[8, 8], [8, 0]], [[12, 0], [12, 8]]])


def test_a_line_across_the_whole_image_is_cut_at_both_borders():
    found = cut((-1000, 8), (1000, 8))
    np.testing.assert_array_equal(found.cells, [[0, 0], [0, 1], [0, 2], [0, 3]])
    np.testing.assert_allclose(found.endpoints[:, :, 0], [[0, 1]] * 4)


def test_lines_along_borders_belong_to_the_right_and_the_lower_cell():
    np.testing.assert_array_equal(cut((16, 2), (16, 20)).cells, [[0, 1], [1, 1]])
    np.testing.assert_array_equal(cut((2, 16), (14, 16)).cells, [[1, 0]])
    right = cut((64, 2), (64, 14))
    np.testing.assert_array_equal(right.cells, [[0, 3]])
    np.testing.assert_array_equal(right.endpoints[..., 0], [[1, 1]])
    np.testing.assert_array_equal(cut((2, 48), (14, 48)).cells, [[2, 0]])


@pytest.mark.parametrize(
    ("vertices", "cells"),
    [
        ([(8, 8), (24, 24)], [[0, 0], [1, 1]]),
        ([(8, 24), (24, 8)], [[1, 0], [0, 1]]),
        ([(24, 24), (8, 8)], [[1, 1], [0, 0]]),
        ([(1.1, 1.1), (30.3, 30.3)], [[0, 0], [1, 1]]),
    ],
)
def test_a_line_through_a_corner_visits_two_cells(vertices, cells):
    found = cut(*vertices)
    np.testing.assert_array_equal(found.cells, cells)
    assert np.linalg.norm(np.diff(found.endpoints, axis=1), axis=2).min() > 0.1


@pytest.mark.parametrize("border", [False, True])
@pytest.mark.parametrize(
    "vertices",
    [
        [],
        [(8, 8)],
        [(8, 8), (8, 8)],
        [(16, 16), (16, 16)],
        [(3, 3), (9, 3), (3, 3)],
        [(-9, -9), (80, -2)],
        [(-8, 8), (8, -8)],
    ],
)
def test_nothing_comes_of_polylines_without_a_chord(vertices, border):
    found = discretize(Polylines.from_list([vertices]), GRID, border=border)
    assert len(found) == 0
    assert found.cells.shape == (0, 2)
    assert found.endpoints.shape == (0, 2, 2)


def test_repeated_vertices_change_nothing():
    once = cut((2, 3), (16, 5), (40, 40))
    twice = cut((2, 3), (2, 3), (16, 5), (16, 5), (16, 5), (40, 40), (40, 40))
    np.testing.assert_array_equal(once.cells, twice.cells)
    np.testing.assert_array_equal(once.endpoints, twice.endpoints)


def test_touching_a_border_with_a_repeated_vertex_does_not_split_a_visit():
    assert cut((2, 2), (16, 8), (16, 8), (2, 14)).cells.tolist() == [[0, 0]]


def test_rounding_errors_next_to_a_border_do_not_scatter_a_line_over_both_cells():
    wobble = 16 + 1e-12 * np.array([1, -1, 1, -1, 1])
    found = cut(*np.stack([wobble, [1.0, 4, 7, 10, 13]], axis=1))
    np.testing.assert_array_equal(found.cells, [[0, 1]])


def test_ends_that_cover_more_than_half_their_cell_reach_the_border():
    found = cut((7, 8), (41, 8), border=True)  # covers 9/16 of the first cell and of the last
    np.testing.assert_array_equal(found.cells, [[0, 0], [0, 1], [0, 2]])
    np.testing.assert_array_equal(found.endpoints[..., 0], [[0, 1]] * 3)


@pytest.mark.parametrize("end", [40, 39])
def test_ends_that_cover_half_their_cell_or_less_are_dropped(end):
    found = cut((16, 8), (end, 8), border=True)
    np.testing.assert_array_equal(found.cells, [[0, 1]])


def test_half_is_measured_on_the_chord_in_that_direction():
    # From the left side at y = 14 downwards at 45 degrees: the full chord is only 2 px wide.
    np.testing.assert_allclose(cut((0, 14), (1.1, 15.1), border=True).endpoints * 16, [[[0, 14], [2, 16]]])
    assert len(cut((0, 14), (0.9, 14.9), border=True)) == 0


def test_a_polyline_within_one_cell_is_extended_at_both_ends_or_dropped():
    np.testing.assert_allclose(cut((2, 4), (12, 4), border=True).endpoints * 16, [[[0, 4], [16, 4]]])
    assert len(cut((5, 4), (12, 4), border=True)) == 0


def test_border_segments_end_on_the_border():
    rng = np.random.default_rng(3)
    polylines = Polylines.from_list(rng.uniform(-10, 70, (60, 4, 2)))
    ends = discretize(polylines, GRID, border=True).endpoints
    assert len(ends) > 100
    assert ((ends == 0) | (ends == 1)).any(axis=2).all()


def test_cells_to_pixels_inverts():
    cells = CellSegments(
        np.array([[1, 2]]), np.array([[[0.25, 0.5], [1.0, 0.0]]]), np.array([3]), np.array([0])
    )
    segments = cells_to_pixels(cells, GRID)
    np.testing.assert_array_equal(segments.endpoints, [[[36, 24], [48, 16]]])
    assert segments.labels.tolist() == [3]
    assert segments.scores.tolist() == [1]


def test_vertices_that_are_not_finite_are_named():
    bad = Polylines.from_list([[[1, 1], [2, 2]], [[3, 3], [np.nan, 4]]])
    with pytest.raises(ValueError, match="polyline 1 is not finite"):
        discretize(bad, GRID, border=False)


@pytest.mark.parametrize("size", [(48, 60), (40, 64)])
def test_a_size_that_the_stride_does_not_divide_is_named(size):
    with pytest.raises(ValueError, match="not divisible by the stride 16"):
        Grid(size, 16)


@pytest.mark.parametrize(("size", "stride"), [((0, 16), 16), ((16, 16), 0), ((16, -16), 16)])
def test_a_size_that_is_not_positive_is_named(size, stride):
    with pytest.raises(ValueError, match="must be positive"):
        Grid(size, stride)


def test_deviation_of_a_bump_equals_the_computation_by_hand():
    # A triangle 4 px high over a base of 16 px. There: its mean height, 2. Back: the base point at x is
    # x / sqrt(5) away from the nearer flank (slope 1/2), on average 4 / sqrt(5) over 0 <= x <= 8.
    polyline = Polylines.from_list([[[0, 8], [8, 12], [16, 8]]])
    segments = cells_to_pixels(discretize(polyline, GRID, border=False), GRID)
    np.testing.assert_array_equal(segments.endpoints, [[[0, 8], [16, 8]]])
    assert deviation(polyline, segments, 0.01) == pytest.approx((2 + 4 / np.sqrt(5)) / 2, abs=1e-3)
    assert deviation(polyline, segments) == pytest.approx(deviation(polyline, segments, 0.01), abs=0.02)


def test_deviation_of_a_parallel_line_is_its_distance_and_of_a_dropped_end_its_mean():
    base = Polylines.from_list([[[0, 8], [32, 8]]])
    assert deviation(base, Segments([[[0, 11], [32, 11]]])) == pytest.approx(3)
    # The last 8 of 32 px are missing: there 0 ... 8 over a quarter of the length, back 0.
    assert deviation(base, Segments([[[0, 8], [24, 8]]])) == pytest.approx(0.5)


def test_deviation_of_nothing():
    none, line = Polylines.from_list([]), Polylines.from_list([[[0, 8], [32, 8]]])
    assert deviation(none, Segments([])) == 0
    assert deviation(line, Segments([])) == np.inf
    assert deviation(none, Segments([[[0, 8], [32, 8]]])) == np.inf


def test_finer_grids_deviate_less():
    x = np.linspace(0, 128, 80)
    curve = Polylines.from_list([np.stack([x, 64 + 30 * np.sin(x / 15)], axis=1)])
    found = []
    for stride in (32, 16, 8):
        grid = Grid((128, 128), stride)
        found.append(deviation(curve, cells_to_pixels(discretize(curve, grid, border=True), grid)))
    assert found[0] > 2 * found[1] > 4 * found[2] > 0


def test_surplus_counts_what_finds_no_predictor():
    polylines = Polylines.from_list([[[1, y], [30, y]] for y in (1, 3, 5)])
    found = discretize(polylines, GRID, border=False)
    assert [surplus(found, GRID, p) for p in (1, 2, 3, 8)] == [4, 2, 0, 0]
    assert surplus(found[:0], GRID, 1) == 0
