"""Loose ends meet the line that a loop over all pieces finds."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.postprocess.hosts import find_hosts
from yolino.postprocess.traces import arc_lengths

RADIUS, REACH = 0.75, 2.0
Rule = tuple[float, float, float]


def as_lines(parts: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    starts = np.cumsum([0, *(len(part) for part in parts)])
    points = np.concatenate(parts)
    return points, arc_lengths(points, starts), starts


def meet(line: np.ndarray, end: int, other: np.ndarray, directed: bool, rule: Rule) -> tuple[float, float]:
    """Gives cost and arc length at which an end of a line meets another, written down as it is meant."""
    radius, reach, straight = rule
    chain = line if end else line[::-1]  # outwards
    back, walked = len(chain) - 1, 0.0
    while back > 0 and walked < 1.5:
        walked += float(np.linalg.norm(chain[back] - chain[back - 1]))
        back -= 1
    tip, way = chain[-1], (chain[-1] - chain[back]) / np.linalg.norm(chain[-1] - chain[back])
    best, arc = (math.inf, 0.0), 0.0
    total = float(np.linalg.norm(np.diff(other, axis=0), axis=1).sum())
    for a, b in pairwise(other):
        length = float(np.linalg.norm(b - a))
        unit = (b - a) / length
        cosine, sine = float(way @ unit), float(way[0] * unit[1] - way[1] * unit[0])
        onward = cosine if end else -cosine
        allowed = (onward if directed else abs(onward)) >= straight
        along, beside = float((tip - a) @ unit), float((tip - a)[0] * unit[1] - (tip - a)[1] * unit[0])
        foot = min(max(along, 0.0), length)
        distance = float(np.linalg.norm(tip - (a + foot * unit)))
        lead, cost = 0.0, distance
        if distance <= radius:
            if beside * sine < 0:
                lead = min(abs(beside) * abs(cosine) / max(abs(sine), 1e-9), 1.5)
            elif abs(cosine) > 0.9:
                lead = min(2 * abs(beside), 1.5)
        else:
            ahead = -beside / sine if sine else math.inf
            foot = along + ahead * cosine
            allowed &= abs(sine) >= 0.35 and 0 < ahead <= reach and -0.25 <= foot <= length + 0.25
            foot, cost = min(max(foot, 0.0), length), ahead
        if allowed:
            place = min(max(arc + foot + math.copysign(lead, cosine), 0.0), total)
            best = min(best, (cost + 0.5 * (1 - (onward if directed else abs(cosine))), place))
        arc += length
    return best


@settings(deadline=None, max_examples=80)
@given(
    seed=st.integers(0, 10**6), count=st.integers(2, 5), directed=st.booleans(), straight=st.floats(-0.2, 0.7)
)
def test_ends_meet_the_nearest_line_of_all(seed: int, count: int, directed: bool, straight: float) -> None:
    rng = np.random.default_rng(seed)
    parts = []
    for _ in range(count):
        turns = rng.uniform(-np.pi, np.pi) + np.cumsum(rng.normal(0, 0.3, rng.integers(1, 9)))
        steps = np.stack([np.cos(turns), np.sin(turns)], axis=1) * rng.uniform(0.4, 3, (len(turns), 1))
        parts.append(np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)]) + rng.uniform(0, 6, 2))
    rule = (RADIUS, REACH, straight if directed else 0.0)
    loose, alive = rng.random(2 * count) < 0.8, rng.random(count) < 0.9
    hosts, places = find_hosts(as_lines(parts), loose, alive, directed, rule)
    for end in range(2 * count):
        found = [
            (*meet(parts[end // 2], end % 2, part, directed, rule), c)
            for c, part in enumerate(parts)
            if alive[c] and c != end // 2 and loose[end]
        ]
        cost, place, host = min(found, default=(math.inf, 0.0, -1))
        if hosts[end] == end // 2:  # its own line: beyond four radii
            length = arc_lengths(parts[end // 2], np.array([0, len(parts[end // 2])]))[-1]
            assert abs(places[end] - (length if end % 2 else 0.0)) > 4 * RADIUS - 1.6
        else:
            assert hosts[end] == (host if cost < math.inf else -1) or loose[end]
            if cost < math.inf and hosts[end] == host:
                assert places[end] == pytest.approx(place, abs=1e-9)
            elif cost < math.inf:
                assert hosts[end] == -1, (end, hosts[end], host)
                raise AssertionError(f"end {end} met nothing, but line {host} costs {cost}")


BAR = np.array([[0.0, 0.0], [4.0, 0.0], [10.0, 0.0]])


@pytest.mark.parametrize(
    ("line", "directed", "expected"),
    [
        ([(6.0, 3.0), (6.0, 0.5)], False, 6.0),  # ends half a cell before its side
        ([(6.0, 3.0), (6.0, 0.5)], True, None),  # a right angle is too much of a turn
        ([(6.0, 4.0), (6.0, 1.5)], False, 6.0),  # its direction leads there
        ([(6.0, 4.0), (6.0, 2.5)], False, None),  # too far
        ([(2.0, 2.5), (4.0, 0.5)], True, 4.5),  # runs into it at 45 degrees
        ([(8.0, 2.5), (6.0, 0.5)], True, None),  # against its direction
        ([(8.0, 2.5), (6.0, 0.5)], False, 5.5),
        ([(1.0, 0.3), (5.0, 0.3)], True, 5.6),  # runs along it
    ],
)
def test_an_end_meets_a_line(line: list[tuple[float, float]], directed: bool, expected: float | None) -> None:
    lines = as_lines([BAR, np.array(line)])
    loose = np.array([False, False, False, True])
    rule = (RADIUS, REACH, 0.5 if directed else 0.0)
    hosts, places = find_hosts(lines, loose, np.ones(2, bool), directed, rule)
    assert hosts.tolist() == [-1, -1, -1, -1 if expected is None else 0]
    if expected is not None:
        assert places[3] == pytest.approx(expected)
