from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.datasets.skeleton import mask_to_polylines
from yolino.geometry import distance_to_segments, resample
from yolino.types import Polylines

pytest.importorskip("skimage", reason="scikit-image thins the masks of these tests")

Line = list[tuple[float, float]]
SIZE = (120, 160)
WIDTHS = (1, 2, 5)


def draw(*lines: Line, width: int = 1, size: tuple[int, int] = SIZE) -> np.ndarray:
    """Draws lines given in pixels, where (0.5, 0.5) is the center of the first pixel."""
    mask = np.zeros(size, np.uint8)
    for line in lines:
        cv2.polylines(mask, [np.round((np.array(line) - 0.5) * 16).astype(np.int32)], False, 1, width, 8, 4)
    return mask.astype(bool)


def from_picture(picture: str) -> np.ndarray:
    rows = picture.split()
    return np.array([[c == "#" for c in row] for row in rows])


def exactly(mask: np.ndarray, **options: float) -> list[Line]:
    """Gives the lines of a mask of few pixels, nothing cleaned."""
    options = {"tolerance": 0.01, "spur": 0.0, "min_length": 0.0} | options
    return as_lists(mask_to_polylines(mask, holes=0, **options))


def as_lists(lines: Polylines) -> list[Line]:
    return [[(x, y) for x, y in line.tolist()] for line in lines]


def farthest(lines: Polylines | list[Line], others: Polylines | list[Line]) -> float:
    """Gives the largest distance of a point of `lines` to `others`."""
    points = np.concatenate([resample(np.array(line, float), 0.5) for line in lines])
    polylines = others if isinstance(others, Polylines) else Polylines.from_list(others)
    return float(distance_to_segments(points, polylines.endpoints).max())


def ends_of(lines: Polylines) -> list[tuple[float, float]]:
    return [tuple(line[i].tolist()) for line in lines for i in (0, -1)]


def test_nothing_is_no_line():
    assert len(mask_to_polylines(np.zeros((5, 7), bool))) == 0
    assert len(mask_to_polylines(np.zeros((0, 7), bool))) == 0


def test_vertices_are_pixel_centers_from_left_to_right():
    mask = from_picture(".......  .###...  ....##.  .......")
    assert exactly(mask) == [[(1.5, 1.5), (3.5, 1.5), (4.5, 2.5), (5.5, 2.5)]]
    assert exactly(mask[:, ::-1]) == [[(1.5, 2.5), (2.5, 2.5), (3.5, 1.5), (5.5, 1.5)]]


def test_a_vertical_line_runs_from_top_to_bottom():
    assert exactly(from_picture("... .#. .#. .#. ...")) == [[(1.5, 1.5), (1.5, 3.5)]]


def test_two_pixels_are_a_line_from_left_to_right():
    assert exactly(from_picture(".... ..#. .#.. ....")) == [[(1.5, 2.5), (2.5, 1.5)]]
    assert exactly(from_picture(".... .#.. ..#. ....")) == [[(1.5, 1.5), (2.5, 2.5)]]


def test_a_corner_is_no_junction():
    assert exactly(from_picture("..... .###. ...#. ...#. .....")) in (
        [[(1.5, 1.5), (3.5, 1.5), (3.5, 3.5)]],
        [[(1.5, 1.5), (2.5, 1.5), (3.5, 2.5), (3.5, 3.5)]],
    )


@pytest.mark.parametrize("width", WIDTHS)
def test_a_drawn_line_is_found(width):
    line = [(15.5, 20.5), (100.5, 40.5), (140.5, 100.5)]
    found = mask_to_polylines(draw(line, width=width))
    assert len(found) == 1
    assert farthest(found, [line]) < 1.6
    assert farthest([line], found) < 2.5
    assert found.labels.tolist() == [0]


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("degrees", range(0, 180, 36))
def test_lines_of_all_directions_keep_their_ends(width, degrees):
    angle = math.radians(degrees)
    way = np.array([math.cos(angle), math.sin(angle)]) * 45
    line = [tuple(np.array([80.3, 60.2]) - way), tuple(np.array([80.3, 60.2]) + way)]
    found = mask_to_polylines(draw(line, width=width))
    assert len(found) == 1
    assert farthest(found, [line]) < 1.8
    assert farthest([line], found) < 2.6


