"""The graph of a skeleton: branches between nodes, without spurs, each crossing one node."""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float, Int

from yolino.geometry import cumulative_length

# A ring of a node and so few pixels encloses one pixel at most.
_NO_RING = 3
# Two junctions of lines of one pixel are the same if one pixel lies between them.
_TOUCHING = 1.0
# Lines that cross at 20 degrees lie on each other for so many times their width, as thinning sees it.
_DRAWN_OUT = 5.0
# Least number of pixels that tell the direction of a line.
_ARM = 6
# Least eigenvalue that says where lines meet: 1 - cos of 26 degrees between two of them.
_ACROSS = 0.1
# Cosine of the angle between the two halves of a straight line, 20 degrees of bend at most.
_STRAIGHT = -0.94

Points = Float[np.ndarray, "_ 2"]
Vector = Float[np.ndarray, " 2"]


class Branches:
    """Branches of a skeleton, as the points between two nodes: junctions, free ends, or none for a ring.

    Args:
        paths: The points of each branch between its nodes, in pixels.
        ends: The nodes at the start and the end of each branch; -1 and -1: a ring without a node.
        places: Where each node is.
        radii: Half the width of the line at each node.
    """

    def __init__(
        self,
        paths: Sequence[Points],
        ends: Sequence[Sequence[int]],
        places: Float[np.ndarray, "n 2"],
        radii: Float[np.ndarray, " n"],
    ) -> None:
        self._paths: dict[int, Points] = dict(enumerate(paths))
        self._ends = {i: (a, b) for i, (a, b) in enumerate(ends)}
        self._places, self._radii = places.copy(), radii.copy()
        self._lengths = {i: self._length(i) for i in self._ends}
        self._at: defaultdict[int, list[int]] = defaultdict(list)  # a ring is twice at its node
        for i, both in self._ends.items():
            for node in both:
                if node >= 0:
                    self._at[node].append(i)

    def clean(self, spur: float, min_length: float) -> None:
        """Cuts off spurs, unites the junctions of one crossing, drops short lines.

        Args:
            spur: Branches with a free end that stick out less than this are cut off, in pixels.
            min_length: Least length of what is connected, in pixels.
        """
        for i in [i for i, (a, b) in self._ends.items() if a == b >= 0 and len(self._paths[i]) <= _NO_RING]:
            self._remove(i)
        self._join_all()
        self._prune(spur)
        self._unite()
        self._join_all()
        self._drop_short(min_length)
        for node in [node for node, around in self._at.items() if len(around) > 2]:
            self._settle(node)

    def free_ends(self) -> list[int]:
        """Gives the nodes that end a line."""
        ends = [node for both in self._ends.values() for node in both]
        return [node for node in ends if node >= 0 and len(self._at[node]) == 1]

    def line_from(self, node: int) -> Points:
        """Gives the points of the line that ends at a node, which is the first of them."""
        (branch,) = self._at[node]
        return self._line(branch)[:: 1 if self._ends[branch][0] == node else -1]

    def move_end(self, node: int, place: Vector, dropped: int = 0) -> None:
        """Moves a free end, and drops the points of its line next to it."""
        (branch,) = self._at[node]
        path, self._places[node] = self._paths[branch], place
        at_start = self._ends[branch][0] == node
        self._paths[branch] = path[dropped:] if at_start else path[: len(path) - dropped]
        self._lengths[branch] = self._length(branch)

    def lines(self) -> Iterator[Points]:
        """Yields the points of each branch with its nodes; rings end where they begin."""
        for i in self._ends:
            line = self._line(i)
            if self._ends[i][0] < 0:
                first = np.lexsort(line[:-1].T[::-1])[0]
                line = np.roll(line[:-1], -first, axis=0)
                line = np.concatenate([line, line[:1]])
            yield line

    def _line(self, branch: int) -> Points:
        a, b = self._ends[branch]
        path = self._paths[branch]
        if a < 0:
            return np.concatenate([path, path[:1]])
        return np.concatenate([self._places[a : a + 1], path, self._places[b : b + 1]])

    def _length(self, branch: int) -> float:
        return float(cumulative_length(self._line(branch))[-1])

    def _remove(self, branch: int) -> None:
        for node in self._ends.pop(branch):
            if node >= 0:
                self._at[node].remove(branch)
        del self._paths[branch], self._lengths[branch]

    def _join_all(self) -> None:
        for node in range(len(self._places)):
            self._join(node)

    def _join(self, node: int) -> int | None:
        """Makes one branch of the two at a node that is no junction any more, and gives it."""
        if len(self._at[node]) != 2 or self._at[node][0] == self._at[node][1]:
            return None
        first, second = self._at[node]
        (a, b), (c, d) = self._ends[first], self._ends[second]
        before, after = self._paths[first], self._paths[second]
        if a == node:
            a, before = b, before[::-1]
        if d == node:
            d, after = c, after[::-1]
        self._lengths[first] += self._lengths[second]
        self._remove(second)
        # Thinning bends a line towards its branches: where there is none any more, it goes straight on.
        before, after = self._outside(before, node), self._outside(after, node)
        middle = self._places[node : node + 1] if min(len(before), len(after)) == 0 else before[:0]
        self._paths[first] = np.concatenate([before, middle, after])
        self._ends[first] = (a, d)
        self._at[node].clear()
        self._at[d].append(first)
        return first

    def _outside(self, path: Points, node: int) -> Points:
        """Gives the points that lie farther from a node than half the width of the line there, if any."""
        away = path - self._places[node]
        outside = path[np.hypot(away[:, 0], away[:, 1]) > self._radii[node]]
        return outside if len(outside) else path

    def _overhang(self, branch: int) -> float | None:
        """Gives how far a branch with one free end sticks out of the line it leaves, in pixels."""
        a, b = self._ends[branch]
        inner = [node for node in (a, b) if node >= 0 and len(self._at[node]) > 1]
        return self._lengths[branch] - float(self._radii[inner[0]]) if len(inner) == 1 else None

    def _prune(self, spur: float) -> None:
        """Cuts off branches with one free end, the shortest first."""
        queue = [(over, i) for i in self._ends if (over := self._overhang(i)) is not None and over < spur]
        heapq.heapify(queue)
        while queue:
            over, i = heapq.heappop(queue)
            if i not in self._ends or self._overhang(i) != over:
                continue  # it has grown since
            nodes = self._ends[i]
            self._remove(i)
            for node in nodes:
                joined = self._join(node)
                changed = None if joined is None else self._overhang(joined)
                if joined is not None and changed is not None and changed < spur:
                    heapq.heappush(queue, (changed, joined))

    def _unite(self) -> None:
        """Makes one node of junctions that lie in the same crossing: their lines overlap between them."""
        inside = [i for i in self._ends if self._is_in_crossing(i)]
        if not inside:
            return
        pairs = np.array([self._ends[i] for i in inside])
        for i in inside:
            self._remove(i)
        count = len(self._places)
        groups = _components(pairs, count)
        for group in np.unique(groups[pairs]):
            self._unite_nodes(np.flatnonzero(groups == group))

    def _is_in_crossing(self, branch: int) -> bool:
        """Tells whether a branch is where lines cross that lie on each other along it.

        So it is where the circles that touch both sides of the lines at its ends meet, and where two lines
        run straight through its middle (thinning draws narrow crossings out).
        """
        a, b = self._ends[branch]
        if a == b or min(len(self._at[a]), len(self._at[b])) <= 2:
            return False
        length, width = self._lengths[branch], float(self._radii[a] + self._radii[b])
        if length <= width + _TOUCHING:
            return True
        if length > _DRAWN_OUT * width + 2 * _ARM or len(self._at[a]) + len(self._at[b]) != 6:
            return False
        center, start = self._places[[a, b]].mean(axis=0), (length + width) / 2
        arms = [self._arm(i, node, center, start) for node in (a, b) for i in self._at[node] if i != branch]
        units = np.array([unit for unit, offset in arms if offset <= 1 + width / 4])
        if len(units) != 4:
            return False
        straight = units[:2] @ units[2:].T < _STRAIGHT
        return bool((straight[0, 0] and straight[1, 1]) or (straight[0, 1] and straight[1, 0]))

    def _arm(self, branch: int, node: int, center: Vector, start: float) -> tuple[Vector, float]:
        """Gives the direction to a branch's part that begins `start` away from a center, as a unit vector.

        And how far the line through that part passes by the center; infinite where the branch is too short.
        """
        line = self._line(branch) - center
        line = line[::-1] if self._ends[branch][1] == node else line
        away = np.flatnonzero(np.hypot(line[:, 0], line[:, 1]) >= start)
        part = line[away[0] :][: int(_ARM + start)] if len(away) else line[:0]
        if len(part) < _ARM:
            return center, np.inf
        mean, along = _fit(part)
        return mean / np.hypot(*mean), float(abs(along[0] * mean[1] - along[1] * mean[0]))

    def _unite_nodes(self, nodes: Int[np.ndarray, " k"]) -> None:
        """Makes one node of several; branches lead straight to it from where their lines separate."""
        place, radius = self._places[nodes].mean(axis=0), self._radii[nodes].max()
        reach = float(np.hypot(*(self._places[nodes] - place).T).max() + radius)
        keep = int(nodes[0])
        self._places[keep], self._radii[keep] = place, radius
        around = sorted({i for node in nodes.tolist() for i in self._at.pop(node, [])})
        for i in around:
            a, b = (keep if node in nodes else node for node in self._ends[i])
            path = self._paths[i]
            outside = np.flatnonzero(np.hypot(*(path - place).T) > reach)
            first = outside[0] if a == keep and len(outside) else 0
            last = outside[-1] + 1 if b == keep and len(outside) else len(path)
            self._paths[i], self._ends[i] = path[first:last], (a, b)
            self._lengths[i] = self._length(i)
            self._at[keep] += [i] * ((a == keep) + (b == keep))

    def _settle(self, node: int) -> None:
        """Moves a junction to where its branches would meet if they went straight on.

        Thinning puts it beside that place, and bends the branches within the width of their lines.
        """
        reach = float(self._radii[node]) + _TOUCHING
        total, target, seen = np.zeros((2, 2)), np.zeros(2), set[int]()
        for i in self._at[node]:
            forwards = self._ends[i][0] == node and i not in seen
            seen.add(i)
            path = self._paths[i] if forwards else self._paths[i][::-1]
            away = path - self._places[node]
            first = int(np.argmax(np.append(np.hypot(away[:, 0], away[:, 1]) > reach, True)))
            part = path[first : first + _ARM + int(reach)]
            if len(part) >= _ARM // 2:
                mean, along = _fit(part)
                across = np.eye(2) - np.outer(along, along)
                total, target = total + across, target + across @ mean
        if np.linalg.eigvalsh(total)[0] < _ACROSS:
            return
        found = np.linalg.solve(total, target)
        if np.hypot(*(found - self._places[node])) <= reach:
            self._places[node] = found
            for i in seen:
                self._paths[i] = self._outside(self._paths[i], node)

    def _drop_short(self, least: float) -> None:
        """Drops lines that are, with all that is connected, shorter than `least`."""
        rings = [i for i, (a, _) in self._ends.items() if a < 0]
        others = [i for i, (a, _) in self._ends.items() if a >= 0]
        short = [i for i in rings if self._lengths[i] < least]
        if others:
            ends = np.array([self._ends[i] for i in others])
            count = len(self._places)
            owners = _components(ends, count)[ends[:, 0]]
            totals = np.bincount(owners, [self._lengths[i] for i in others])
            short += [i for i, owner in zip(others, owners, strict=True) if totals[owner] < least]
        for i in short:
            self._remove(i)


def _components(pairs: Int[np.ndarray, "n 2"], count: int) -> Int[np.ndarray, " count"]:
    """Gives for each of `count` nodes the number of the component that pairs of them make."""
    from scipy.sparse import coo_array  # takes half a second, which who reads no masks need not wait
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])


def _fit(points: Points) -> tuple[Vector, Vector]:
    """Gives the mean of points and the direction in which they spread most, as a unit vector."""
    mean = points.mean(axis=0)
    return mean, np.linalg.svd(points - mean)[2][0]


__all__ = ["Branches"]
