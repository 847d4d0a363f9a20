"""The paths that Label Studio's vector tool draws: chains, branches, closed ones and curves, as polylines.

A path is `{"vertices": [{"id", "x", "y", "prevPointId", "isBezier", "controlPoint1", "controlPoint2"}, ...],
"closed": false}` in percents of the image's width and height. Every vertex names the one before it; without a
name it is the one listed before. Several may name the same: the path branches there.
(https://labelstud.io/tags/vectorlabels)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float

from yolino.datasets.annotation import LabelError, check_points

_TOLERANCE = 0.1  # pixels: how far a polyline may be from its curve
_MOST_PIECES = 1000  # of a curve
_STRAIGHT = 0.3  # of the way: where a vertex without a handle has its control point


def path_to_polylines(
    value: Mapping[str, Any], size: tuple[int, int], where: str
) -> list[Float[np.ndarray, "_ 2"]]:
    """Gives a path as polylines in pixels: one, or where it branches several that share an end vertex.

    They run from the vertex before to the vertex after it. Only where two chains leave the first vertex, and
    nothing else does, these are one polyline, from the end of the chain that was drawn first to the end of
    the other: this is how Label Studio continues a path at its beginning. A closed path ends where it begins.
    Curves are cut into pieces that are within 0.1 px of them.

    Args:
        value: The path.
        size: `(height, width)` of the image in pixels.
        where: The file, and the place in it, for messages.

    Raises:
        LabelError: The path is broken.
    """
    vertices = value["vertices"]
    if not isinstance(vertices, list) or not all(isinstance(v, Mapping) for v in vertices):
        raise LabelError(where, "has vertices that are no list of objects, but a list of {x, y} is needed")
    points = to_pixels([[v.get("x"), v.get("y")] for v in vertices], size, where)
    previous = _previous(vertices, where)
    chains = _chains(previous)
    circle = any(len(chain) > 1 and chain[0] == chain[-1] for chain in chains)
    if value.get("closed") is True and len(vertices) > 1 and not circle:
        if len(chains) > 1:
            raise LabelError(where, "is closed and branches, but does not say where it is closed: redraw it")
        chains = [[*chains[0], chains[0][0]]]
    if not any(vertex.get("isBezier") for vertex in vertices):
        return [points[chain] for chain in chains]
    handles = [
        [_handle(vertex, key, size, where) for vertex in vertices]
        for key in ("controlPoint1", "controlPoint2")
    ]
    return [_along(chain, previous, points, handles) for chain in chains]


def to_pixels(points: object, size: tuple[int, int], where: str) -> Float[np.ndarray, "v 2"]:
    """Gives points `[x, y]` in percents of the width and height in pixels.

    Raises:
        LabelError: They are no points, or not finite.
    """
    percents = check_points(points, where)
    with np.errstate(over="ignore"):
        pixels: Float[np.ndarray, "v 2"] = percents / 100 * np.array([size[1], size[0]], np.float64)
    if not np.isfinite(pixels).all():
        raise LabelError(where, "has a coordinate that is no number of pixels, but percents are needed")
    return pixels


def _previous(vertices: Sequence[Mapping[str, Any]], where: str) -> list[int | None]:
    """Gives the index of the vertex before each one."""
    indices: dict[object, int] = {}
    for i, vertex in enumerate(vertices):
        key = vertex.get("id", i)
        if not isinstance(key, str | int) or key in indices:
            raise LabelError(where, f"has the vertex id {key!r}, but a different one is needed for each")
        indices[key] = i
    previous: list[int | None] = []
    for i, vertex in enumerate(vertices):
        key = vertex.get("prevPointId")
        if not key:
            previous.append(i - 1 if i else None)
        elif isinstance(key, str | int) and indices.get(key, i) != i:
            previous.append(indices[key])
        else:
            raise LabelError(where, f"has a vertex after {key!r}, but that is no other vertex of the path")
    return previous


def _chains(previous: Sequence[int | None]) -> list[list[int]]:
    """Cuts a path where it branches; gives the indices of the vertices of each part, in order."""
    if list(previous) == [None, *range(len(previous) - 1)]:
        return [list(range(len(previous)))]
    after: list[list[int]] = [[] for _ in previous]
    for i, before in enumerate(previous):
        if before is not None:
            after[before].append(i)
    chains: list[list[int]] = []
    for i, before in enumerate(previous):
        if before is None or len(after[i]) > 1:
            found = [_follow(i, following, after) for following in after[i]] or [[i]]
            if before is None and len(found) == 2:
                found = [found[0][::-1] + found[1][1:]]
            chains += found
    seen = {i for chain in chains for i in chain}
    for i in range(len(previous)):  # what is left are circles
        if i not in seen:
            chains.append(_follow(i, after[i][0], after))
            seen.update(chains[-1])
    return chains


def _follow(start: int, following: int, after: Sequence[Sequence[int]]) -> list[int]:
    """Gives the vertices from `start` by way of `following` to an end, a branching or back to `start`."""
    chain = [start, following]
    while len(after[following]) == 1 and following != start:
        following = after[following][0]
        chain.append(following)
    return chain


def _handle(
    vertex: Mapping[str, Any], key: str, size: tuple[int, int], where: str
) -> Float[np.ndarray, " 2"] | None:
    """Gives a control point of a vertex in pixels; None where the path is straight there."""
    point = vertex.get(key)
    if not vertex.get("isBezier") or point is None:
        return None
    if not isinstance(point, Mapping):
        raise LabelError(where, f"has the {key} {point!r}, but {{x, y}} is needed")
    return np.asarray(to_pixels([[point.get("x"), point.get("y")]], size, where)[0])


def _along(
    chain: Sequence[int],
    previous: Sequence[int | None],
    points: Float[np.ndarray, "v 2"],
    handles: Sequence[Sequence[Float[np.ndarray, " 2"] | None]],
) -> Float[np.ndarray, "_ 2"]:
    """Gives a chain with its curves cut into pieces."""
    pieces = [points[[chain[0]]]]
    for i, j in pairwise(chain):
        against = previous[i] == j and previous[j] != i  # then the handles change places
        leaving, arriving = (handles[0][i], handles[1][j]) if against else (handles[1][i], handles[0][j])
        pieces.append(_curve(points[i], leaving, arriving, points[j])[1:])
    return np.concatenate(pieces)


def _curve(
    start: Float[np.ndarray, " 2"],
    leaving: Float[np.ndarray, " 2"] | None,
    arriving: Float[np.ndarray, " 2"] | None,
    end: Float[np.ndarray, " 2"],
) -> Float[np.ndarray, "n 2"]:
    """Gives points of a cubic Bezier curve, evenly in its parameter and both ends included."""
    if leaving is None and arriving is None:
        return np.stack([start, end])
    first = start + _STRAIGHT * (end - start) if leaving is None else leaving
    second = end - _STRAIGHT * (end - start) if arriving is None else arriving
    # The chord of a piece 1/n of the parameter long is off by at most |second derivative| / (8 n^2).
    bend = 6 * max(np.hypot(*(start - 2 * first + second)), np.hypot(*(first - 2 * second + end)))
    count = int(np.clip(np.ceil(np.sqrt(bend / (8 * _TOLERANCE))), 1, _MOST_PIECES))
    t = np.linspace(0.0, 1.0, count + 1)[:, None]
    s = 1 - t
    return np.asarray(s**3 * start + 3 * s**2 * t * first + 3 * s * t**2 * second + t**3 * end)


__all__ = ["path_to_polylines", "to_pixels"]