@pytest.mark.parametrize("width", WIDTHS)
def test_branches_of_a_fork_share_their_junction_exactly(width):
    fork = [[(80.5, 60.5), end] for end in [(15.5, 20.5), (145.5, 20.5), (80.5, 110.5)]]
    found = mask_to_polylines(draw(*fork, width=width))
    assert len(found) == 3
    places = ends_of(found)
    (junction,) = {place for place in places if places.count(place) == 3}
    assert math.dist(junction, (80.5, 60.5)) < 2.5
    assert farthest(found, fork) < 2
    assert farthest(fork, found) < 2.5


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("degrees", [30, 60, 90])
@pytest.mark.parametrize("turn", [0, 17])
def test_a_crossing_is_four_branches_of_one_junction(width, degrees, turn):
    center = np.array([80.3, 80.7])
    cross = []
    for angle in (math.radians(turn), math.radians(turn + degrees)):
        way = np.array([math.cos(angle), math.sin(angle)]) * 70
        cross.append([tuple(center - way), tuple(center + way)])
    found = mask_to_polylines(draw(*cross, width=width, size=(160, 160)))
    assert len(found) == 4
    places = ends_of(found)
    (junction,) = {place for place in places if places.count(place) == 4}
    assert math.dist(junction, center) < 2.5
    assert farthest(found, cross) < 2
    assert farthest(cross, found) < 3


def test_side_roads_far_from_each_other_stay_two_junctions():
    street = [[(10.5, 60.5), (150.5, 60.5)], [(60.5, 60.5), (60.5, 10.5)], [(90.5, 60.5), (90.5, 110.5)]]
    found = mask_to_polylines(draw(*street, width=5))
    assert len(found) == 5
    places = ends_of(found)
    assert sorted(places.count(place) for place in set(places)) == [1, 1, 1, 1, 3, 3]


@pytest.mark.parametrize("width", WIDTHS)
def test_a_ring_is_one_closed_line(width):
    angles = np.linspace(0, 2 * np.pi, 100)
    ring = [(80 + 50 * math.cos(a), 60 + 40 * math.sin(a)) for a in angles]
    found = mask_to_polylines(draw(ring, width=width))
    assert len(found) == 1
    (line,) = found
    assert line[0].tolist() == line[-1].tolist()
    assert line[0, 0] == line[:, 0].min()
    assert farthest(found, [ring]) < 1.6
    assert farthest([ring], found) < 1.6


def test_two_rings_that_touch_share_one_vertex():
    boxes = [[(20.5, 20.5), (60.5, 20.5), (60.5, 60.5), (20.5, 60.5), (20.5, 20.5)]]
    boxes.append([(60.5, 60.5), (100.5, 60.5), (100.5, 100.5), (60.5, 100.5), (60.5, 60.5)])
    found = mask_to_polylines(draw(*boxes))
    assert ends_of(found) == [(60.5, 60.5)] * 4


def test_spurs_are_cut_off_and_their_line_goes_on():
    comb = [[(10.5, 60.5), (150.5, 60.5)]]
    comb += [[(x + 0.5, 60.5), (x + 0.5, 60.5 - length)] for x, length in ((40, 5), (70, 9), (100, 20))]
    mask = draw(*comb)
    assert len(mask_to_polylines(mask, spur=0.0)) == 7
    assert len(mask_to_polylines(mask, spur=6.0)) == 5
    found = mask_to_polylines(mask, spur=12.0)
    assert as_lists(found) == [
        [(10.5, 60.5), (100.5, 60.5)],
        [(100.5, 40.5), (100.5, 60.5)],
        [(100.5, 60.5), (150.5, 60.5)],
    ]
    assert as_lists(mask_to_polylines(mask, spur=30.0)) == [comb[0]]


def test_spurs_are_measured_from_the_edge_of_their_line():
    mask = draw([(10.5, 60.5), (150.5, 60.5)], width=11) | draw([(80.5, 60.5), (80.5, 45.5)])
    assert len(mask_to_polylines(mask, spur=12.0)) == 1
    assert len(mask_to_polylines(mask, spur=7.0)) == 3


