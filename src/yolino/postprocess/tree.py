"""The paper's linker for TuSimple: successors, breadth-first trees, level averages, a spline."""

from __future__ import annotations

from typing import NamedTuple, no_type_check

import numpy as np
from numpy.typing import NDArray

from yolino.compiled import compiled
from yolino.postprocess.forest import average_levels, cut_branches, cut_cycles, find_successors, leaves_first
from yolino.postprocess.inputs import (
    check_not_negative,
    check_positive,
    check_segments,
    segment_arrays,
    traced_lines,
)
from yolino.postprocess.outlines import class_votes, outline, smooth_outlines
from yolino.postprocess.sorting import sort_segments
from yolino.postprocess.spline import SmoothingSpline
from yolino.types import Polylines, Segments


class LinkCounts(NamedTuple):
    """What a `TreeLinker` took away.

    Attributes:
        downward: Segments that point downwards too much.
        cycles: Cycles of successors, each cut at its widest link.
        branches: Branches that are another line than the one they end at, and became a polyline of their own.
        short: Polylines with too few levels, too little length or too low a score.
    """

    downward: int
    cycles: int
    branches: int
    short: int


class TreeLinker:
    """Links segments to polylines as the paper does for TuSimple (paper, appendix), without losing lines.

    As printed: segments that point downwards are discarded; the successor of a segment is the one whose
    start is nearest to its end, within `successor_radius_cells`; from each segment without a successor a
    breadth-first search goes back; the segments on one level are averaged, weighted by score; short
    polylines are dropped; a smoothing spline goes through the midpoints and both outer end points.

    Added, so that no line is lost: a successor must lie ahead; a cycle of successors is cut at its widest
    link; and lines that merely end at the same segment, as lanes do at a vanishing point, are not averaged:
    branches more than `branch_radius_cells` apart become polylines of their own. The order of the segments
    does not matter.

    The score of a polyline is the mean of its levels' scores by length, its label is voted by score, length
    and class probability. With `directed=False` all segments are turned upwards first (sideways ones to the
    right).

    Args:
        cell_size: Side of a cell (the stride of the network) in the pixels of the segments.
        directed: Whether the two directions of a segment differ.
        successor_radius_cells: A successor starts nearer than this.
        branch_radius_cells: Largest distance between branches that are averaged.
        max_downward_cells: Largest descent of a segment from start to end; None keeps all. Ignored if
            undirected.
        image_height: Height of the image in pixels: no successor starts in the bottom half of the last row
            of cells. None where that does not matter.
        min_segments: Fewest levels of a polyline (the paper's tau_s, there 10).
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
        successor_radius_cells: float = 0.75,
        branch_radius_cells: float = 0.75,
        max_downward_cells: float | None = 0.25,
        image_height: float | None = None,
        min_segments: int = 1,
        min_length_cells: float = 2.0,
        min_score: float = 0.0,
        smoothing: float = 0.05,
    ) -> None:
        check_positive(cell_size=cell_size, successor_radius_cells=successor_radius_cells)
        check_not_negative(branch_radius_cells=branch_radius_cells, min_segments=min_segments)
        check_not_negative(min_length_cells=min_length_cells, min_score=min_score)
        check_not_negative(max_downward_cells=max_downward_cells or 0.0, image_height=image_height or 0.0)
        self._cell_size = float(cell_size)
        self._directed = bool(directed)
        self._steepest = np.inf if max_downward_cells is None else float(max_downward_cells)
        self._lowest = np.inf if image_height is None else image_height / cell_size - 0.5
        self._radii = (float(successor_radius_cells), float(branch_radius_cells))
        self._levels, self._least = int(min_segments), (float(min_length_cells), float(min_score))
        self._spline = SmoothingSpline(smoothing).rule

    def __call__(self, segments: Segments) -> Polylines:
        """Gives the polylines of the segments, in the same pixels."""
        return self.link_with_counts(segments)[0]

    def link_with_counts(self, segments: Segments) -> tuple[Polylines, LinkCounts]:
        """Gives the polylines of the segments, in the same pixels, and what was taken away on the way."""
        check_segments(*segment_arrays(segments)[:2])
        if not self._directed:
            segments = segments.with_endpoints(_turn_upwards(segments.endpoints))
        drop = segments.endpoints[:, 1, 1] - segments.endpoints[:, 0, 1]
        upwards = drop <= self._steepest * self._cell_size
        downward = len(segments) - int(np.count_nonzero(upwards))
        if downward:
            segments = segments[upwards]
        if len(segments) == 0:
            none = Polylines(np.zeros((0, 2)), probabilities=segments.probabilities)
            return none, LinkCounts(downward, 0, 0, 0)
        rules = (self._cell_size, self._radii, self._lowest, self._levels, self._least, self._spline)
        found, cycles, branches, trees = _link(*segment_arrays(segments), rules)
        lines = traced_lines(found, segments)
        return lines, LinkCounts(downward, cycles, branches, trees - len(lines))


def _turn_upwards(endpoints: NDArray[np.float64]) -> NDArray[np.float64]:
    dx, dy = (endpoints[:, 1] - endpoints[:, 0]).T
    down = (dy > 0) | ((dy == 0) & (dx < 0))
    return np.where(down[:, None, None], endpoints[:, ::-1], endpoints)


@compiled
@no_type_check
def _link(endpoints, scores, labels, probabilities, rules):
    """Gives the polylines of segments (see `smooth_outlines`), and how many cycles, branches and trees."""
    cell_size, radii, lowest, levels, least, spline = rules
    names, votes = class_votes(labels, probabilities)
    endpoints, scores, votes = sort_segments(endpoints, scores, labels, votes, cell_size)
    successors, gaps = find_successors(endpoints, radii[0], lowest)
    cycles = cut_cycles(successors, gaps)
    order = leaves_first(successors)
    trees, branches = cut_branches(endpoints, (successors, gaps), order, radii[1])
    lines, means, chances, offsets = average_levels((endpoints, scores, votes), successors, trees, order)
    open_ends = np.zeros(len(offsets) - 1, np.bool_)
    outlines = outline((offsets, open_ends), lines, means, chances)
    for c in range(len(open_ends)):
        if offsets[c + 1] - offsets[c] < levels:
            outlines[2][c] = 0.0  # as if it had no length: it is left out
    return smooth_outlines(outlines, names, least, spline, cell_size), cycles, branches, len(open_ends)
