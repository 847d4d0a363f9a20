"""TOPO: is what can be reached from a place in one graph reached from the same place in the other?

From a seed, marbles are dropped at even distances along every way out of it, in the prediction and in the
ground truth, and paired one to one where they lie close together and point alike. A gap, a missing turn or a
wrong connection costs all marbles behind it. (Biagioni and Eriksson 2012; symmetric as in He and Balakrishnan
2022.)

What the sources leave open is decided here:

- Seeds of the ground truth judge the recall, seeds of the prediction the precision. A seed without a partner
  on the other side counts with none of its marbles found. So exchanging the two sides exchanges the scores.
- Seeds are marbles, in the middle of each edge and at `seed_spacing` outwards. The partner of a seed is the
  nearest marble within both radii; of equally near ones that of the most similar direction.
- In a directed graph marbles lie on every way that leads out of the seed and on every way that leads to it.
- Marbles stand for equal lengths, whatever the vertices. All radii and reaches are inclusive.
- The one-to-one matching is of maximum size: that size is unique.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from yolino.compiled import compiled
from yolino.metrics.graph import Graph, build_graph, check_scales
from yolino.metrics.joints import SAME
from yolino.metrics.metric import Lines, SumMetric
from yolino.metrics.samples import Samples, sample_lines
from yolino.types import Ints

# Pairs of seed and edge that are looked at at once.
_PAIRS = 1 << 21
# Cosines: an angle of exactly the radius is within it.
_COSINE_SLACK = 1e-9


@dataclass(frozen=True, eq=False)
class _Marbles:
    """A graph with marbles in the middle of equal stretches of each edge.

    Attributes:
        graph: The graph.
        samples: The marbles, edge by edge; their owners are the edges.
        first: Index of the first marble of each edge.
        counts: Number of marbles of each edge, at least one.
        steps: Distance of neighbours on each edge in pixels.
    """

    graph: Graph
    samples: Samples
    first: Int[np.ndarray, " m"]
    counts: Int[np.ndarray, " m"]
    steps: Float[np.ndarray, " m"]

    @property
    def ranks(self) -> Int[np.ndarray, " s"]:
        """Position of each marble among those of its edge, from 0."""
        return np.asarray(np.arange(len(self.samples)) - self.first[self.samples.owners])


class TopoMetric(SumMetric):
    """TOPO `precision`, `recall` and `f1` of graphs, micro-averaged: sums of marbles over seeds and images.

    A ratio without a denominator is 1 if there is neither prediction nor ground truth, else 0.

    Args:
        radius: Largest distance in pixels of a pair of marbles, and of a seed and its partner; a fiftieth of
            the image width if None.
        angle_radius: Largest angle between their directions in radians.
        spacing: Distance between marbles in pixels, half the radius if None.
        reach: Length of the ways out of a seed in pixels, a quarter of the image width if None.
        seed_spacing: Distance between seeds in pixels, a fifth of the reach if None.
        snap: Largest distance in pixels from the end of a line to what it joins (`build_graph`).
        directed: Whether lines are passed in their direction only, and opposite lines differ.

    Raises:
        ValueError: An argument is out of its range.
    """

    headline = "f1"

    def __init__(
        self,
        *,
        radius: float | None = None,
        angle_radius: float = math.pi / 4,
        spacing: float | None = None,
        reach: float | None = None,
        seed_spacing: float | None = None,
        snap: float = 1.0,
        directed: bool = True,
    ) -> None:
        super().__init__()
        check_scales(
            angle_radius=angle_radius,
            radius=radius,
            spacing=spacing,
            reach=reach,
            seed_spacing=seed_spacing,
            snap=snap,
        )
        self.radius = radius
        self.angle_radius = angle_radius
        self.spacing = spacing
        self.reach = reach
        self.seed_spacing = seed_spacing
        self.snap = snap
        self.directed = directed

    def update(
        self,
        prediction: Lines,
        truth: Lines,
        size: tuple[int, int],
        ignore: Sequence[Float[np.ndarray, "_ 2"]] = (),
    ) -> None:
        """Adds one image; the arguments and errors are those of `build_graph`."""
        radius = size[1] / 50 if self.radius is None else self.radius
        spacing = radius / 2 if self.spacing is None else self.spacing
        sides = []
        for lines in (prediction, truth):
            graph = build_graph(lines, size, ignore, snap=self.snap, directed=self.directed)
            sides.append(_place(graph, size, spacing))
        reach = size[1] / 4 if self.reach is None else self.reach
        precision = self._judge(sides[0], sides[1], (radius, spacing, reach))
        recall = self._judge(sides[1], sides[0], (radius, spacing, reach))
        self._rows.append(np.array([*precision, *recall], np.float64))

    def scores(self, sums: Float[np.ndarray, "*b k"]) -> dict[str, Float[np.ndarray, "*b"]]:
        """Gives `precision`, `recall` and `f1` of sums of `rows`."""
        right, dropped, found, wanted = np.moveaxis(sums, -1, 0)
        empty = (dropped + wanted) == 0
        precision = np.where(empty, 1.0, right / np.where(dropped > 0, dropped, 1.0))
        recall = np.where(empty, 1.0, found / np.where(wanted > 0, wanted, 1.0))
        both = precision + recall
        f1 = np.asarray(2 * precision * recall / np.where(both > 0, both, 1.0))
        return {"precision": precision, "recall": recall, "f1": f1}

    def _judge(self, side: _Marbles, other: _Marbles, scales: tuple[float, float, float]) -> tuple[int, int]:
        """Gives how many marbles around the seeds of a side have a partner, and how many there are."""
        radius, spacing, reach = scales
        bounds, columns = _close(side, other, radius, self.angle_radius)
        stride = max(1, round((reach / 5 if self.seed_spacing is None else self.seed_spacing) / spacing))
        middle = (side.counts[side.samples.owners] - 1) / 2
        seeds = np.flatnonzero(np.floor(np.abs(side.ranks - middle)) % stride == 0)
        nearest = np.append(columns, -1)[bounds[seeds]]
        partners = np.where(bounds[seeds] < bounds[seeds + 1], nearest, -1)
        matched = total = 0
        chunk = max(1, _PAIRS // max(len(side.counts), len(other.counts), 1))
        for i in range(0, len(seeds), chunk):
            partner = partners[i : i + chunk]
            holes = _walk(side, seeds[i : i + chunk], reach)
            marbles = _walk(other, partner[partner >= 0], reach)
            marbles[:, 0] = np.flatnonzero(partner >= 0)[marbles[:, 0]]
            matched += _match(holes, marbles, bounds, columns)
            total += len(holes)
        return matched, total


def _place(graph: Graph, size: tuple[int, int], spacing: float) -> _Marbles:
    samples = sample_lines(graph.curves, size, spacing=float(spacing))
    counts = np.bincount(samples.owners, minlength=len(graph.edges))
    return _Marbles(graph, samples, np.cumsum(counts) - counts, counts, graph.lengths / counts)


def _close(
    side: _Marbles, other: _Marbles, radius: float, angle_radius: float
) -> tuple[Int[np.ndarray, " s_plus_1"], Int[np.ndarray, " k"]]:
    """Gives the marbles of the other side within both radii of each marble.

    Returns:
        Where those of each marble begin and the last end, and their indices: the nearest first, of equally
        near ones that of the most similar direction.
    """
    a, b = side.samples, other.samples
    near = cKDTree(a.points).sparse_distance_matrix(cKDTree(b.points), radius + SAME, output_type="ndarray")
    cosine = (a.directions[near["i"]] * b.directions[near["j"]]).sum(axis=1)
    if not side.graph.directed:
        cosine = np.abs(cosine)
    kept = cosine >= math.cos(angle_radius) - _COSINE_SLACK
    i, j, distance, cosine = near["i"][kept], near["j"][kept], near["v"][kept], cosine[kept]
    order = np.lexsort((j, -np.round(cosine, 6), np.round(distance, 6), i))
    return np.searchsorted(i[order], np.arange(len(a) + 1)), j[order].astype(np.int64)


def _walk(marbles: _Marbles, starts: Int[np.ndarray, " s"], reach: float) -> Int[np.ndarray, "k 2"]:
    """Gives the marbles on the ways, at most `reach` long, out of each start and, if directed, to it.

    Returns:
        Pairs of index in `starts` and index of the marble; sorted, each once.
    """
    graph, edge = marbles.graph, marbles.samples.owners[starts]
    arc = (marbles.ranks[starts] + 0.5) * marbles.steps[edge]
    first, last = graph.edges[edge, 0], graph.edges[edge, 1]
    rest = graph.lengths[edge] - arc
    onward = graph.distances(last, limit=reach) + rest[:, None]
    back = graph.distances(first, limit=reach, backwards=True) + arc[:, None]
    if not graph.directed:
        onward = back = np.minimum(onward, back)
    # How many marbles of each edge are met from its start, and from its end.
    head = _met(marbles, reach - onward[:, graph.edges[:, 0]])
    tail = _met(marbles, reach - back[:, graph.edges[:, 1]])
    row, ahead = np.nonzero(head)
    behind_row, behind = np.nonzero(tail)
    span = np.floor((reach + SAME) / marbles.steps[edge]).astype(np.int64)
    low = np.maximum(marbles.ranks[starts] - span, 0)
    high = np.minimum(marbles.ranks[starts] + span + 1, marbles.counts[edge])
    begin = [
        marbles.first[ahead],
        (marbles.first + marbles.counts)[behind] - tail[behind_row, behind],
        marbles.first[edge] + low,
    ]
    sizes = np.concatenate([head[row, ahead], tail[behind_row, behind], high - low])
    rows = np.concatenate([row, behind_row, np.arange(len(starts))])
    which = np.arange(sizes.sum()) + np.repeat(np.concatenate(begin) - np.cumsum(sizes) + sizes, sizes)
    count = max(len(marbles.samples), 1)
    keys = np.sort(np.repeat(rows, sizes) * count + which)
    return np.stack(np.divmod(keys[np.append(True, np.diff(keys) > 0)[: len(keys)]], count), axis=1)


def _met(marbles: _Marbles, left: Float[np.ndarray, "s m"]) -> Int[np.ndarray, "s m"]:
    """Gives how many marbles of each edge lie within the length that is left at its first marble's end."""
    counts = np.floor((np.maximum(left, -1.0) + SAME) / marbles.steps + 0.5)
    return np.asarray(np.clip(counts, 0, marbles.counts), dtype=np.int64)


