"""The better linker: mutually best links, duplicates dropped, gaps joined, a spline through each chain."""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from yolino.compiled import compiled
from yolino.postprocess.chaining import chain_segments
from yolino.postprocess.inputs import (
    check_not_negative,
    check_positive,
    check_segments,
    segment_arrays,
    traced_lines,
)
from yolino.postprocess.levels import level_ends
from yolino.postprocess.outlines import class_votes, outline, smooth_outlines
from yolino.postprocess.sorting import sort_segments
from yolino.postprocess.spline import SmoothingSpline
from yolino.types import Polylines, Segments

# Cells: how far ends of linked segments (joined chains) may run past each other; how far either may lie
# beside the other's line; that per cell of the gap. Then the weights of that distance, and of 1 - cosine of
# the turn, in the cost beside the gap's length; and how many times half the longer one a gap may be long.
_LINK = (0.5, 0.5, 0.0, 4.0, 1.0, np.inf)
_JOIN = (1.5, 0.5, 0.2, 1.0, 1.0, 4.0)
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
    4. Ends. Segments below `min_end_score` are taken off both ends of a chain, up to the first better one; in
       between they stay (hysteresis, as Canny has it for edges, PAMI 1986). A closed line has no ends.
    5. Curves. A smoothing spline through the midpoints and both outer end points.
    6. Levels. Upper ends within `level_ends_cells` of the median of all are cut off, or extended straight, to
       its row, if what is left is long enough.

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
        min_end_score: Lowest score of a segment that a polyline begins or ends with. Above the model's
            threshold it shortens lines that go on beyond what is seen, without holes within them.
        level_ends_cells: Height within which upper ends of the lines of an image come to one row; 0 leaves
            them. For cameras that look along a flat road, where lines end at the horizon.
        smoothing: See `SmoothingSpline`; in squared cells.

    Raises:
        ValueError: If a parameter is out of range; when called, if end points or scores are not finite or a
            score is negative.
    """

    def __init__(  # noqa: PLR0913 (all are options that users name)
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
        min_end_score: float = 0.0,
        level_ends_cells: float = 0.0,
        smoothing: float = 0.05,
    ) -> None:
        check_positive(cell_size=cell_size, link_radius_cells=link_radius_cells)
        check_not_negative(max_gap_cells=max_gap_cells, duplicate_radius_cells=duplicate_radius_cells)
        check_not_negative(min_length_cells=min_length_cells, min_score=min_score)
        check_not_negative(min_end_score=min_end_score, level_ends_cells=level_ends_cells)
        if not 0 < max_turn < np.pi:
            raise ValueError(f"max_turn is {max_turn}, but an angle between 0 and pi (radians) is needed.")
        chaining = (
            bool(directed),
            (float(link_radius_cells), float(np.cos(max_turn)), *_LINK),
            (float(duplicate_radius_cells), _STRAIGHT, _SHARE, np.inf),
            (float(max_gap_cells), _STRAIGHT, *_JOIN),
        )
        least = (float(min_length_cells), float(min_score))
        ends = (float(min_end_score), float(level_ends_cells))
        self._rules = (float(cell_size), chaining, ends, least, SmoothingSpline(smoothing).rule)

    def __call__(self, segments: Segments) -> Polylines:
        """Gives the polylines of the segments, in the same pixels."""
        if len(segments) == 0:
            return Polylines(np.zeros((0, 2)), probabilities=segments.probabilities)
        return traced_lines(_link(*segment_arrays(segments), self._rules), segments)


@compiled
@no_type_check
def _link(endpoints, scores, labels, probabilities, rules):
    """Gives the polylines of segments, both in pixels, see `smooth_outlines`."""
    check_segments(endpoints, scores)
    cell_size, chaining, (end_score, reach), least, spline = rules
    names, votes = class_votes(labels, probabilities)
    endpoints, scores, votes = sort_segments(endpoints, scores, labels, votes, cell_size)
    chains = chain_segments(endpoints, scores, votes, chaining)
    offsets, rings, lines, means, chances = trim_ends(chains, end_score) if end_score > 0 else chains
    outlines = outline((offsets, rings), lines, means, chances)
    curves, starts, scores, labels, shares = smooth_outlines(outlines, names, least, spline, cell_size)
    if reach > 0:
        curves, starts = level_ends(curves, starts, reach * cell_size, least[0] * cell_size, cell_size)
    return curves, starts, scores, labels, shares


@compiled
@no_type_check
def trim_ends(chains, lowest):
    """Gives the chains of `chain_segments` without the segments below a score at the ends of open ones."""
    offsets, rings, lines, means, chances = chains
    bounds, closed = np.zeros_like(offsets), np.empty_like(rings)
    kept = np.empty(len(means), np.int64)
    count = filled = 0
    for c in range(len(rings)):
        first, stop = offsets[c], offsets[c + 1]
        if not rings[c]:
            while first < stop and means[first] < lowest:
                first += 1
            while first < stop and means[stop - 1] < lowest:
                stop -= 1
        if first < stop:
            for p in range(first, stop):
                kept[filled] = p
                filled += 1
            closed[count] = rings[c]
            count += 1
            bounds[count] = filled
    kept = kept[:filled]
    return bounds[: count + 1], closed[:count], lines[kept], means[kept], chances[kept]
