"""The kernels of the NMS: segments to NMS coordinates, clusters to averaged segments."""

from __future__ import annotations

import math
from typing import no_type_check

import numpy as np

from yolino.compiled import compiled
from yolino.postprocess.clustering import MAX_SPREAD, cluster_neighbors

# The kernels take plain arrays; no_type_check keeps runtime type checkers from wrapping what numba compiles.


@compiled
@no_type_check
def measure(endpoints, scales, directed):
    """Gives midpoint, length and unit direction of each segment, and times `scales`: its NMS coordinates.

    Where undirected, the direction is that of twice the angle. Without length it is zero.
    """
    n = len(endpoints)
    measures, points = np.empty((n, 5)), np.empty((n, 5))
    midpoint, stretch, turn = scales
    for i in range(n):
        dx, dy = endpoints[i, 1, 0] - endpoints[i, 0, 0], endpoints[i, 1, 1] - endpoints[i, 0, 1]
        length = np.sqrt(dx * dx + dy * dy)
        shrink = 1 / length if length > 0 else 0.0
        dx, dy = dx * shrink, dy * shrink
        if not directed:
            dx, dy = dx * dx - dy * dy, 2 * dx * dy
        x, y = (endpoints[i, 0, 0] + endpoints[i, 1, 0]) / 2, (endpoints[i, 0, 1] + endpoints[i, 1, 1]) / 2
        measures[i, 0], measures[i, 1], measures[i, 2], measures[i, 3], measures[i, 4] = x, y, length, dx, dy
        points[i, 0], points[i, 1], points[i, 2] = x * midpoint, y * midpoint, length * stretch
        points[i, 3], points[i, 4] = dx * turn, dy * turn
    return measures, points


@compiled
@no_type_check
def powers(scores, exponent):
    """Gives `scores ** exponent`."""
    result = np.empty(len(scores))
    for i in range(len(scores)):
        result[i] = _power(scores[i], exponent)
    return result


@compiled
@no_type_check
def _power(base, exponent):
    """Gives `base ** exponent`, by squaring where the exponent is a small integer."""
    left = np.int64(exponent)
    if left != exponent or left > 64:
        return base**exponent
    result = 1.0
    while left > 0:
        if left & 1:
            result *= base
        base *= base
        left >>= 1
    return result


@compiled
@no_type_check
def suppress(endpoints, scores, labels, probabilities, settings):
    """Gives the same of the merged segments, and whether labels of one cluster differ.

    Probabilities without columns are none. The settings are the scales of the coordinates,
    epsilon, min_samples (1 or 2), score_power, directed, and whether singletons are kept.
    """
    scales, epsilon, min_samples, power, directed, keep = settings
    measures, points = measure(endpoints, scales, directed)
    check(points, scores, epsilon)
    clusters = cluster_neighbors(points, epsilon, min_samples)
    return merge((endpoints, scores, labels, probabilities), measures, clusters, (power, directed, keep))


@compiled
@no_type_check
def merge(segments, measures, clusters, settings):
    """Gives the segments of `suppress`, given the cluster of each segment and how many there are."""
    endpoints, scores, labels, probabilities = segments
    power, directed, keep = settings
    slots, firsts, counts, peaks = _assign(measures, clusters, scores, keep)
    merged, chosen = np.empty((len(firsts), 2, 2)), np.empty(len(firsts), np.int64)
    means, odds = np.zeros((len(firsts), 6)), np.zeros((len(firsts), probabilities.shape[1]))
    voted = False
    for s in range(len(firsts)):
        chosen[s] = labels[firsts[s]]
    for i in range(len(slots)):
        s = slots[i]
        if s < 0:
            continue
        voted |= labels[i] != chosen[s]
        weight = _power(scores[i] / peaks[s], power) if peaks[s] > 0 else 1.0
        for k in range(5):
            means[s, k] += weight * measures[i, k]
        means[s, 5] += weight
        for k in range(odds.shape[1]):
            odds[s, k] += weight * probabilities[i, k]
    for s in range(len(firsts)):
        if counts[s] > 1:
            _draw(means, s, directed, merged)
            continue
        for k in range(4):
            merged[s, k >> 1, k & 1] = endpoints[firsts[s], k >> 1, k & 1]
    if odds.shape[1]:
        _decide(means, odds, chosen)
    return merged, peaks, chosen, odds, voted


