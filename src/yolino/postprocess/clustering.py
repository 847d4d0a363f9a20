"""DBSCAN in linear memory: sorted cells, boxes and union-find, compiled. The clusters are scikit-learn's.

The two widest dimensions are cut into square cells at least `epsilon` wide, so neighbors lie in the 3 x 3
cells around a point; with the cells sorted by row those are three runs, and half of them suffices to meet
each pair once. Where a cell is crowded, its points are grouped into boxes so small that all members of a
box are neighbors. Boxes are then counted and joined as a whole: thousands of points within one radius cost
no more than their boxes do.
"""

from __future__ import annotations

from typing import no_type_check

import numpy as np
from jaxtyping import Float, Int

from yolino.compiled import compiled
from yolino.postprocess.boxes import bounds, gaps, is_crowded, near, split_cells
from yolino.postprocess.cells import sort_points, windows

MAX_SPREAD = 2.0**50


def dbscan(
    points: Float[np.ndarray, "n d"],
    epsilon: float,
    min_samples: int,
    weights: Float[np.ndarray, " n"] | None = None,
) -> Int[np.ndarray, " n"]:
    """Gives the cluster of each point, -1 for noise: exactly the labels of scikit-learn's `DBSCAN`.

    A core point has `min_samples` points, or that much weight, within `epsilon`, itself included. Core points
    within `epsilon` of each other share a cluster. Another point within `epsilon` of a core point belongs to
    the first such cluster, in the order of the clusters' first core points. All others are noise.

    Args:
        points: Coordinates, in any unit.
        epsilon: Radius in the same unit, inclusive.
        min_samples: Points, or sum of weights, that make a core point.
        weights: Weight of each point, 1 where none is given; a negative one inhibits its neighbors.

    Raises:
        ValueError: If a value is not finite, `epsilon` or `min_samples` is not positive, the number of
            weights is not that of the points, or `epsilon` is less than 2^-50 of the spread of the points.
    """
    if not (np.isfinite(epsilon) and epsilon > 0):
        raise ValueError(f"epsilon is {epsilon}, but a finite radius above 0 is needed.")
    if min_samples < 1:
        raise ValueError(f"min_samples is {min_samples}, but at least 1 is needed.")
    points = np.array(points, np.float64, order="C")
    mass = np.ones(len(points)) if weights is None else np.array(weights, np.float64, order="C")
    if mass.shape != (len(points),):
        raise ValueError(
            f"weights has shape {mass.shape}, but one for each of the {len(points)} points is needed."
        )
    if not (np.isfinite(points).all() and np.isfinite(mass).all()):
        raise ValueError("points or weights hold NaN or infinity; drop those rows first.")
    if points.size == 0:
        return np.full(len(points), 0 if len(points) and mass.sum() >= min_samples else -1, np.int64)
    if np.ptp(points, axis=0).max() > MAX_SPREAD * epsilon:
        raise ValueError(
            f"epsilon is {epsilon}, less than 2^-50 of the spread of the points; choose a larger one."
        )
    labels, _ = cluster(points, float(epsilon), int(min_samples), np.empty(0) if weights is None else mass)
    return np.asarray(labels)


@compiled
@no_type_check
def cluster(points, epsilon, min_samples, weights):
    """Gives the labels of checked input (at least one point; weights may be empty) and how many clusters."""
    if len(weights) == 0 and min_samples <= 2:
        return cluster_neighbors(points, epsilon, min_samples)
    space, order, pairs = _arrange(points, epsilon)
    core = _core_points(space, pairs, weights[order] if len(weights) else np.ones(len(points)), min_samples)
    chosen = np.sort(order[core])
    parents = np.full(len(points), -1, np.int64)
    if len(chosen):
        parents[chosen] = chosen[_components(points[chosen], epsilon)]
    labels, count = _number_clusters(parents, 1)
    _label_borders(space, pairs, core, order, labels)
    return labels, count


@compiled
@no_type_check
def cluster_neighbors(points, epsilon, min_samples):
    """Gives the same for `min_samples` 1 or 2: who has a neighbor is core, so clusters are components."""
    return _number_clusters(_components(points, epsilon), min_samples)


@compiled
@no_type_check
def _arrange(points, epsilon):
    """Gives the points sorted by cell and box, their order, and the runs of later boxes around each box.

    The sorted points are a space: rows, where each box starts (and the last stops), the boxes' low and high
    corners, and the squared radius.
    """
    rows, order, keys, columns = sort_points(points, epsilon)
    starts = split_cells(rows, keys, order, epsilon)
    lows, highs = bounds(rows, starts)
    return (rows, starts, lows, highs, epsilon * epsilon), order, windows(keys[starts[:-1]], columns)


@compiled
@no_type_check
def _components(points, epsilon):
    """Gives a parent of each point, itself or an earlier one; neighbors, and theirs, have the same root."""
    rows, order, keys, columns = sort_points(points, epsilon)
    parents = np.arange(len(rows))
    if is_crowded(keys):
        starts = split_cells(rows, keys, order, epsilon)
        lows, highs = bounds(rows, starts)
        pairs = windows(keys[starts[:-1]], columns)
        _join_boxes((rows, starts, lows, highs, epsilon * epsilon), order, pairs, parents)
    else:
        _join_points((rows, epsilon * epsilon), order, (keys, columns), parents)
    return parents


