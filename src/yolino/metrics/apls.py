"""APLS: are the ways between places as long in one graph as in the other?

Control points are put on one graph and moved to the nearest place of the other. For each two of them that
are connected, the length of the shortest way is compared. (Average path length similarity; Van Etten,
Lindenbaum and Bacastow 2018.)

What the source leaves open is decided here:

- A control point moves to the nearest place within the radius whose direction differs by at most the angle
  radius from that of a line through the point: a crossing line, or the opposite lane, is not the same place.
- Of several equally near places the one of the most similar direction is taken, then that on the edge of the
  most similar length: where lines lie on each other a point stays on its own.
- In a directed graph a way may begin and end against the direction of an edge for up to the radius, on both
  graphs: a point moved to just behind a fork is still before it.
- All pairs in which the second point can be reached from the first count, each way round.
- Pairs are summed over the images before they are divided; the harmonic mean is that of the sums.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse.csgraph import connected_components

from yolino.metrics.graph import Graph, build_graph, check_scales
from yolino.metrics.joints import SAME, near_pieces
from yolino.metrics.metric import Lines, SumMetric

# Control points whose ways are looked at at once.
_ROWS = 256
# Cosines: an angle of exactly the radius is within it.
_COSINE_SLACK = 1e-9
# Relative differences of lengths that are less come from rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class _Places:
    """Places on the edges of a graph.

    Attributes:
        edges: Index of the edge, -1 for no place.
        arcs: Length of the way to it from the start of the edge, in pixels.
    """

    edges: Int[np.ndarray, " k"]
    arcs: Float[np.ndarray, " k"]

    def __getitem__(self, index: slice | Int[np.ndarray, " m"]) -> _Places:
        return _Places(self.edges[index], self.arcs[index])


class AplsMetric(SumMetric):
    """Average path length similarity `apls` of graphs, and that of each side's control points.

    `apls_truth_to_prediction` asks how the ways of the ground truth are kept in the prediction,
    `apls_prediction_to_truth` the reverse; `apls` is the harmonic mean. A side without any way counts 1 if
    there is neither prediction nor ground truth, else 0.

    Args:
        radius: Largest distance in pixels from a control point to its place on the other graph; a fiftieth of
            the image width if None.
        angle_radius: Largest angle between the directions there in radians.
        spacing: Largest distance between control points along an edge in pixels, a tenth of the image width
            if None. Ends and junctions always are control points.
        snap: Largest distance in pixels from the end of a line to what it joins (`build_graph`).
        directed: Whether lines are passed in their direction only, and opposite lines differ.

    Raises:
        ValueError: An argument is out of its range.
    """

    headline = "apls"

    def __init__(
        self,
        *,
        radius: float | None = None,
        angle_radius: float = math.pi / 4,
        spacing: float | None = None,
        snap: float = 1.0,
        directed: bool = True,
    ) -> None:
        super().__init__()
        check_scales(angle_radius=angle_radius, radius=radius, spacing=spacing, snap=snap)
        self.radius = radius
        self.angle_radius = angle_radius
        self.spacing = spacing
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
        spacing = size[1] / 10 if self.spacing is None else self.spacing
        found, wanted = (
            build_graph(lines, size, ignore, snap=self.snap, directed=self.directed)
            for lines in (prediction, truth)
        )
        row = []
        for graph, other in ((wanted, found), (found, wanted)):
            control = _control_points(graph, spacing)
            moved = _move(graph, control, other, radius=radius, angle_radius=self.angle_radius)
            row += _compare(graph, control, other, moved, slack=radius)
        self._rows.append(np.array(row, np.float64))

    def scores(self, sums: Float[np.ndarray, "*b k"]) -> dict[str, Float[np.ndarray, "*b"]]:
        """Gives `apls`, `apls_truth_to_prediction` and `apls_prediction_to_truth` of sums of `rows`."""
        lost, wanted, wrong, found = np.moveaxis(sums, -1, 0)
        empty = ((wanted + found) == 0).astype(np.float64)
        recall = np.where(wanted > 0, 1 - lost / np.where(wanted > 0, wanted, 1.0), empty)
        precision = np.where(found > 0, 1 - wrong / np.where(found > 0, found, 1.0), empty)
        both = recall + precision
        apls = np.asarray(2 * recall * precision / np.where(both > 0, both, 1.0))
        return {"apls": apls, "apls_truth_to_prediction": recall, "apls_prediction_to_truth": precision}


def _control_points(graph: Graph, spacing: float) -> _Places:
    """Gives the nodes, in their order, and then evenly spaced places on the edges, edge by edge."""
    parts = np.maximum(np.ceil(graph.lengths / spacing - 1e-9).astype(np.int64), 1)
    ring = graph.edges[:, 0] == graph.edges[:, 1]
    parts = np.where(ring, np.maximum(parts, 2), parts)  # a ring alone has a way too
    inner = np.repeat(np.arange(len(parts)), parts - 1)
    rank = np.arange(len(inner)) - np.repeat(np.cumsum(parts - 1) - parts + 1, parts - 1) + 1
    arcs = graph.lengths[inner] * rank / parts[inner]
    ends = np.stack([np.zeros(len(parts)), graph.lengths], axis=1)
    _, first = np.unique(graph.edges, return_index=True)  # each node is an end of some edge
    return _Places(np.concatenate([first // 2, inner]), np.concatenate([ends.ravel()[first], arcs]))


def _move(graph: Graph, control: _Places, other: Graph, *, radius: float, angle_radius: float) -> _Places:
    """Gives the place on the other graph for each control point of the graph, or none."""
    points, directions, owners = _tangents(graph, control)
    pieces = other.curves.endpoints
    near = near_pieces(points, pieces, radius)
    step = pieces[:, 1] - pieces[:, 0]
    lengths = np.hypot(step[:, 0], step[:, 1])
    cosine = (directions[near.points] * step[near.pieces]).sum(axis=1) / lengths[near.pieces]
    if not graph.directed:
        cosine = np.abs(cosine)
    kept = np.flatnonzero(cosine >= math.cos(angle_radius) - _COSINE_SLACK)
    nearest = np.full(len(control.edges), np.inf)
    np.minimum.at(nearest, owners[near.points[kept]], near.distances[kept])
    kept = kept[near.distances[kept] <= nearest[owners[near.points[kept]]] + SAME]
    who, piece = owners[near.points[kept]], near.pieces[kept]
    owner, begins = other.curves.owners, np.cumsum(lengths) - lengths
    edges = owner[piece]
    arcs = begins[piece] - begins[np.searchsorted(owner, edges)] + near.along[kept] * lengths[piece]
    unlike = np.abs(arcs - control.arcs[who]) + np.abs(
        other.lengths[edges] - graph.lengths[control.edges[who]]
    )
    order = np.lexsort((piece, np.round(unlike, 6), -np.round(cosine[kept], 6), who))
    who, first = np.unique(who[order], return_index=True)
    places = np.full(len(control.edges), -1), np.zeros(len(control.edges))
    places[0][who], places[1][who] = edges[order][first], arcs[order][first]
    return _Places(*places)


def _tangents(
    graph: Graph, control: _Places
) -> tuple[Float[np.ndarray, "t 2"], Float[np.ndarray, "t 2"], Int[np.ndarray, " t"]]:
    """Gives points with the directions of the lines there, and the control point each belongs to.

    A control point on an edge has one direction, a node that of each of its edges.
    """
    n = len(graph.nodes)
    pieces, owner = graph.curves.endpoints, graph.curves.owners
    step = pieces[:, 1] - pieces[:, 0]
    lengths = np.hypot(step[:, 0], step[:, 1])
    total = np.append(0.0, np.cumsum(lengths))
    first, last = (np.searchsorted(owner, np.arange(len(graph.edges)), side) for side in ("left", "right"))
    edges = control.edges[n:]
    at = np.searchsorted(total, total[first[edges]] + control.arcs[n:], side="right") - 1
    at = np.clip(at, first[edges], last[edges] - 1)
    along = (total[first[edges]] + control.arcs[n:] - total[at]) / lengths[at]
    points = np.concatenate(
        [graph.nodes[graph.edges].reshape(-1, 2), pieces[at, 0] + along[:, None] * step[at]]
    )
    which = np.concatenate([np.stack([first, last - 1], axis=1).ravel(), at])
    owners = np.concatenate([graph.edges.ravel(), n + np.arange(len(edges))])
    return points, step[which] / lengths[which, None], owners


def _compare(graph: Graph, control: _Places, other: Graph, moved: _Places, *, slack: float) -> list[float]:
    """Gives the sum over pairs of min(1, |L - L'| / L), and the number of pairs (Van Etten et al., Eq. 1)."""
    _, part = connected_components(graph.matrix, directed=False)
    order = np.argsort(part[graph.edges[control.edges, 0]], kind="stable")
    control, moved = control[order], moved[order]
    parts = part[graph.edges[control.edges, 0]]
    penalty = pairs = 0.0
    for i in range(0, len(order), _ROWS):
        rows = slice(i, i + _ROWS)
        # Only points of the same part of the graph are connected, and they stand together.
        columns = slice(*np.searchsorted(parts, [parts[i], parts[rows][-1] + 1]))
        length = _ways(graph, control[rows], control[columns], slack)
        counts = np.isfinite(length) & (length > SAME)
        length, way = length[counts], _ways(other, moved[rows], moved[columns], slack)[counts]
        difference = np.minimum(np.abs(way - length) / length, 1.0)
        penalty += float(difference[difference > _ROUNDING].sum())
        pairs += len(length)
    return [penalty, pairs]


def _ways(graph: Graph, sources: _Places, targets: _Places, slack: float) -> Float[np.ndarray, "s t"]:
    """Gives the length of the shortest way from each source to each target, infinite where there is none.

    From a source and to a target inside an edge, a way may go against its direction for up to `slack`.
    """
    ways = np.full((len(sources.edges), len(targets.edges)), np.inf)
    if len(graph.edges) == 0:
        return ways
    leave, leaves_inside = _to_ends(graph, sources, 0, slack)
    arrive, arrives_inside = _to_ends(graph, targets, 1, slack)
    for side in (0, 1):
        nodes, index = np.unique(graph.edges[sources.edges, side], return_inverse=True)
        between = graph.distances(nodes)[index.ravel()]
        for end in (0, 1):
            onward = between[:, graph.edges[targets.edges, end]]
            ways = np.minimum(ways, leave[:, side, None] + onward + arrive[:, end])
    along = targets.arcs - sources.arcs[:, None]
    allowed = (targets.edges == sources.edges[:, None]) & (targets.edges >= 0)
    if graph.directed:
        inside = leaves_inside[:, None] | arrives_inside
        allowed &= (along >= -SAME) | (inside & (along >= -slack))
    return np.where(allowed, np.minimum(ways, np.abs(along)), ways)


def _to_ends(
    graph: Graph, places: _Places, against: int, slack: float
) -> tuple[Float[np.ndarray, "k 2"], Bool[np.ndarray, " k"]]:
    """Gives the length of the way along the edge to its start and its end, and which places are no nodes.

    In a directed graph the way to the end numbered `against` is against the direction.
    """
    costs = np.stack([places.arcs, graph.lengths[places.edges] - places.arcs], axis=1)
    inside = costs.min(axis=1) > SAME
    if graph.directed:
        costs[costs[:, against] > np.where(inside, slack, SAME), against] = np.inf
    costs[places.edges < 0] = np.inf
    return costs, inside


__all__ = ["AplsMetric"]
