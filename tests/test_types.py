from __future__ import annotations

import dataclasses
import subprocess
import sys

import numpy as np
import pytest

from yolino.types import CellSegments, Polylines, Segments

ENDS = [[[0, 0], [3, 4]], [[1, 1], [1, 3]], [[5, 5], [5, 5]]]


def test_segments_fill_in_scores_and_labels():
    segments = Segments(ENDS)
    assert len(segments) == 3
    assert segments.scores.tolist() == [1, 1, 1]
    assert segments.labels.tolist() == [0, 0, 0]
    assert segments.probabilities is None
    assert segments.lengths.tolist() == [5, 2, 0]
    assert segments.midpoints.tolist() == [[1.5, 2], [1, 2], [5, 5]]
    assert segments.starts.tolist() == [[0, 0], [1, 1], [5, 5]]
    assert segments.ends.tolist() == [[3, 4], [1, 3], [5, 5]]


def test_segments_take_their_labels_from_the_probabilities():
    segments = Segments(ENDS, probabilities=[[0.1, 0.9], [0.8, 0.2], [0.4, 0.6]])
    assert segments.labels.tolist() == [1, 0, 1]
    assert Segments(ENDS, labels=[0, 0, 0], probabilities=[[0, 1]] * 3).labels.tolist() == [0, 0, 0]


@pytest.mark.parametrize("index", [np.array([True, False, True]), np.array([0, 2]), slice(None, None, 2)])
def test_segments_are_indexed_to_segments(index):
    segments = Segments(ENDS, [0.1, 0.2, 0.3], [4, 5, 6], [[0.1, 0.9], [0.8, 0.2], [0.4, 0.6]])
    found = segments[index]
    assert isinstance(found, Segments)
    assert found.scores.tolist() == [0.1, 0.3]
    assert found.labels.tolist() == [4, 6]
    assert found.probabilities.tolist() == [[0.1, 0.9], [0.4, 0.6]]
    assert found.endpoints.tolist() == [ENDS[0], ENDS[2]]


def test_no_segments_keep_their_shapes():
    empty = Segments(ENDS, probabilities=np.ones((3, 7)))[:0]
    assert len(empty) == 0
    assert empty.endpoints.shape == (0, 2, 2)
    assert empty.probabilities.shape == (0, 7)
    assert Segments([]).lengths.shape == (0,)


@pytest.mark.parametrize(
    "arguments",
    [
        ([[0, 0, 1, 1]],),
        (ENDS, [1.0]),
        (ENDS, None, [1, 2]),
        (ENDS, None, None, [[1.0]]),
        (ENDS, None, None, [1.0, 1.0, 1.0]),
    ],
)
def test_segments_name_a_wrong_shape(arguments):
    with pytest.raises(ValueError, match="has"):
        Segments(*arguments)


def test_values_are_frozen():
    for value, name in ((Segments(ENDS), "scores"), (Polylines.from_list([]), "labels")):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(value, name, np.zeros(0))


def test_polylines_know_their_pieces_and_owners():
    polylines = Polylines.from_list([[[0, 0], [3, 4], [3, 5]], [], [[9, 9]], [[1, 1], [1, 3]]])
    assert len(polylines) == 4
    assert polylines.offsets.tolist() == [0, 3, 3, 4, 6]
    assert polylines.endpoints.tolist() == [[[0, 0], [3, 4]], [[3, 4], [3, 5]], [[1, 1], [1, 3]]]
    assert polylines.owners.tolist() == [0, 0, 3]
    assert polylines.lengths.tolist() == [6, 0, 0, 2]
    assert [p.tolist() for p in polylines] == [[[0, 0], [3, 4], [3, 5]], [], [[9, 9]], [[1, 1], [1, 3]]]


@pytest.mark.parametrize("index", [np.array([False, True, True]), np.array([1, 2]), slice(1, None)])
def test_polylines_are_indexed_to_polylines(index):
    polylines = Polylines.from_list(
        [[[0, 0], [1, 1]], [[2, 2]], [[3, 3], [4, 4]]], [0.1, 0.2, 0.3], [1, 2, 3]
    )
    found = polylines[index]
    assert [p.tolist() for p in found] == [[[2, 2]], [[3, 3], [4, 4]]]
    assert found.scores.tolist() == [0.2, 0.3]
    assert found.labels.tolist() == [2, 3]


