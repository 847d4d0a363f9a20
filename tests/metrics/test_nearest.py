"""The binned search finds what looking at every sample finds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.metrics.nearest import nearest_samples, pair_samples
from yolino.metrics.samples import Samples


def cloud(rng: np.random.Generator, n: int, extent: float = 100.0, offset: float = 0.0) -> Samples:
    angles = rng.uniform(-np.pi, np.pi, n)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points = offset + rng.uniform(0, extent, (n, 2))
    return Samples(points, directions, rng.integers(0, 3, n), np.arange(n))


def at(points: list, angles: list, labels: list | None = None) -> Samples:
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    n = len(points)
    return Samples(np.array(points, float), directions, np.array(labels or [0] * n), np.arange(n))


def look_at_all(queries: Samples, samples: Samples, radius: float, angle: float, directed: bool) -> tuple:
    nearest, distances = np.full(len(queries), -1), np.full(len(queries), np.inf)
    courses, angles = queries.angles, samples.angles
    for q in range(len(queries)):
        for i in range(len(samples)):
            turn = abs(courses[q] - angles[i])
            turn = min(turn, 2 * np.pi - turn)
            if not directed:
                turn = min(turn, np.pi - turn)
            distance = math.dist(queries.points[q], samples.points[i])
            if turn <= angle and distance <= radius and distance < distances[q]:
                nearest[q], distances[q] = i, distance
    return nearest, distances


@pytest.mark.parametrize("directed", [True, False])
@pytest.mark.parametrize("angle", [0.2, np.pi / 4, np.pi / 2, np.pi])
@pytest.mark.parametrize("radius", [0.05, 3.0, 20.0, 1000.0])
def test_search_equals_looking_at_all(radius: float, angle: float, directed: bool) -> None:
    rng = np.random.default_rng(int(radius * 100) + int(angle * 10))
    queries, samples = cloud(rng, 60, 130, -15), cloud(rng, 80)
    found = nearest_samples(queries, samples, radius, angle, directed=directed)
    expected = look_at_all(queries, samples, radius, angle, directed)
    np.testing.assert_array_equal(found[0], expected[0])
    np.testing.assert_allclose(found[1], expected[1])


@settings(deadline=None)
@given(st.integers(0, 10_000), st.integers(0, 12), st.integers(0, 12), st.floats(1e-3, 500))
def test_search_equals_looking_at_all_in_few_and_spread_samples(
    seed: int, n: int, m: int, radius: float
) -> None:
    rng = np.random.default_rng(seed)
    queries, samples = cloud(rng, m, 300), cloud(rng, n, 300)
    found = nearest_samples(queries, samples, radius, 2.0, directed=True)
    np.testing.assert_array_equal(found[0], look_at_all(queries, samples, radius, 2.0, True)[0])


def look_at_all_with_ties(queries: Samples, samples: Samples, radius: float, directed: bool) -> list[int]:
    """The definition with its rules for equally close samples, for angles of multiples of 45 degrees."""
    nearest = []
    for point, direction in zip(queries.points, queries.directions, strict=True):
        back = not directed and tuple(direction) < (0, 0)
        ux, uy = -direction if back else direction
        candidates = []
        for i in range(len(samples)):
            dx, dy = samples.points[i] - point
            dot = samples.directions[i] @ [ux, uy]
            if dx * dx + dy * dy <= radius * radius and (dot if directed else abs(dot)) > 0.5:
                ahead, right = dx * ux + dy * uy, dy * ux - dx * uy
                places = dx * dx + dy * dy, -round(ahead, 6), -round(right, 6)
                candidates.append((*places, int(samples.labels[i]), i))
        nearest.append(min(candidates)[-1] if candidates else -1)
    return nearest


@pytest.mark.parametrize("directed", [True, False])
@pytest.mark.parametrize("radius", [1.0, 3.0, 30.0])
def test_search_equals_looking_at_all_where_many_are_equally_close(radius: float, directed: bool) -> None:
    rng = np.random.default_rng(int(radius))
    for _ in range(5):
        sides = []
        for n in (70, 90):
            turns = rng.integers(-3, 4, n) * math.pi / 4
            sides.append(
                at(rng.integers(0, 16, (n, 2)).tolist(), turns.tolist(), rng.integers(0, 3, n).tolist())
            )
        found, _ = nearest_samples(*sides, radius, math.pi / 4 + 0.01, directed=directed)
        assert found.tolist() == look_at_all_with_ties(*sides, radius, directed)


@pytest.mark.parametrize("radius", [2.0, 12.0, 200.0])
@pytest.mark.parametrize("extent", [5.0, 100.0, 2000.0])
def test_the_answer_to_a_query_does_not_depend_on_the_query_before(radius: float, extent: float) -> None:
    rng = np.random.default_rng(int(radius + extent))
    # Walks, so that neighbors follow each other, beside samples of which some are far outside.
    walk = np.cumsum(rng.normal(0, 1.0, (60, 2)), axis=0) + extent / 2
    angles = np.cumsum(rng.normal(0, 0.3, 60))
    queries, samples = at(walk.tolist(), angles.tolist()), cloud(rng, 100, extent)
    found = nearest_samples(queries, samples, radius, 0.8, directed=True)
    np.testing.assert_array_equal(found[0], look_at_all(queries, samples, radius, 0.8, True)[0])
    order = rng.permutation(60)
    shuffled = nearest_samples(queries[order], samples, radius, 0.8, directed=True)
    np.testing.assert_array_equal(shuffled[0], found[0][order])
    np.testing.assert_array_equal(shuffled[1], found[1][order])


def test_angles_are_circular() -> None:
    query = at([[0, 0]], [math.radians(179)])
    assert nearest_samples(query, at([[1, 0]], [math.radians(-179)]), 5.0, 0.1, directed=True)[0] == [0]
    assert nearest_samples(query, at([[1, 0]], [math.radians(-1)]), 5.0, 0.1, directed=True)[0] == [-1]
    assert nearest_samples(query, at([[1, 0]], [math.radians(1)]), 5.0, 0.1, directed=False)[0] == [0]


def test_both_radii_are_inclusive() -> None:
    query = at([[0, 0]], [0.0])
    for degrees, expected in ((45, 0), (-45, 0), (45.01, -1), (315, 0)):
        sample = at([[3, 4]], [math.radians(degrees)])
        assert nearest_samples(query, sample, 5.0, np.pi / 4, directed=True)[0] == [expected]
    assert nearest_samples(query, at([[3, 4.01]], [0.0]), 5.0, 1.0, directed=True)[0] == [-1]


def test_the_radius_is_a_disc_and_not_a_box() -> None:
    assert nearest_samples(at([[0, 0]], [0.0]), at([[4, 4]], [0.0]), 5.0, 1.0, directed=True)[0] == [-1]


def test_the_closest_within_the_angle_wins_over_a_closer_one_across() -> None:
    samples = at([[0.1, 0], [2, 0]], [np.pi / 2, 0.1])
    nearest, distances = nearest_samples(at([[0, 0]], [0.0]), samples, 5.0, np.pi / 4, directed=True)
    assert nearest == [1]
    assert distances == [2.0]


def test_of_equally_close_ones_the_one_ahead_then_the_one_to_the_right_then_the_lower_label_is_taken() -> (
    None
):
    query = at([[10, 10]], [0.0])
    ahead = at([[9, 10], [11, 10]], [0.0, 0.0])
    right = at([[10, 9], [10, 11]], [0.0, 0.0])
    label = at([[10, 9], [10, 9]], [0.1, 0.2], [5, 3])
    for samples in (ahead, right, label):
        assert nearest_samples(query, samples, 5.0, 1.0, directed=True)[0] == [1]
        assert nearest_samples(query, samples[np.array([1, 0])], 5.0, 1.0, directed=True)[0] == [0]


def test_undirected_queries_do_not_change_with_their_sense() -> None:
    samples = at([[9, 10], [11, 10], [10, 9], [10, 11]], [0.0] * 4)
    nearest = [
        nearest_samples(at([[10, 10]], [a]), samples, 5.0, 1.0, directed=False)[0] for a in (0.0, np.pi)
    ]
    assert nearest[0] == nearest[1]


def test_memory_is_linear_in_the_samples() -> None:
    corners = at([[0, 0], [1e9, 1e9]], [0.0, 0.0])
    assert nearest_samples(corners, corners, 1.0, 1.0, directed=True)[0].tolist() == [0, 1]


def test_each_sample_is_paired_with_the_nearest_of_its_queries() -> None:
    nearest = np.array([2, 0, -1, 2, 2, 0])
    distances = np.array([3.0, 1.0, np.inf, 2.0, 2.0, 1.0])
    labels = np.array([0, 1, 0, 7, 4, 1])
    assert pair_samples(nearest, distances, labels, 3).tolist() == [1, 4]
