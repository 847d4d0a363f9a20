"""The NMS merges what says the same, as a literal loop over clusters does, and nothing else."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.cluster import DBSCAN

from yolino.postprocess import NMS
from yolino.postprocess.nms import nms_coordinates
from yolino.types import Segments


def at(angle_degrees: float, x: float = 50.0, y: float = 50.0, length: float = 16.0) -> list:
    """Gives a segment through (x, y)."""
    a = np.radians(angle_degrees)
    way = np.array([np.cos(a), np.sin(a)]) * length / 2
    return [[x - way[0], y - way[1]], [x + way[0], y + way[1]]]


def angles(segments: Segments) -> np.ndarray:
    delta = segments.ends - segments.starts
    return np.degrees(np.arctan2(delta[:, 1], delta[:, 0]))


def merge_in_loops(segments: Segments, cell_size: float, *, weighted: bool, power: float) -> Segments:
    """The NMS as one would write it down: cluster by cluster, with numpy's averages."""
    delta = (segments.ends - segments.starts) / cell_size
    lengths = np.linalg.norm(delta, axis=1)
    middles = (segments.ends + segments.starts) / 2 / cell_size
    coordinates = np.column_stack([0.1 * middles, 0.013 * lengths, 0.05 * delta / lengths[:, None]])
    weights = segments.scores**power
    labels = (
        DBSCAN(eps=0.02, min_samples=2).fit(coordinates, sample_weight=weights if weighted else None).labels_
    )
    parts, rows, scores, classes = [], [], [], []
    for label in range(labels.max(initial=-1) + 1):
        members = np.flatnonzero(labels == label)
        best = members[segments.scores[members].argmax()]
        against = coordinates[members, 3:] @ coordinates[best, 3:] < 0
        parts += [part for part in (members[~against], members[against]) if len(part)]
    for part in sorted(parts, key=lambda members: members[0]):
        mean = np.average(coordinates[part], axis=0, weights=weights[part])
        middle, way = mean[:2] / 0.1, mean[3:] / np.linalg.norm(mean[3:]) * mean[2] / 0.013 / 2
        rows.append(np.stack([middle - way, middle + way]) * cell_size)
        scores.append(segments.scores[part].max())
        votes = np.bincount(segments.labels[part], weights[part])
        classes.append(votes.argmax())
    alone = labels == -1
    return Segments(
        np.concatenate([np.reshape(rows, (-1, 2, 2)), segments.endpoints[alone]]),
        np.concatenate([scores, segments.scores[alone]]),
        np.concatenate([np.array(classes, int), segments.labels[alone]]),
    )


def test_coordinates_of_a_segment_by_hand() -> None:
    segment = Segments([[[16.0, 32.0], [16.0 + 24.0, 32.0 - 32.0]]])  # 40 px long
    coordinates = nms_coordinates(segment, 16.0)
    np.testing.assert_allclose(coordinates, [[0.1 * 1.75, 0.1 * 1.0, 0.013 * 2.5, 0.05 * 0.6, 0.05 * -0.8]])
    undirected = nms_coordinates(segment, 16.0, directed=False)
    np.testing.assert_allclose(undirected[0, 3:], [0.025 * (0.36 - 0.64), 0.025 * 2 * 0.6 * -0.8])
    backwards = segment.with_endpoints(segment.endpoints[:, ::-1].copy())
    np.testing.assert_allclose(nms_coordinates(backwards, 16.0, directed=False), undirected)
    np.testing.assert_allclose(nms_coordinates(backwards, 16.0)[0, 3:], -coordinates[0, 3:])


