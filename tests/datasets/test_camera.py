from __future__ import annotations

import math
from itertools import chain, pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from yolino.datasets.camera import Camera, Pose, quaternion_to_matrix
from yolino.geometry import distance_to_segments
from yolino.types import Polylines

CAMERA = Camera(focal=(100.0, 50.0), center=(40.0, 30.0), size=(60, 80))
numbers = st.floats(-5, 5)


def project(*lines: list[list[float]], camera: Camera = CAMERA, **options: float) -> Polylines:
    offsets = np.cumsum([0, *map(len, lines)])
    return camera.project_lines(np.array(list(chain(*lines)), float).reshape(-1, 3), offsets, **options)


def as_lists(lines: Polylines) -> list[list[list[float]]]:
    return [line.tolist() for line in lines]


def test_points_are_projected():
    points = np.array([[0.0, 0, 1], [1, 2, 10], [-4, 1, 20]])
    assert CAMERA.project(points).tolist() == [[40, 30], [50, 40], [20, 32.5]]


def test_a_line_in_view_keeps_its_vertices_and_direction():
    assert as_lists(project([[1, 2, 10], [-4, 1, 20]])) == [[[50, 40], [20, 32.5]]]
    assert as_lists(project([[-4, 1, 20], [0, 1, 20], [1, 2, 10]])) == [[[20, 32.5], [40, 32.5], [50, 40]]]


def test_labels_are_the_indices_of_the_lines():
    behind = [[0.0, 0, -1], [0, 0, -2]]
    inside = [[0.0, 0, 10], [1, 0, 10]]
    found = project(behind, inside, [], [[0.0, 0, 10]], inside[::-1])
    assert found.labels.tolist() == [1, 4]
    assert as_lists(found) == [[[40, 30], [50, 30]], [[50, 30], [40, 30]]]


def test_nothing_is_behind_the_camera():
    assert len(project([[1, 2, -10], [-4, 1, -20]])) == 0
    assert len(project([[0, 0, 0], [1, 1, 0]])) == 0
    assert len(project()) == 0


def test_a_line_through_the_plane_of_the_camera_is_cut_in_front_of_it():
    # From (0, 1, 8) to (0, 1, -8): it is 2 m away where it is cut, and 1 m below.
    assert as_lists(project([[0, 1, 8], [0, 1, -8]], near=2.0)) == [[[40, 36.25], [40, 55]]]
    assert as_lists(project([[0, 1, -8], [0, 1, 8]], near=2.0)) == [[[40, 55], [40, 36.25]]]
    # 0.1 m away it would be far below the image, whose border it meets at 5 / 3 m.
    ((line,),) = [as_lists(project([[0, 1, 8], [0, 1, -8]]))]
    assert np.allclose(line, [[40, 36.25], [40, 60]])


def test_a_line_that_comes_back_is_two():
    around = [[0, 0.1, 4], [0, 0.1, -4], [0.4, 0.1, -4], [0.4, 0.1, 4]]
    found = project(around, near=1.0)
    assert found.labels.tolist() == [0, 0]
    assert np.allclose(as_lists(found), [[[40, 31.25], [40, 35]], [[80, 35], [50, 31.25]]])


def test_lines_end_at_the_largest_distance():
    line = [[0, 0, 2], [0, 0, 100]]
    assert as_lists(project([[3, 0, 0.5], [3, 0, 100]], max_distance=5.0)) == []
    # A line of constant x = 3 and y = 4 is 13 m away at z = 12.
    camera = Camera((12.0, 12.0), (10.0, 10.0), (100, 100))
    (found,) = project([[3, 4, 100], [3, 4, 6]], camera=camera, max_distance=13.0)
    assert np.allclose(found, [[13, 14], [16, 18]])
    assert len(project(line, max_distance=1.0)) == 0
    # What turns back beyond comes back.
    there = [[-3, 4, 6], [-3, 4, 100], [3, 4, 100], [3, 4, 6]]
    found = project(there, camera=camera, max_distance=13.0)
    assert np.allclose(as_lists(found), [[[4, 18], [7, 14]], [[13, 14], [16, 18]]])