def test_polylines_can_be_reordered_and_repeated():
    polylines = Polylines.from_list([[[0, 0], [1, 1]], [[2, 2]]])
    assert [p.tolist() for p in polylines[np.array([1, 0, 1])]] == [[[2, 2]], [[0, 0], [1, 1]], [[2, 2]]]


def test_polylines_may_have_class_probabilities():
    lines = [[[0, 0], [1, 1]], [[2, 2], [3, 3]], []]
    shares = [[0.1, 0.9], [0.8, 0.2], [0.5, 0.5]]
    polylines = Polylines(np.ones((4, 2)), [0, 2, 4, 4], probabilities=shares)
    assert polylines.labels.tolist() == [1, 0, 0]
    assert polylines[np.array([1, 0])].probabilities.tolist() == [shares[1], shares[0]]
    assert polylines[polylines.labels == 1].probabilities.tolist() == [shares[0]]
    assert polylines.with_vertices(polylines.vertices + 1).probabilities.tolist() == shares
    assert Polylines.from_list(lines).probabilities is None
    with pytest.raises(ValueError, match="2 rows, but there are 3 polylines"):
        Polylines(np.ones((4, 2)), [0, 2, 4, 4], probabilities=shares[:2])


def test_no_polylines():
    empty = Polylines.from_list([])
    assert len(empty) == 0
    assert list(empty) == []
    assert empty.endpoints.shape == (0, 2, 2)
    assert empty.lengths.shape == (0,)
    assert len(empty[np.zeros(0, np.bool_)]) == 0
    assert len(Polylines(np.zeros((0, 2)))) == 0


@pytest.mark.parametrize("offsets", [[1, 3], [0, 2], [0, 2, 1, 3], []])
def test_polylines_name_wrong_offsets(offsets):
    with pytest.raises(ValueError, match="offsets"):
        Polylines([[0, 0], [1, 1], [2, 2]], offsets)


def test_moved_values_keep_scores_and_labels():
    polylines = Polylines.from_list([[[0, 0], [1, 1]]], [0.5], [3])
    moved = polylines.with_vertices(polylines.vertices + 1)
    assert moved.vertices.tolist() == [[1, 1], [2, 2]]
    assert (moved.scores.tolist(), moved.labels.tolist()) == ([0.5], [3])
    segments = Segments(ENDS, labels=[1, 2, 3])
    assert segments.with_endpoints(segments.endpoints * 2).labels.tolist() == [1, 2, 3]


def test_cell_segments_are_indexed_to_cell_segments():
    cells = CellSegments(np.array([[0, 1], [2, 3]]), np.zeros((2, 2, 2)), np.array([4, 5]), np.array([6, 7]))
    found = cells[np.array([False, True])]
    assert (found.cells.tolist(), found.labels.tolist(), found.owners.tolist()) == ([[2, 3]], [5], [7])


def test_the_values_and_the_grid_need_no_torch():
    code = "import sys, yolino, yolino.types, yolino.geometry, yolino.grid; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_moved_values_have_as_many_rows():
    with pytest.raises(ValueError, match="endpoints has 1 rows, but there are 3 segments"):
        Segments(ENDS).with_endpoints(np.zeros((1, 2, 2)))
    with pytest.raises(ValueError, match="vertices has 1 rows, but there are 2 vertices"):
        Polylines.from_list([[(0, 0), (1, 1)]]).with_vertices(np.zeros((1, 2)))


def test_trusted_arrays_are_taken_as_they_are():
    given = Segments(ENDS, [0.1, 0.2, 0.3], [4, 5, 6], [[0.1, 0.9], [0.8, 0.2], [0.4, 0.6]])
    segments = Segments.trusted(given.endpoints, given.scores, given.labels, given.probabilities)
    assert vars(segments) == vars(given)
    lines = Polylines.from_list([[(0, 0), (1, 1)], [(2, 2), (3, 3), (4, 4)]], [0.1, 0.2], [1, 2])
    twin = Polylines.trusted(lines.vertices, lines.offsets, lines.scores, lines.labels, lines.probabilities)
    assert all(vars(twin)[name] is array for name, array in vars(lines).items())