@pytest.mark.parametrize("cell", [8.0, 16.0, 32.0])
@pytest.mark.parametrize("directed", [True, False])
def test_what_reaches_the_radius_is_the_same_at_every_stride(cell: float, directed: bool) -> None:
    nms = NMS(cell, directed=directed)
    for offset, count in ((0.19, 1), (0.21, 2)):
        pair = Segments([at(30, 0, 0, cell), at(30, offset * cell, 0, cell)])
        assert len(nms(pair)) == count
    for turn, count in ((22.5, 1), (24.5, 2)):
        assert len(nms(Segments([at(100, 0, 0, cell), at(100 + turn, 0, 0, cell)]))) == count
    for stretch, count in ((1.5, 1), (1.6, 2)):
        assert len(nms(Segments([at(5, 0, 0, cell), at(5, 0, 0, (1 + stretch) * cell)]))) == count


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 10**6), st.integers(1, 200), st.booleans(), st.sampled_from([0.0, 1.0, 2.5, 10.0]))
def test_merging_equals_a_loop_over_the_clusters_of_sklearn(
    noisy: Callable[[int, int], Segments], seed: int, n: int, weighted: bool, power: float
) -> None:
    segments = noisy(seed, n)
    merged = NMS(16.0, weighted=weighted, score_power=power)(segments)
    expected = merge_in_loops(segments, 16.0, weighted=weighted, power=power)
    np.testing.assert_allclose(merged.endpoints, expected.endpoints, atol=1e-8)
    np.testing.assert_array_equal(merged.scores, expected.scores)
    np.testing.assert_array_equal(merged.labels, expected.labels)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10**6), st.integers(1, 150), st.booleans())
def test_the_order_of_the_segments_does_not_matter(
    noisy: Callable[[int, int], Segments], seed: int, n: int, directed: bool
) -> None:
    segments, nms = noisy(seed, n), NMS(16.0, directed=directed)
    a, b = nms(segments), nms(segments[np.random.default_rng(seed).permutation(n)])
    keys = [np.lexsort(np.round(s.endpoints, 6).reshape(-1, 4).T) for s in (a, b)]
    np.testing.assert_allclose(a.endpoints[keys[0]], b.endpoints[keys[1]], atol=1e-6)
    np.testing.assert_array_equal(a.labels[keys[0]], b.labels[keys[1]])


def test_clusters_are_those_of_sklearn_in_nms_coordinates(noisy: Callable[[int, int], Segments]) -> None:
    segments = noisy(3, 300)
    coordinates = nms_coordinates(segments, 16.0)
    weights = segments.scores**10
    for weighted in (False, True):
        fit = DBSCAN(eps=0.02, min_samples=2).fit(coordinates, sample_weight=weights if weighted else None)
        np.testing.assert_array_equal(NMS(16.0, weighted=weighted).clusters(segments), fit.labels_)


def test_the_better_segment_counts_more_and_the_score_is_the_best() -> None:
    merged = NMS(16.0)(Segments([at(0, 50), at(0, 52)], [1.0, 0.5]))
    share = 0.5**10 / (1 + 0.5**10)
    np.testing.assert_allclose(merged.endpoints, [at(0, 50 + 2 * share)])
    assert merged.scores.tolist() == [1.0]


def test_class_probabilities_are_averaged_with_the_same_weights() -> None:
    pair = Segments([at(0, 50), at(0, 51)], [1.0, 0.8], probabilities=[[0.6, 0.4], [0.1, 0.9]])
    merged = NMS(16.0, score_power=1.0)(pair)
    np.testing.assert_allclose(merged.probabilities, [[(0.6 + 0.08) / 1.8, (0.4 + 0.72) / 1.8]])
    assert merged.labels.tolist() == [1]
    assert NMS(16.0)(pair).labels.tolist() == [0]


def test_labels_without_probabilities_vote_with_the_same_weights() -> None:
    segments = Segments([at(0, 50), at(0, 51), at(0, 52), at(90, 200)], [0.9, 0.5, 0.5, 1.0], [7, -2, -2, 4])
    assert NMS(16.0)(segments).labels.tolist() == [7, 4]
    assert NMS(16.0, score_power=0.0)(segments).labels.tolist() == [-2, 4]


def test_segments_in_no_cluster_are_kept_as_they_are_or_dropped(
    noisy: Callable[[int, int], Segments],
) -> None:
    segments = noisy(1, 60)
    alone = NMS(16.0).clusters(segments) == -1
    assert alone.any()
    kept, dropped = NMS(16.0)(segments), NMS(16.0, keep_singletons=False)(segments)
    assert len(kept) - len(dropped) == alone.sum()
    np.testing.assert_array_equal(kept.endpoints[len(dropped) :], segments.endpoints[alone])
    np.testing.assert_array_equal(kept.scores[len(dropped) :], segments.scores[alone])


def test_with_the_papers_weights_two_segments_of_099_are_noise() -> None:
    pair = Segments([at(0), at(0)], [0.99, 0.99])
    assert len(NMS(16.0)(pair)) == 1
    assert len(NMS(16.0, weighted=True)(pair)) == 2
    assert len(NMS(16.0, weighted=True)(Segments([at(0)] * 3, [0.99] * 3))) == 1