def test_a_tree_of_spurs_goes_twig_by_twig():
    tree = [[(10.5, 60.5), (150.5, 60.5)], [(80.5, 60.5), (80.5, 54.5)]]
    tree += [[(80.5, 54.5), (76.5, 50.5)], [(80.5, 54.5), (85.5, 49.5)]]
    mask = draw(*tree)
    assert len(mask_to_polylines(mask, spur=0.0)) == 5
    assert len(mask_to_polylines(mask, spur=6.0)) == 3  # a twig goes, stem and the other one stay as one
    assert as_lists(mask_to_polylines(mask, spur=14.0)) == [tree[0]]


def test_short_lines_go_with_all_that_is_connected():
    lines = [[(10.5, 10.5), (16.5, 10.5)], [(10.5, 30.5), (30.5, 30.5)]]
    fork = [[(100.5, 60.5), end] for end in [(95.5, 60.5), (104.5, 56.5), (104.5, 64.5)]]
    mask = draw(*lines, *fork)
    options = {"spur": 0.0, "tolerance": 0.5}
    assert len(mask_to_polylines(mask, min_length=0.0, **options)) == 5
    assert len(mask_to_polylines(mask, min_length=10.0, **options)) == 4  # the fork is longer than that
    assert as_lists(mask_to_polylines(mask, min_length=19.0, **options)) == [lines[1]]
    assert len(mask_to_polylines(mask, min_length=21.0, **options)) == 0
    ring = draw([(50.5, 50.5), (54.5, 50.5), (54.5, 54.5), (50.5, 54.5), (50.5, 50.5)])
    assert len(mask_to_polylines(ring, holes=0, min_length=13.0)) == 1
    assert len(mask_to_polylines(ring, holes=0, min_length=17.0)) == 0


def test_single_pixels_are_no_lines():
    mask = np.zeros(SIZE, bool)
    mask[10, 10] = mask[50, 60] = True
    assert exactly(mask) == []


def test_small_holes_are_filled():
    mask = draw([(10.5, 60.5), (150.5, 60.5)], width=9)
    mask[59:61, 40:44] = False
    assert len(mask_to_polylines(mask, holes=8)) == 1
    assert len(mask_to_polylines(mask, holes=7)) > 1
    assert not mask[59, 40]  # the caller's mask stays as it is


def test_gaps_at_the_border_are_no_holes():
    mask = np.ones((3, 30), bool)
    mask[0, 3:5] = mask[1, 3:5] = False
    filled = np.ones((3, 30), bool)
    assert as_lists(mask_to_polylines(mask, holes=10)) != as_lists(mask_to_polylines(filled))


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("slope", [0.0, 0.3, 0.9])
def test_lines_that_leave_the_image_end_at_its_border(width, slope):
    def at(x: float) -> tuple[float, float]:
        return x, 60 + slope * (x - 80) / 1.5

    found = mask_to_polylines(draw([at(-40), at(200)], width=width))
    assert len(found) == 1
    (line,) = found
    assert math.dist(line[0], at(0)) < 2
    assert math.dist(line[-1], at(160)) < 2
    assert line[0, 0] == 0
    assert line[-1, 0] == 160


@pytest.mark.parametrize("width", [1, 3, 5])
def test_lines_along_the_border_are_not_lost(width):
    y = width / 2
    found = mask_to_polylines(draw([(20.5, y), (140.5, y)], width=width))
    assert len(found) == 1
    assert farthest(found, [[(18, y), (142, y)]]) <= width / 2 + 0.5
    assert found.lengths[0] > 115


@pytest.mark.parametrize("tolerance", [0.0, 0.5, 1.0, 3.0])
def test_the_skeleton_stays_within_the_tolerance(tolerance):
    wave = [(x, 60 + 40 * math.sin(x / 15)) for x in np.arange(10.5, 150)]
    mask = draw(wave)
    found = mask_to_polylines(mask, tolerance=tolerance)
    assert len(found) == 1
    points = np.argwhere(mask)[:, ::-1] + 0.5
    # Pixels that thinning takes away lie at corners of the line, beside its skeleton.
    assert distance_to_segments(points, found.endpoints).max() <= tolerance + 0.75
    assert len(found.vertices) < (len(points) + 1 if tolerance == 0 else 70)