def test_equal_vertices_in_a_row_do_not_cut():
    line = [[0, 0, 10], [0, 0, 10], [1, 0, 10], [1, 0, 10], [2, 1, 10]]
    for options in ({}, {"max_distance": 50.0}):
        assert as_lists(project(line, **options)) == [[[40, 30], [50, 30], [60, 35]]]


@settings(deadline=None)
@given(st.lists(st.tuples(numbers, numbers, numbers), min_size=2, max_size=6), st.floats(0.5, 8))
def test_it_is_what_points_along_the_lines_show(points, reach):
    """The slow twin: many points along the lines, each kept where it is seen, projected one by one."""
    line = np.array(points)
    found = project(line.tolist(), near=0.5, max_distance=reach)
    seen = []
    for start, end in pairwise(line):
        for t in np.linspace(0, 1, 60):
            x, y, z = start + t * (end - start)
            if z >= 0.5 and x * x + y * y + z * z <= reach * reach:
                u, v = 100 * x / z + 40, 50 * y / z + 30
                if 0 <= u <= 80 and 0 <= v <= 60:
                    seen.append((u, v))
    # A point alone, at the border of what is seen or of a segment in the direction of sight, is no line.
    apart = np.array(seen).reshape(-1, 2)
    apart = apart[distance_to_segments(apart, found.endpoints) > 1e-6]
    assert len(np.unique(apart.round(6), axis=0)) < 4
    assert (found.vertices >= 0).all()
    assert (found.vertices <= [80, 60]).all()


@pytest.mark.parametrize("seed", range(30))
def test_the_other_way_round_it_is_the_same_reversed(seed):
    line = np.random.default_rng(seed).normal([0, 0, 2], [1, 1, 3], (8, 3)).tolist()
    there, back = project(line, max_distance=6.0), project(line[::-1], max_distance=6.0)
    assert len(there) == len(back)
    for one, other in zip(as_lists(there), as_lists(back)[::-1], strict=True):
        assert np.allclose(one, other[::-1], atol=1e-6)


@settings(deadline=None)
@given(st.lists(st.floats(-1e4, 1e4), min_size=3, max_size=3), st.integers(0, 2**32 - 1))
def test_lines_that_touch_share_the_vertex_to_the_last_bit(point, seed):
    rng = np.random.default_rng(seed)
    pose = Pose(Rotation.random(rng=rng).as_matrix(), rng.normal(size=3) * 1000)
    others = rng.normal(size=(rng.integers(3, 40), 3)) * 1000
    points = np.concatenate([others[:2], [point], others[2:], [point]])
    moved = pose.to_inner(points)
    assert moved[2].tolist() == moved[-1].tolist()
    assert CAMERA.project(moved)[2].tolist() == CAMERA.project(moved)[-1].tolist()


def test_poses_lead_from_frame_to_frame():
    rng = np.random.default_rng(0)
    outer, inner = (Pose(Rotation.random(rng=rng).as_matrix(), rng.normal(size=3)) for _ in range(2))
    points = rng.normal(size=(7, 3))
    in_outer = (points @ inner.rotation.T + inner.translation) @ outer.rotation.T + outer.translation
    assert np.allclose((outer @ inner).to_inner(in_outer), points)
    assert np.allclose(outer.to_inner(outer.translation[None]), 0)


@given(st.lists(st.floats(-2, 2), min_size=4, max_size=4).filter(lambda q: math.hypot(*q) > 1e-3))
def test_quaternions_are_rotations(quaternion):
    w, x, y, z = quaternion
    assert np.allclose(quaternion_to_matrix(w, x, y, z), Rotation.from_quat([x, y, z, w]).as_matrix())


def test_a_quarter_turn_around_z_leads_from_x_to_y():
    half = math.sqrt(0.5)
    assert np.allclose(quaternion_to_matrix(half, 0.0, 0.0, half) @ [1, 0, 0], [0, 1, 0])


@pytest.mark.parametrize("w", [0.0, float("nan"), float("inf")])
def test_a_quaternion_without_direction_is_named(w):
    with pytest.raises(ValueError, match="is no rotation"):
        quaternion_to_matrix(w, 0.0, 0.0, 0.0)
