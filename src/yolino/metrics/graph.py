"""Polylines as a graph: what TOPO and APLS walk on.

A node is a place where lines end, meet or fork, an edge is the line between two nodes. What is joined:

- Vertices at the same place are one, whether they are ends or not. So a line and its parts are the same.
- An end (or junction) joins others within `snap`, and every line that passes within `snap` (a T junction):
  that line is split at the nearest place. A line's two ends close a loop.
- Where lines lie exactly on each other they are one line; where they part is a fork.
- Lines that cross or run side by side without any of this stay apart.

Nothing depends on the order of the lines, and without directions nothing
depends on where a line starts: nodes are sorted by their coordinates.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from yolino.geometry import clip_segments
from yolino.metrics.joints import cut_polygon, join_ends, merge_places
from yolino.metrics.metric import Lines
from yolino.metrics.samples import check_lines
from yolino.types import Ints, Polylines


@dataclass(frozen=True, eq=False)
class Graph:
    """Lines as a graph, in pixels.

    Attributes:
        nodes: Where lines end, meet or fork, sorted by x, then y. A closed ring without any has its leftmost
            (then topmost) vertex as node.
        edges: Node at the start and at the end of each edge.
        curves: The course of each edge, from start to end. A directed graph is passed in this direction
            only; without directions it has no meaning.
        lengths: Length of each edge along its course.
        directed: Whether edges are passed in their direction only.
    """

    nodes: Float[np.ndarray, "n 2"]
    edges: Int[np.ndarray, "m 2"]
    curves: Polylines
    lengths: Float[np.ndarray, " m"]
    directed: bool

    @cached_property
    def matrix(self) -> csr_array:
        """Length of the shortest edge from each node (row) to each other (column)."""
        a, b, lengths = self.edges[:, 0], self.edges[:, 1], self.lengths
        if not self.directed:
            a, b, lengths = np.concatenate([a, b]), np.concatenate([b, a]), np.tile(lengths, 2)
        order = np.lexsort((lengths, b, a))
        a, b, lengths = a[order], b[order], lengths[order]
        shortest = np.append(True, (np.diff(a) != 0) | (np.diff(b) != 0))[: len(a)]
        size = (len(self.nodes), len(self.nodes))
        return csr_array((lengths[shortest], (a[shortest], b[shortest])), shape=size)

    def distances(
        self, sources: Int[np.ndarray, " s"], *, limit: float = math.inf, backwards: bool = False
    ) -> Float[np.ndarray, "s n"]:
        """Gives the length of the shortest way from each source to each node, infinite if there is none.

        Args:
            sources: Indices of nodes.
            limit: Longer ways are not looked for.
            backwards: Whether to give the ways from each node to the sources instead.
        """
        if len(sources) == 0:
            return np.zeros((0, len(self.nodes)))
        matrix = self.matrix.T.tocsr() if backwards else self.matrix
        return np.asarray(dijkstra(matrix, indices=sources, limit=limit))


def build_graph(
    lines: Lines,
    size: tuple[int, int],
    ignore: Sequence[Float[np.ndarray, "_ 2"]] = (),
    *,
    snap: float = 1.0,
    directed: bool = True,
) -> Graph:
    """Gives the graph of the parts of the lines inside the image and outside the ignored polygons.

    Args:
        lines: Polylines, or segments: each a line of its own.
        size: `(height, width)` of the image in pixels.
        ignore: Polygons (even-odd rule) in pixels; what lies inside one is cut out.
        snap: Largest distance in pixels from the end of a line to what it joins.
        directed: Whether edges are passed in the direction of their line only.

    Raises:
        ValueError: A coordinate is not finite, a polygon has less than three corners, `size` or `snap` is not
            positive.
    """
    check_scales(snap=snap)
    check_lines(lines, size, ignore, 1.0)
    pieces, _ = clip_segments(lines.endpoints, size)
    nodes, index = merge_places(pieces.reshape(-1, 2))
    whole = _contract(*_tidy(nodes, index.reshape(-1, 2), directed=directed), directed=directed)
    ring = (whole.edges[:, 0] == whole.edges[:, 1]) & (
        np.bincount(whole.edges.ravel())[whole.edges[:, 0]] == 2
    )
    nodes, edges = _tidy(*join_ends(whole.curves, ~ring, snap), directed=directed)
    for polygon in ignore:
        nodes, edges = cut_polygon(nodes, edges, np.asarray(polygon, dtype=np.float64))
    nodes = np.clip(nodes, 0.0, [size[1], size[0]])  # a mean of places at the border may round to outside
    return _contract(*_tidy(nodes, edges, directed=directed), directed=directed)


def check_scales(*, angle_radius: float = math.pi, **lengths: float | int | None) -> None:
    """Raises ValueError if the angle (radians) or a named length (pixels, None: default) is out of range."""
    for name, length in lengths.items():
        if length is not None and not 0 < length < math.inf:
            raise ValueError(f"{name} must be a positive number of pixels, got {length}.")
    if not 0 < angle_radius <= math.pi:
        raise ValueError(f"angle_radius must be in (0, pi] radians, got {angle_radius}.")


def _tidy(
    nodes: Float[np.ndarray, "n 2"], edges: Int[np.ndarray, "m 2"], *, directed: bool
) -> tuple[Float[np.ndarray, "k 2"], Int[np.ndarray, "l 2"]]:
    """Gives the nodes that have edges and the edges, both sorted; each edge once, none to its own start."""
    edges = edges[edges[:, 0] != edges[:, 1]]
    used = np.unique(edges)
    order = used[np.lexsort((nodes[used, 1], nodes[used, 0]))]
    rank = np.zeros(len(nodes), np.int64)
    rank[order] = np.arange(len(order))
    edges = rank[edges] if directed else np.sort(rank[edges], axis=1)
    return nodes[order], np.unique(edges, axis=0)


def _contract(nodes: Float[np.ndarray, "n 2"], edges: Int[np.ndarray, "m 2"], *, directed: bool) -> Graph:
    """Gives the graph whose edges are the ways between ends, junctions and forks."""
    ways = _trace(len(nodes), edges, directed=directed)
    offsets = np.cumsum([0, *(len(way) for way in ways)])
    curves = Polylines(nodes[[node for way in ways for node in way]], offsets)
    ends: Ints = np.array([(way[0], way[-1]) for way in ways], np.int64).reshape(-1, 2)
    kept, index = np.unique(ends, return_inverse=True)
    return Graph(nodes[kept], index.reshape(-1, 2).astype(np.int64), curves, curves.lengths, directed)


def _trace(count: int, edges: Int[np.ndarray, "m 2"], *, directed: bool) -> list[list[int]]:
    """Gives the nodes along each way between nodes that are not just passed, then along closed rings."""
    passed = _passed(count, edges, directed=directed)
    steps: list[list[tuple[int, int]]] = [[] for _ in range(count)]
    for edge, (start, end) in enumerate(edges.tolist()):
        steps[start].append((edge, end))
        if not directed:
            steps[end].append((edge, start))
    used = [False] * len(edges)
    ways = []
    for first in [*np.flatnonzero(~passed).tolist(), *np.flatnonzero(passed).tolist()]:
        for edge, second in steps[first]:
            if used[edge]:
                continue
            used[edge] = True
            way = [first, second]
            while passed[way[-1]] and way[-1] != first:
                onward, node = next(step for step in steps[way[-1]] if not used[step[0]])
                used[onward] = True
                way.append(node)
            ways.append(way)
    return ways


def _passed(count: int, edges: Int[np.ndarray, "m 2"], *, directed: bool) -> Bool[np.ndarray, " n"]:
    """Tells which nodes have one way in and one way out, and do not turn back."""
    leaving, arriving = (np.bincount(edges[:, side], minlength=count) for side in (0, 1))
    if not directed:
        return np.asarray(leaving + arriving == 2)
    after, before = np.full(count, -1), np.full(count, -1)
    after[edges[:, 0]], before[edges[:, 1]] = edges[:, 1], edges[:, 0]
    return np.asarray((leaving == 1) & (arriving == 1) & (after != before))


__all__ = ["Graph", "build_graph", "check_scales"]