@compiled
@no_type_check
def _decide(sums, odds, chosen):
    """Turns sums of probabilities into means, and chooses the most probable label."""
    for s in range(len(odds)):
        chosen[s] = 0
        for k in range(odds.shape[1]):
            odds[s, k] /= sums[s, 5]
            if odds[s, k] > odds[s, chosen[s]]:
                chosen[s] = k


@compiled
@no_type_check
def check(points, scores, epsilon):
    """Raises a ValueError if a number is not finite, a score is negative, or points are too far apart."""
    total = lowest = 0.0
    for i in range(len(points)):
        total += abs(points[i, 0]) + abs(points[i, 1]) + points[i, 2] + scores[i]
        lowest = min(lowest, scores[i])
    if not np.isfinite(total):
        raise ValueError("endpoints or scores hold NaN or infinity; drop those segments first.")
    if lowest < 0:
        raise ValueError("scores must be at least 0; drop the other segments first.")
    if total > MAX_SPREAD * epsilon:
        raise ValueError(
            "endpoints lie more than 2^50 radii apart; choose a larger epsilon, or drop the far ones."
        )


@compiled
@no_type_check
def _assign(measures, clusters, scores, keep):
    """Gives the merged segment of each segment (-1: none), and the first, number and best score of each.

    A cluster gives one, or a second for the members that point against its best; a segment in no cluster
    its own.
    """
    groups, count = clusters
    n = len(groups)
    best = np.full(count, -1, np.int64)
    for i in range(n):
        group = groups[i]
        if group >= 0 and (best[group] < 0 or scores[i] > scores[best[group]]):
            best[group] = i
    names = np.full((count, 2), -1, np.int64)
    slots, firsts, counts, peaks = (
        np.empty(n, np.int64),
        np.empty(n, np.int64),
        np.zeros(n, np.int64),
        np.zeros(n),
    )
    total = 0
    for i in range(n):
        if groups[i] < 0:
            continue
        j = best[groups[i]]
        against = np.int64(measures[i, 3] * measures[j, 3] + measures[i, 4] * measures[j, 4] < 0)
        s = names[groups[i], against]
        if s < 0:
            s = names[groups[i], against] = total
            firsts[s] = i
            total += 1
        slots[i] = s
        counts[s] += 1
        peaks[s] = max(peaks[s], scores[i])
    for i in range(n):
        if groups[i] < 0:
            slots[i] = total if keep else -1
            if keep:
                firsts[total], counts[total], peaks[total] = i, 1, scores[i]
                total += 1
    return slots, firsts[:total], counts[:total], peaks[:total]


@compiled
@no_type_check
def _halve_angle(dx, dy):
    """Gives a direction at half the angle of another, from -90 to 90 degrees.

    Square roots only: sines and cosines would differ in the last bit between Python and compiled code.
    """
    largest = max(abs(dx), abs(dy))
    if largest == 0:
        return 1.0, 0.0
    dx, dy = dx / largest, dy / largest
    length = np.sqrt(dx * dx + dy * dy)
    if dx >= 0:
        along = np.sqrt((length + dx) / 2)
        return along, dy / (2 * along)
    across = math.copysign(np.sqrt((length - dx) / 2), dy)
    return dy / (2 * across), across


@compiled
@no_type_check
def _draw(sums, s, directed, merged):
    """Writes the end points of the mean measures to `merged[s]`; the last sum is that of the weights."""
    share = 1 / sums[s, 5]
    x, y, half, dx, dy = (
        sums[s, 0] * share,
        sums[s, 1] * share,
        sums[s, 2] * share / 2,
        sums[s, 3],
        sums[s, 4],
    )
    if not directed:
        dx, dy = _halve_angle(dx, dy)
    norm = np.sqrt(dx * dx + dy * dy)
    half = half / norm if norm > 0 else 0.0
    merged[s, 0, 0], merged[s, 0, 1] = x - half * dx, y - half * dy
    merged[s, 1, 0], merged[s, 1, 1] = x + half * dx, y + half * dy