@compiled
@no_type_check
def _join_points(space, order, cells, parents):
    """Joins neighbors, the cells swept in their order together with the next row of cells."""
    rows, limit = space
    keys, columns = cells
    n = len(rows)
    start = 0
    for p in range(n):
        root = _root(parents, order[p])
        while start < n and keys[start] < keys[p] + columns - 1:
            start += 1
        for half in range(2):
            q, last = (p + 1, keys[p] + 1) if half == 0 else (start, keys[p] + columns + 1)
            while q < n and keys[q] <= last:
                if near(rows, p, q, limit) & (parents[order[q]] != root):
                    root = _join(parents, root, order[q])
                q += 1


@compiled
@no_type_check
def _join_boxes(space, order, pairs, parents):
    """Joins the points of each box, and the boxes that hold neighbors."""
    starts = space[1]
    nodes = np.empty(len(starts) - 1, np.int64)
    for b in range(len(nodes)):
        nodes[b] = order[starts[b]]
        for p in range(starts[b] + 1, starts[b + 1]):
            nodes[b] = min(nodes[b], order[p])
        for p in range(starts[b], starts[b + 1]):
            parents[order[p]] = nodes[b]
    for a in range(len(nodes)):
        root = _root(parents, nodes[a])
        for half in range(2):
            for b in range(pairs[a, half, 0], pairs[a, half, 1]):
                if parents[nodes[b]] != root and _touch(space, a, b):
                    root = _join(parents, root, nodes[b])


@compiled(inline=True)
@no_type_check
def _touch(space, a, b):
    """Gives whether a point of box a is within the radius of one of box b."""
    rows, starts, lows, highs, limit = space
    smallest, largest = gaps(lows, highs, a, b)
    if smallest > limit or largest <= limit:
        return largest <= limit
    for p in range(starts[a], starts[a + 1]):
        for q in range(starts[b], starts[b + 1]):
            if near(rows, p, q, limit):
                return True
    return False


@compiled
@no_type_check
def _root(parents, i):
    while parents[i] != i:
        parents[i] = parents[parents[i]]
        i = parents[i]
    return i


@compiled(inline=True)
@no_type_check
def _join(parents, root, i):
    """Joins the tree of i to that of `root`, and gives the root of both: their first point."""
    other = _root(parents, i)
    first = min(root, other)
    parents[max(root, other)] = first
    return first


@compiled
@no_type_check
def _number_clusters(parents, smallest):
    """Gives the label of each point, and how many; -1 without a root, or alone where two are needed."""
    alone = np.ones(len(parents), np.bool_)
    for i in range(len(parents)):
        if 0 <= parents[i] < i:
            parents[i] = parents[parents[i]]  # the root, as parents come first
            alone[parents[i]] = False
    labels = np.empty(len(parents), np.int64)
    count = 0
    for i in range(len(parents)):
        if parents[i] == i and not (smallest > 1 and alone[i]):
            labels[i] = count
            count += 1
        else:
            labels[i] = labels[parents[i]] if 0 <= parents[i] < i else -1
    return labels, count


@compiled
@no_type_check
def _core_points(space, pairs, weights, min_samples):
    """Gives for each row whether the weights within the radius sum to `min_samples`."""
    rows, starts, lows, _, limit = space
    # Unless a weight is negative, a point that has enough needs no more.
    enough = np.float64(min_samples) if weights.min() >= 0 else np.inf
    masses, sums = np.zeros(len(lows)), np.empty(len(rows))
    for b in range(len(lows)):
        for p in range(starts[b], starts[b + 1]):
            masses[b] += weights[p]
        sums[starts[b] : starts[b + 1]] = masses[b]
    wanting = masses < enough
    for a in range(len(lows)):
        for half in range(2):
            for b in range(pairs[a, half, 0], pairs[a, half, 1]):
                if len(lows) == len(rows):  # every box holds one point
                    if near(rows, a, b, limit):
                        sums[a] += weights[b]
                        sums[b] += weights[a]
                    continue
                if wanting[a]:
                    wanting[a] = _add_mass(space, (a, b), weights, sums, (masses[b], enough))
                if wanting[b]:
                    wanting[b] = _add_mass(space, (b, a), weights, sums, (masses[a], enough))
    return sums >= min_samples


@compiled(inline=True)
@no_type_check
def _add_mass(space, boxes, weights, sums, masses):
    """Adds the weights of box b to their neighbors' sums in box a, and tells whether those want more."""
    rows, starts, lows, highs, limit = space
    mass, enough = masses
    a, b = boxes
    smallest, largest = gaps(lows, highs, a, b)
    if smallest > limit:
        return True
    wanting = False
    for p in range(starts[a], starts[a + 1]):
        if largest <= limit:
            sums[p] += mass
        elif sums[p] < enough:
            for q in range(starts[b], starts[b + 1]):
                if near(rows, p, q, limit):
                    sums[p] += weights[q]
        wanting |= sums[p] < enough
    return wanting


@compiled
@no_type_check
def _label_borders(space, pairs, core, order, labels):
    """Gives each point that is no core point the first cluster among its core neighbors."""
    rows, starts, lows, highs, limit = space
    full = np.ones(len(lows), np.bool_)  # boxes of core points alone
    for b in range(len(lows)):
        for p in range(starts[b], starts[b + 1]):
            full[b] &= core[p]
    for a in range(len(lows)):
        for half in range(2):
            for b in range(a if half == 0 else pairs[a, 1, 0], pairs[a, half, 1]):
                if (full[a] and full[b]) or gaps(lows, highs, a, b)[0] > limit:
                    continue
                for p in range(starts[a], starts[a + 1]):
                    for q in range(starts[b], starts[b + 1]):
                        if core[p] != core[q] and near(rows, p, q, limit):
                            i, j = (order[q], order[p]) if core[p] else (order[p], order[q])
                            if labels[i] < 0 or labels[j] < labels[i]:
                                labels[i] = labels[j]
