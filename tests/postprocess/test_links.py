"""Links are those of a loop that always takes the cheapest pair left."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.postprocess.links import match_nodes, segment_nodes, trace_chains

RULE = (1.5, 0.3, 0.4, 0.6, 0.1, 4.0, 1.0, 3.0)


def cost(a: np.ndarray, b: np.ndarray) -> float:
    """How badly node b continues node a, written down as the rule says it."""
    radius, straight, overlap, beside, slope, lateral_weight, turn_weight, stretch = RULE
    gap, (ua, ub) = b[:2] - a[:2], (a[2:4], b[2:4])
    length, cosine = np.linalg.norm(gap), float(-(ua @ ub))
    if length > radius or cosine < straight or length > stretch * max(a[4], b[4]):
        return math.inf
    way = (ua - ub) / np.linalg.norm(ua - ub)
    middles = (b[:2] - ub * b[4]) - (a[:2] - ua * a[4])
    if gap @ way < -overlap or middles @ way <= 0:
        return math.inf
    lateral = max(abs(gap[0] * u[1] - gap[1] * u[0]) for u in (ua, ub))
    if lateral > beside + slope * length:
        return math.inf
    return abs(float(gap @ way)) + lateral_weight * lateral + turn_weight * (1 - cosine)


def no_extra(i: int, j: int) -> float:
    return 0.0


def match_in_loops(
    nodes: np.ndarray, directed: bool, extra: Callable[[int, int], float] = no_extra
) -> np.ndarray:
    pairs = [
        (cost(nodes[a], nodes[b]) + extra(a // 2, b // 2), a, b)
        for a in range(len(nodes))
        for b in range(a + 1, len(nodes))
        if a ^ b != 1 and not (directed and (a ^ b) % 2 == 0)
    ]
    partners = np.full(len(nodes), -1)
    for value, a, b in sorted(pairs):
        if value < math.inf and partners[a] < 0 and partners[b] < 0:
            partners[a], partners[b] = b, a
    return partners


@settings(deadline=None, max_examples=80)
@given(st.integers(0, 10**6), st.integers(0, 60), st.booleans(), st.floats(1, 8))
def test_matching_takes_the_cheapest_pair_left(seed: int, n: int, directed: bool, extent: float) -> None:
    rng = np.random.default_rng(seed)
    starts, angles = rng.uniform(0, extent, (n, 2)), rng.normal(0, 0.6, n)
    ends = starts + np.stack([np.cos(angles), np.sin(angles)], axis=1) * rng.uniform(0.2, 1.4, (n, 1))
    nodes = segment_nodes(np.stack([starts, ends], axis=1))
    partners, _ = match_nodes(nodes, directed, RULE)
    np.testing.assert_array_equal(partners, match_in_loops(nodes, directed))


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 10**6), st.integers(1, 40), st.booleans())
def test_classes_and_scores_count_in_the_links_where_they_are_asked_to(
    seed: int, n: int, directed: bool
) -> None:
    rng = np.random.default_rng(seed)
    starts, angles = rng.uniform(0, 3, (n, 2)), rng.normal(0, 0.6, n)
    ends = starts + np.stack([np.cos(angles), np.sin(angles)], axis=1) * rng.uniform(0.2, 1.4, (n, 1))
    nodes = segment_nodes(np.stack([starts, ends], axis=1))
    scores, votes = rng.random(n), rng.dirichlet(np.full(3, 0.3), n)
    scores[0] = 0.0

    def extra(i: int, j: int) -> float:
        common = sum(min(p, q) for p, q in zip(votes[i], votes[j], strict=True))
        best = max(scores[i], scores[j])
        return 0.7 * (1 - common) + 0.4 * (1 - min(scores[i], scores[j]) / best if best else 0.0)

    sources = (np.arange(2 * n) // 2, scores, votes)
    partners, _ = match_nodes(nodes, directed, RULE, sources, (0.7, 0.4))
    np.testing.assert_array_equal(partners, match_in_loops(nodes, directed, extra))


def test_equal_costs_are_decided_by_the_nodes() -> None:
    grid = np.stack(np.meshgrid(np.arange(6.0), np.arange(3.0)), axis=-1).reshape(-1, 2)
    nodes = segment_nodes(np.stack([grid, grid + np.array([0.5, 0.0])], axis=1))
    for directed in (True, False):
        partners, _ = match_nodes(nodes, directed, RULE)
        np.testing.assert_array_equal(partners, match_in_loops(nodes, directed))


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 10**6), st.integers(0, 30), st.booleans())
def test_chains_hold_every_item_once_and_follow_the_links(seed: int, n: int, directed: bool) -> None:
    rng = np.random.default_rng(seed)
    partners, costs = np.full(2 * n, -1), np.full(2 * n, np.inf)
    for a in rng.permutation(2 * n)[: int(1.6 * n)]:
        free = [
            b for b in range(2 * n)
            if partners[b] < 0 and b not in (a, a ^ 1) and not (directed and (a ^ b) % 2 == 0)
        ]  # fmt: skip
        if partners[a] < 0 and free:
            b = rng.choice(free)
            partners[a], partners[b] = b, a
            costs[a] = costs[b] = rng.integers(1, 4)
    items, flips, offsets, rings = trace_chains(partners, costs, directed)
    assert sorted(items) == list(range(n))
    for c in range(len(rings)):
        members = range(offsets[c], offsets[c + 1])
        first, last = (
            2 * items[members[0]] + flips[members[0]],
            2 * items[members[-1]] + 1 - flips[members[-1]],
        )
        for p in members[1:]:
            assert partners[2 * items[p] + flips[p]] == 2 * items[p - 1] + 1 - flips[p - 1]
        assert partners[first] == (last if rings[c] else -1)
        if rings[c]:
            assert costs[first] == max(costs[2 * items[p]] for p in members) or not directed
    if directed:
        assert not flips.any()


@pytest.mark.parametrize("directed", [True, False])
def test_nothing_is_linked_where_nothing_is(directed: bool) -> None:
    partners, _ = match_nodes(segment_nodes(np.zeros((0, 2, 2))), directed, RULE)
    assert len(partners) == 0
    partners, _ = match_nodes(segment_nodes(np.zeros((3, 2, 2))), directed, RULE)
    assert partners.tolist() == [-1] * 6
