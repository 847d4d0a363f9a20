"""The better linker: mutually best links, duplicates dropped, gaps joined, a spline through each chain."""

from __future__ import annotations

from typing import no_type_check

import numpy as np
from numba import njit

from yolino.postprocess.duplicates import find_originals
from yolino.postprocess.inputs import check_not_negative, check_positive, check_segments, segment_arrays
from yolino.postprocess.links import match_nodes, segment_nodes, trace_chains
from yolino.postprocess.outlines import class_votes, outline, smooth_outlines
from yolino.postprocess.sorting import sort_segments
from yolino.postprocess.spline import SmoothingSpline
from yolino.types import Polylines, Segments

# Cells: how far ends of linked segments (joined chains) may run past each other; how far either may lie
# beside the other's line; that per cell of the gap. Then the weights of that distance, and of 1 - cosine of
# the turn, in the cost beside the gap's length; and how many times half the longer one a gap may be long.
_LINK = (0.5, 0.5, 0.0, 4.0, 1.0, np.inf)
_JOIN = (1.5, 0.5, 0.2, 1.0, 1.0, 4.0)
_LOOK_BACK = 3.0  # cells at a chain's end that tell its direction
_STRAIGHT = 0.7  # least cosine between joined chains, and between duplicates
_SHARE = 0.5  # of its length that makes a chain a duplicate


class ChainLinker:
    """Links segments to polylines that neither branch nor share segments.

    1. Links. Of all pairs of an end and a start within `link_radius_cells` the best is linked first, then
       the best of those left, and so on. A good link has a small gap, lies on the lines of both segments
       and keeps the direction.
    2. Duplicates. A chain of which more than half lies within `duplicate_radius_cells` of stronger chains,
       and in their direction, is dropped.
    3. Gaps. The ends of chains are joined in the same way, up to `max_gap_cells`, along their direction.
    4. Curves. A smoothing spline through the midpoints and both outer end points.

    The score of a polyline is the mean of its segments' scores by length, where gaps count as zero; its
    label is voted by score, length and class probability. The order of the segments does not matter. A
    closed line ends where it begins. With `directed=False` both directions of a segment are one, and a
    polyline points where most of it does.

    Args:
        cell_size: Side of a cell (the stride of the network) in the pixels of the segments.
        directed: Whether the two directions of a segment differ.
        link_radius_cells: Largest gap within a chain.
        max_turn: Largest angle between linked segments, in radians.
        max_gap_cells: Largest gap that is joined; 0 joins none.
        duplicate_radius_cells: Distance at which a parallel chain is a duplicate; 0 keeps all.
        min_length_cells: Shortest polyline. A length that means something in the image is better given as
            pixels divided by `cell_size`.
        min_score: Lowest score of a polyline.
        smoothing: See `SmoothingSpline`; in squared cells.

    Raises:
        ValueError: If a parameter is out of range; when called, if end points or scores are not finite or a
            score is negative.
    """

    def __init__(
        self,
        cell_size: float,
        *,
        directed: bool = True,
        link_radius_cells: float = 0.75,
        max_turn: float = np.pi / 3,
        max_gap_cells: float = 6.0,
        duplicate_radius_cells: float = 0.75,
        min_length_cells: float = 2.0,
        min_score: float = 0.0,
        smoothing: float = 0.05,
    ) -> None:
        check_positive(cell_size=cell_size, link_radius_cells=link_radius_cells)
        check_not_negative(max_gap_cells=max_gap_cells, duplicate_radius_cells=duplicate_radius_cells)
        check_not_negative(min_length_cells=min_length_cells, min_score=min_score)
        if not 0 < max_turn < np.pi:
            raise ValueError(f"max_turn is {max_turn}, but an angle between 0 and pi (radians) is needed.")
        self._cell_size = float(cell_size)
        self._link = (float(link_radius_cells), float(np.cos(max_turn)), *_LINK)
        self._join = (float(max_gap_cells), _STRAIGHT, *_JOIN)
        self._duplicate = (float(duplicate_radius_cells), _STRAIGHT, _SHARE)
        self._directed = bool(directed)
        self._least = (float(min_length_cells), float(min_score))
        self._spline = SmoothingSpline(smoothing)

    def __call__(self, segments: Segments) -> Polylines:
        """Gives the polylines of the segments, in the same pixels."""
        if len(segments) == 0:
            return Polylines(np.zeros((0, 2)), np.zeros(1, np.int64))
        check_segments(segments)
        endpoints, scores, labels, probabilities = segment_arrays(segments)
        names, votes = class_votes(labels, probabilities)
        rules = (self._directed, self._link, self._duplicate, self._join)
        points, starts, lengths, means, winners = _link(
            endpoints / self._cell_size, scores, labels, votes, rules
        )
        kept = (lengths > 0) & (lengths >= self._least[0]) & (means >= self._least[1])
        return smooth_outlines((points, starts, means, names[winners]), kept, self._spline, self._cell_size)