def test_a_larger_tolerance_takes_fewer_vertices():
    wave = draw([(x, 60 + 40 * math.sin(x / 15)) for x in np.arange(10.5, 150)])
    counts = [len(mask_to_polylines(wave, tolerance=t).vertices) for t in (0.0, 0.5, 1.0, 3.0, 30.0)]
    assert counts == sorted(counts, reverse=True)
    assert counts[0] > 100
    assert counts[-1] < 8


def test_it_is_the_same_every_time_and_mirrored_up_to_three_pixels():
    rng = np.random.default_rng(3)
    mask = draw(*[[tuple(p) for p in rng.uniform(10, 110, (2, 2))] for _ in range(6)], width=3)
    found = mask_to_polylines(mask)
    assert as_lists(found) == as_lists(mask_to_polylines(mask.copy()))
    assert as_lists(found) == sorted(as_lists(found))
    assert all(line == min(line, line[::-1]) for line in as_lists(found))
    mirrored = mask_to_polylines(np.ascontiguousarray(mask[:, ::-1]))
    back = mirrored.with_vertices(mirrored.vertices * [-1, 1] + [SIZE[1], 0])
    assert farthest(found, back) < 3
    assert farthest(back, found) < 3


@settings(deadline=None, max_examples=40)
@given(
    st.lists(st.tuples(st.integers(12, 140), st.integers(12, 100)), min_size=2, max_size=5, unique=True),
    st.integers(1, 6),
)
def test_random_lines_are_covered(points, width):
    line = [(x + 0.5, y + 0.5) for x, y in points]
    if Polylines.from_list([line]).lengths[0] < 25:
        return
    mask = draw(line, width=width)
    found = mask_to_polylines(mask)
    assert len(found) >= 1
    assert farthest(found, [line]) < width + 3.5  # where strokes run side by side, the skeleton is between
    assert np.isfinite(found.vertices).all()
    assert (found.lengths > 0).all()


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.floats(0.02, 0.98), st.integers(1, 40), st.integers(1, 40))
def test_noise_of_any_size_gives_valid_lines(seed, share, height, width):
    mask = np.random.default_rng(seed).random((height, width)) < share
    for options in ({}, {"spur": 0.0, "min_length": 0.0, "holes": 0, "tolerance": 0.0}):
        found = mask_to_polylines(mask, **options)
        assert (found.vertices >= 0).all()
        assert (found.vertices <= [width, height]).all()
        assert (found.lengths > 0).all()


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_every_pixel_of_a_thin_graph_lies_on_a_line(seed):
    """Paths of single pixels, walked on a coarse grid: nothing is thinned away, nothing is added."""
    rng = np.random.default_rng(seed)
    mask = np.zeros((64, 64), bool)
    at = np.array([5, 5])
    for _ in range(30):
        step = [(4, 0), (-4, 0), (0, 4), (0, -4)][rng.integers(4)]
        to = np.clip(at + step, 5, 57)
        mask[min(at[1], to[1]) : max(at[1], to[1]) + 1, min(at[0], to[0]) : max(at[0], to[0]) + 1] = True
        at = to
    found = mask_to_polylines(mask, spur=0.0, min_length=0.0, holes=0, tolerance=0.0)
    points = np.argwhere(mask)[:, ::-1] + 0.5
    assert distance_to_segments(points, found.endpoints).max() <= 1
    covered = np.floor(np.concatenate([resample(line, 0.25) for line in found])).astype(int)
    grown = cv2.dilate(mask.view(np.uint8), np.ones((3, 3), np.uint8))
    assert grown[covered[:, 1], covered[:, 0]].all()


@pytest.mark.parametrize("name", ["tolerance", "spur", "min_length", "holes"])
def test_bad_numbers_are_named(name):
    bad = -1 if name == "holes" else -0.5
    with pytest.raises(ValueError, match=f"{name} is -.*finite number"):
        mask_to_polylines(np.ones((5, 5), bool), **{name: bad})
    if name != "holes":
        with pytest.raises(ValueError, match=f"{name} is nan"):
            mask_to_polylines(np.ones((5, 5), bool), **{name: float("nan")})
