"""Which places of lines are one: vertices and pieces become the nodes and edges of a graph."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from yolino.metrics.samples import points_inside
from yolino.types import Polylines

# Places (px) that differ by less are the same: rounding must not decide what is joined or within a radius.
SAME = 1e-6
# An end touches its own line only where the way along the line is longer than this times `snap`.
_OWN = 4


class Near(NamedTuple):
    """Pairs of a point and a piece: their indices, the nearest place on the piece (0 to 1 along it)."""

    points: Int[np.ndarray, " k"]
    pieces: Int[np.ndarray, " k"]
    along: Float[np.ndarray, " k"]
    places: Float[np.ndarray, "k 2"]
    distances: Float[np.ndarray, " k"]


def near_pieces(
    points: Float[np.ndarray, "n 2"], endpoints: Float[np.ndarray, "m 2 2"], radius: float
) -> Near:
    """Gives all pairs of a point and a piece of a line (start, end) at most `radius` pixels apart."""
    halves = np.hypot(*(endpoints[:, 1] - endpoints[:, 0]).T) / 2
    found = cKDTree(points).query_ball_point(endpoints.mean(axis=1), halves + radius + SAME)
    pieces = np.repeat(np.arange(len(found)), [len(each) for each in found])
    which = np.concatenate([np.zeros(0, np.int64), *found]).astype(np.int64)
    # From the same end whatever the direction, so that rounding is the same too.
    start, end = endpoints[pieces, 0], endpoints[pieces, 1]
    flip = (start[:, 0] > end[:, 0]) | ((start[:, 0] == end[:, 0]) & (start[:, 1] > end[:, 1]))
    start, end = np.where(flip[:, None], end, start), np.where(flip[:, None], start, end)
    step = end - start
    squared = np.maximum((step**2).sum(axis=1), np.finfo(np.float64).tiny)
    along = np.clip(((points[which] - start) * step).sum(axis=1) / squared, 0.0, 1.0)
    places = np.where(along[:, None] < 1, start + along[:, None] * step, end)
    distances = np.hypot(*(points[which] - places).T)
    kept = distances <= radius + SAME
    along = np.where(flip, 1 - along, along)
    return Near(which[kept], pieces[kept], along[kept], places[kept], distances[kept])


def join_ends(
    lines: Polylines, has_ends: Bool[np.ndarray, " n"], snap: float
) -> tuple[Float[np.ndarray, "k 2"], Int[np.ndarray, "m 2"]]:
    """Gives the vertices as nodes, joined, and the pieces as edges, split where others join them.

    Args:
        lines: Lines in pixels, each with two vertices or more.
        has_ends: Which lines have ends to join to something; closed rings have none.
        snap: Largest distance in pixels from an end to what it joins.
    """
    ends = np.concatenate([lines.offsets[:-1][has_ends], lines.offsets[1:][has_ends] - 1])
    starts = np.setdiff1d(np.arange(len(lines.vertices)), lines.offsets[1:] - 1)
    owners = np.repeat(np.arange(len(lines)), np.diff(lines.offsets))
    arc = np.append(0.0, np.cumsum(np.hypot(*np.diff(lines.vertices, axis=0).T)))[: len(owners)]
    touch = near_pieces(lines.vertices[ends], lines.endpoints, snap)
    touch = touch._replace(points=ends[touch.points])
    first = starts[touch.pieces]
    at = arc[first] + touch.along * (arc[first + 1] - arc[first])
    own = (owners[touch.points] == owners[first]) & (np.abs(arc[touch.points] - at) <= _OWN * snap)
    overlaps = _overlaps(lines, owners)
    touch = Near(*(np.concatenate([a[~own], b]) for a, b in zip(touch, overlaps, strict=True)))
    pairs = ends[_pairs(lines.vertices[ends], snap)]
    short = (owners[pairs[:, 0]] == owners[pairs[:, 1]]) & (np.abs(np.diff(arc[pairs])[:, 0]) <= _OWN * snap)
    feet = len(lines.vertices) + np.arange(len(touch.points))
    nodes, index = merge_places(
        np.concatenate([lines.vertices, touch.places]),
        np.concatenate([pairs[~short], np.stack([feet, touch.points], axis=1)]),
    )
    rows = np.concatenate([np.tile(np.arange(len(starts)), 2), touch.pieces])
    along = np.concatenate([np.zeros(len(starts)), np.ones(len(starts)), touch.along])
    return nodes, _split(rows, along, index[np.concatenate([starts, starts + 1, feet])])


def _overlaps(lines: Polylines, owners: Int[np.ndarray, " v"]) -> Near:
    """Gives the vertices on the course of another piece along which the line goes on from there, or comes."""
    pieces = lines.endpoints
    near = near_pieces(lines.vertices, pieces, 0.0)
    step = pieces[near.pieces, 1] - pieces[near.pieces, 0]
    length = np.hypot(step[:, 0], step[:, 1])
    lies = np.zeros(len(near.points), np.bool_)
    for side in (-1, 1):
        neighbor = np.clip(near.points + side, 0, max(len(owners) - 1, 0))
        way = lines.vertices[neighbor] - lines.vertices[near.points]
        ahead = (way * step).sum(axis=1) > 0
        left = np.where(ahead, 1 - near.along, near.along) * length
        apart = np.abs(way[:, 0] * step[:, 1] - way[:, 1] * step[:, 0])
        far = np.maximum(np.hypot(way[:, 0], way[:, 1]), np.finfo(np.float64).tiny)
        common = np.minimum(left, far)
        lies |= (
            (owners[neighbor] == owners[near.points])
            & (common > SAME)
            & (apart * common <= SAME * length * far)
        )
    return Near(*(column[lies] for column in near))


def _pairs(points: Float[np.ndarray, "n 2"], radius: float) -> Int[np.ndarray, "k 2"]:
    return np.asarray(cKDTree(points).query_pairs(radius + SAME, output_type="ndarray"), np.int64)


def merge_places(
    places: Float[np.ndarray, "p 2"], links: Int[np.ndarray, "k 2"] | None = None
) -> tuple[Float[np.ndarray, "n 2"], Int[np.ndarray, " p"]]:
    """Gives one node for each set of linked places (and of same places), and the node of each place.

    A node lies in the mean of its places. They are added up in the order of their coordinates, so that
    rounding is the same for any order of the lines.
    """
    if len(places) == 0:
        return places, np.zeros(0, np.int64)
    distinct, index = np.unique(places + 0.0, axis=0, return_inverse=True)
    index = index.ravel()
    pairs = _pairs(distinct, 0.0)
    if links is not None:
        pairs = np.concatenate([pairs, index[links]])
    n = len(distinct)
    _, node = connected_components(coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n)))
    sums = [np.bincount(node, distinct[:, axis]) for axis in (0, 1)]
    return np.stack(sums, axis=1) / np.bincount(node)[:, None], node[index].astype(np.int64)


def _split(
    rows: Int[np.ndarray, " k"], along: Float[np.ndarray, " k"], nodes: Int[np.ndarray, " k"]
) -> Int[np.ndarray, "m 2"]:
    """Gives the edges between neighbours of the nodes that lie on the same row, in their order along it."""
    order = np.lexsort((along, rows))
    edges = np.stack([nodes[order][:-1], nodes[order][1:]], axis=1)
    return np.asarray(edges[np.diff(rows[order]) == 0])


def cut_polygon(
    nodes: Float[np.ndarray, "n 2"], edges: Int[np.ndarray, "m 2"], polygon: Float[np.ndarray, "v 2"]
) -> tuple[Float[np.ndarray, "k 2"], Int[np.ndarray, "l 2"]]:
    """Gives the edges without their parts inside the polygon, exactly cut at its border."""
    start, step = nodes[edges[:, 0]], nodes[edges[:, 1]] - nodes[edges[:, 0]]
    rows, along = [np.tile(np.arange(len(edges)), 2)], [np.repeat([0.0, 1.0], len(edges))]
    for corner, side in zip(polygon, np.roll(polygon, -1, axis=0) - polygon, strict=True):
        across = step[:, 0] * side[1] - step[:, 1] * side[0]
        way = corner - start
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            t = (way[:, 0] * side[1] - way[:, 1] * side[0]) / across
            u = (way[:, 0] * step[:, 1] - way[:, 1] * step[:, 0]) / across
        hit = np.flatnonzero((t > 0) & (t < 1) & (u >= -1e-9) & (u <= 1 + 1e-9))
        rows.append(hit)
        along.append(t[hit])
    row, t = np.concatenate(rows[1:]), np.concatenate(along[1:])
    places = np.concatenate([nodes, start[row] + t[:, None] * step[row]])
    merged, index = merge_places(places)
    ids = index[np.concatenate([edges[:, 0], edges[:, 1], len(nodes) + np.arange(len(row))])]
    parts = _split(np.concatenate(rows), np.concatenate(along), ids)
    return merged, parts[~points_inside(merged[parts].mean(axis=1), polygon)]


__all__ = ["SAME", "Near", "cut_polygon", "join_ends", "merge_places", "near_pieces"]