@njit(cache=True, error_model="numpy")
@no_type_check
def _link(endpoints, scores, labels, votes, rules):
    """Gives the outlines of the chains of segments in cell units, see `outline`."""
    directed, link_rule, duplicate_rule, join_rule = rules
    endpoints, scores, votes = sort_segments(endpoints, scores, labels, votes)
    partners, costs = match_nodes(segment_nodes(endpoints), directed, link_rule)
    items, flips, offsets, rings = trace_chains(partners, costs, directed)
    if duplicate_rule[0] > 0:
        kept = find_originals((items, offsets), endpoints, scores, directed, duplicate_rule)
        items, flips, offsets, rings = _choose(kept, items, flips, offsets, rings)
    if join_rule[0] > 0:
        partners, costs = match_nodes(
            _chain_nodes(endpoints, items, flips, offsets, rings), directed, join_rule
        )
        links = trace_chains(partners, costs, directed)
        items, flips, offsets, rings = _concatenate(links, items, flips, offsets, rings)
    if not directed:
        _turn_to_majority(endpoints, items, flips, offsets)
    lines, means, chances = (
        np.empty((len(items), 2, 2)),
        np.empty(len(items)),
        np.empty((len(items), votes.shape[1])),
    )
    for p in range(len(items)):
        i, start = items[p], int(flips[p])
        for k in range(2):
            lines[p, 0, k], lines[p, 1, k] = endpoints[i, start, k], endpoints[i, 1 - start, k]
        means[p] = scores[i]
        for k in range(votes.shape[1]):
            chances[p, k] = votes[i, k]
    return outline((offsets, rings), lines, means, chances)


@njit(cache=True, error_model="numpy")
@no_type_check
def _choose(kept, items, flips, offsets, rings):
    """Gives the kept chains."""
    count = filled = 0
    offsets = offsets.copy()
    begin = 0
    for c in range(len(kept)):
        stop = offsets[c + 1]
        if kept[c]:
            for p in range(begin, stop):
                items[filled], flips[filled] = items[p], flips[p]
                filled += 1
            rings[count] = rings[c]
            count += 1
            offsets[count] = filled
        begin = stop
    return items[:filled], flips[:filled], offsets[: count + 1], rings[:count]


@njit(cache=True, error_model="numpy")
@no_type_check
def _chain_nodes(endpoints, items, flips, offsets, rings):
    """Gives the nodes of chains (see `links`), each with the direction of the last `_LOOK_BACK` cells."""
    nodes = np.zeros((2 * (len(offsets) - 1), 5))
    for c in range(len(offsets) - 1):
        for end in range(2):
            outer = offsets[c + 1] - 1 if end else offsets[c]
            x = y = walked = 0.0
            for k in range(offsets[c + 1] - offsets[c]):
                p = outer - k if end else outer + k
                dx, dy = _way(endpoints, items[p])
                if walked < _LOOK_BACK:
                    way = 1.0 if flips[p] != (end == 1) else -1.0
                    x, y = x + way * dx, y + way * dy
                walked += np.sqrt(dx * dx + dy * dy)
            norm = np.sqrt(x * x + y * y)
            scale = 1 / norm if norm > 0 and not rings[c] else 0.0  # without a direction nothing is linked
            i, tip, node = items[outer], end ^ int(flips[outer]), 2 * c + end
            nodes[node, 0], nodes[node, 1] = endpoints[i, tip, 0], endpoints[i, tip, 1]
            nodes[node, 2], nodes[node, 3], nodes[node, 4] = x * scale, y * scale, walked / 2
    return nodes


@njit(cache=True, error_model="numpy", inline="always")
@no_type_check
def _way(endpoints, i):
    return endpoints[i, 1, 0] - endpoints[i, 0, 0], endpoints[i, 1, 1] - endpoints[i, 0, 1]


@njit(cache=True, error_model="numpy")
@no_type_check
def _concatenate(links, items, flips, offsets, rings):
    """Gives the chains of chains."""
    chains, backwards, groups, closed = links
    new_items, new_flips = np.empty_like(items), np.empty_like(flips)
    new_offsets, new_rings = np.zeros(len(groups), np.int64), closed.copy()
    filled = 0
    for g in range(len(groups) - 1):
        for q in range(groups[g], groups[g + 1]):
            c = chains[q]
            new_rings[g] |= rings[c]
            for k in range(offsets[c + 1] - offsets[c]):
                p = offsets[c + 1] - 1 - k if backwards[q] else offsets[c] + k
                new_items[filled], new_flips[filled] = items[p], flips[p] != backwards[q]
                filled += 1
        new_offsets[g + 1] = filled
    return new_items, new_flips, new_offsets, new_rings


@njit(cache=True, error_model="numpy")
@no_type_check
def _turn_to_majority(endpoints, items, flips, offsets):
    """Reverses the chains that run against most of their segments' length."""
    for c in range(len(offsets) - 1):
        first, stop = offsets[c], offsets[c + 1]
        balance = 0.0
        for p in range(first, stop):
            dx, dy = _way(endpoints, items[p])
            balance += (-1.0 if flips[p] else 1.0) * np.sqrt(dx * dx + dy * dy)
        if balance < 0:
            for k in range((stop - first + 1) // 2):
                p, q = first + k, stop - 1 - k
                items[p], items[q] = items[q], items[p]
                flips[p], flips[q] = not flips[q], not flips[p]