def _match(
    holes: Int[np.ndarray, "h 2"],
    marbles: Int[np.ndarray, "k 2"],
    bounds: Int[np.ndarray, " s_plus_1"],
    columns: Int[np.ndarray, " c"],
) -> int:
    """Gives how many holes and marbles, of the same seed and close to each other, pair up at most."""
    degree = np.diff(bounds)[holes[:, 1]]
    hole = np.repeat(np.arange(len(holes)), degree)
    entry = np.arange(len(hole)) + np.repeat(bounds[holes[:, 1]] - np.cumsum(degree) + degree, degree)
    count = columns.max(initial=0) + 1
    marbles = marbles[marbles[:, 1] < count]
    keys: Ints = marbles[:, 0] * count + marbles[:, 1]
    wanted = holes[hole, 0] * count + columns[entry]
    at = np.searchsorted(keys, wanted)
    hit: Bool[np.ndarray, " e"] = np.append(keys, -1)[at] == wanted
    first = np.searchsorted(hole[hit], np.arange(len(holes) + 1))
    return int(_largest_matching(first, at[hit], len(marbles)))


# scipy.sparse.csgraph.maximum_bipartite_matching finds the same number, but can take exponential time: with
# some 500 marbles on parallel lanes it did not end.


@compiled
@no_type_check
def _largest_matching(bounds, columns, count):
    """Gives the size of the largest matching of rows, row i with one of columns[bounds[i]:bounds[i + 1]]."""
    rows = len(bounds) - 1
    row_of, column_of = np.full(count, -1), np.full(rows, -1)
    seen, came = np.zeros(count, np.bool_), np.empty(count, np.int64)
    queue, visited = np.empty(rows + 1, np.int64), np.empty(count, np.int64)
    size = 0
    for row in range(rows):
        queue[0], head, tail, news, goal = row, 0, 1, 0, -1
        while head < tail and goal < 0:
            for k in range(bounds[queue[head]], bounds[queue[head] + 1]):
                column = columns[k]
                if seen[column]:
                    continue
                seen[column], came[column] = True, queue[head]
                visited[news] = column
                news += 1
                if row_of[column] < 0:
                    goal = column
                    break
                queue[tail] = row_of[column]
                tail += 1
            head += 1
        if goal < 0:
            continue  # what a failed search has seen leads nowhere for later rows either
        size += 1
        while goal >= 0:
            column, other = goal, came[goal]
            goal, column_of[other], row_of[column] = column_of[other], column, other
        for k in range(news):
            seen[visited[k]] = False
    return size


__all__ = ["TopoMetric"]