def test_opposite_directions_in_one_place_stay_two() -> None:
    both = Segments([at(20), at(20), at(200), at(200)])
    assert sorted(np.round(angles(NMS(16.0)(both)))) == [-160, 20]
    assert np.round(angles(NMS(16.0, directed=False)(both))).tolist() == [20]


def test_opposite_directions_are_not_averaged_even_where_others_connect_them() -> None:
    fan = Segments([at(20.0 * i) for i in range(18)])
    nms = NMS(16.0)
    assert nms.clusters(fan).max() == 0
    merged = nms(fan)
    assert len(merged) == 2
    np.testing.assert_allclose(merged.lengths, 16.0)
    turns = np.radians(angles(fan)[:, None] - angles(merged))
    assert (np.cos(turns).max(axis=1) > 0).all()


@pytest.mark.parametrize("angle", [0.0, 45.0, 89.0, 91.0, 135.0, 179.0])
def test_undirected_segments_are_averaged_across_the_wrap_around(angle: float) -> None:
    segments = Segments([at(angle - 8), at(angle + 8 + 180)])
    merged = NMS(16.0, directed=False)(segments)
    assert len(merged) == 1
    np.testing.assert_allclose(merged.lengths, 16.0)
    np.testing.assert_allclose((angles(merged) - angle + 90) % 180 - 90, 0, atol=1e-6)
    assert (merged.ends - merged.starts)[0, 0] >= 0


def test_undirected_stars_keep_their_length() -> None:
    star = Segments([at(20.0 * i) for i in range(9)])
    np.testing.assert_allclose(NMS(16.0, directed=False)(star).lengths, 16.0)


def test_segments_without_length_and_scores_of_zero() -> None:
    points = Segments([[[8.0, 8.0], [8.0, 8.0]], [[9.0, 8.0], [9.0, 8.0]]], [0.0, 0.0])
    np.testing.assert_allclose(NMS(16.0)(points).endpoints, [[[8.5, 8.0], [8.5, 8.0]]])


def test_weights_do_not_vanish_with_tiny_scores() -> None:
    merged = NMS(16.0)(Segments([at(0, 50), at(0, 52)], [1e-40, 1e-40]))
    np.testing.assert_allclose(merged.endpoints, [at(0, 51)])


def test_empty_input_gives_empty_output() -> None:
    assert len(NMS(16.0)(Segments([]))) == 0
    assert len(NMS(16.0, keep_singletons=False)(Segments([at(0)]))) == 0


def test_the_memory_layout_of_the_input_does_not_matter(noisy: Callable[[int, int], Segments]) -> None:
    segments = noisy(5, 80)
    strided = np.asfortranarray(np.concatenate([segments.endpoints, segments.endpoints]))[:80]
    scores = segments.scores.copy()
    scores.flags.writeable = False
    other = Segments(strided, scores, segments.labels)
    np.testing.assert_array_equal(NMS(16.0)(other).endpoints, NMS(16.0)(segments).endpoints)


def test_input_is_left_as_it_is(noisy: Callable[[int, int], Segments]) -> None:
    segments = noisy(5, 80)
    before = segments.endpoints.copy(), segments.scores.copy()
    NMS(16.0)(segments)
    np.testing.assert_array_equal(segments.endpoints, before[0])
    np.testing.assert_array_equal(segments.scores, before[1])


@pytest.mark.parametrize(
    ("endpoints", "scores", "message"),
    [
        ([at(np.nan)], [1.0], "NaN or infinity"),
        ([[[0.0, 0.0], [0.0, np.inf]]], [1.0], "NaN or infinity"),
        ([at(0)], [np.nan], "NaN or infinity"),
        ([at(0)], [-0.1], "at least 0"),
        ([at(0), at(0, 1e300)], [1.0, 1.0], "radii apart"),
    ],
)
def test_bad_segments_are_named(endpoints: list, scores: list, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        NMS(16.0)(Segments(endpoints, scores))


@pytest.mark.parametrize(
    "arguments",
    [
        {"cell_size": 0.0},
        {"epsilon": -1.0},
        {"min_samples": 0},
        {"midpoint_weight": np.inf},
        {"score_power": -1.0},
    ],
)
def test_bad_parameters_are_named(arguments: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=f"{next(iter(arguments))} is .* is needed"):
        NMS(**{"cell_size": 16.0, **arguments})
