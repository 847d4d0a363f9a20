"""The linker for lines of any shape: branches, merges, crossings, loops, and where the class changes."""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from yolino.compiled import compiled
from yolino.postprocess.chaining import chain_segments
from yolino.postprocess.extensions import extend_lines, wrap_rings
from yolino.postprocess.inputs import (
    check_not_negative,
    check_positive,
    check_segments,
    segment_arrays,
    traced_lines,
)
from yolino.postprocess.junctions import join_lines
from yolino.postprocess.outlines import class_votes
from yolino.postprocess.pieces import cut_curves
from yolino.postprocess.sorting import sort_segments
from yolino.postprocess.spline import SmoothingSpline, smooth_chains
from yolino.postprocess.traces import arc_lengths, trace_lines
from yolino.types import Polylines, Segments

# As in ChainLinker: how far ends may run past each other; how far either may lie beside the other's line;
# that per cell of the gap; the weights of that distance and of the turn; how many times half the longer one
# a gap may be long.
_LINK = (0.5, 0.5, 0.0, 4.0, 1.0, np.inf)
_JOIN = (2.0, 0.5, 0.2, 1.0, 1.0, 4.0)
_STRAIGHT = 0.7  # least cosine between chains joined over a gap
_PARALLEL = 0.9  # least cosine between duplicates
_SHARE = 0.5  # of its length that makes a chain a duplicate
_CORE = 0.9  # cells: a chain with a stretch of its own as long as this is none
_WEIGHTS = (
    0.5,
    0.25,
)  # what classes without anything in common, and a score of nothing, add to a link's cost
_MARGIN = 2.0  # duplicate radii: a chain that leaves another and comes back within these repeats it
_SNAP = 0.75  # cells: junctions on one line that are nearer are one


class GraphLinker:
    """Links segments to a graph: polylines that share a vertex exactly where they branch, merge or meet.

    1. Links. Of all pairs of an end and a start within `link_radius_cells` the best is linked first, then
       the best of those left, and so on. A good link has a small gap, lies on the lines of both segments,
       keeps the direction, the class and the score. So lines that cross go straight on.
    2. Duplicates. A chain of which more than half lies within `duplicate_radius_cells` of stronger chains,
       and in their direction, is dropped, unless a stretch of it leads elsewhere.
    3. Gaps. The ends of chains are joined in the same way, up to `max_gap_cells`, along their direction.
    4. Junctions. An end that is still loose meets the line that it lies on (within `link_radius_cells`) or
       that its direction leads to (within `max_gap_cells`), if the directions there differ by at most
       `max_branch_turn`. Both get the same vertex, and the line that goes on is cut there: of a fork one
       polyline comes in and several go out. A short line is dropped if an end of it is loose; between two
       junctions it stays.
    5. Classes. Where the class changes for at least `min_class_cells`, the polyline is cut (the best runs by
       score, length and class probability; near a junction it is cut at the junction).
    6. Curves. A smoothing spline through the places where segments meet. Loose ends and junctions stay
       exactly where they are.

    The score of a polyline is the mean of its segments' scores by length, where gaps count as zero; its class
    probabilities are the mean by score and length. The order of the segments does not matter. A closed line
    ends exactly where it begins. With `directed=False` both directions of a segment are one, a line that
    ends at another's side meets it at any angle, and a line points where most of it does.

    Args:
        cell_size: Side of a cell (the stride of the network) in the pixels of the segments.
        directed: Whether the two directions of a segment differ.
        link_radius_cells: Largest gap within a chain, and distance from an end to the line that it meets.
        max_turn: Largest angle between linked segments, in radians.
        max_branch_turn: Largest angle between a directed line and one that it grows out of or runs into, in
            radians.
        max_gap_cells: Largest gap that is bridged; 0 bridges none. The default is what one lost segment
            leaves; the gaps between painted dashes are longer.
        duplicate_radius_cells: Distance at which a parallel chain is a duplicate; 0 keeps all.
        min_length_cells: Shortest line with a loose end.
        min_score: Lowest score of a chain.
        min_class_cells: Shortest stretch of another class that cuts a line.
        split_classes: Whether lines are cut where the class changes.
        smoothing: See `SmoothingSpline`; in squared cells. 0 keeps the vertices as they are.

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
        max_branch_turn: float = np.pi / 3,
        max_gap_cells: float = 2.0,
        duplicate_radius_cells: float = 0.35,
        min_length_cells: float = 2.0,
        min_score: float = 0.0,
        min_class_cells: float = 3.0,
        split_classes: bool = True,
        smoothing: float = 0.05,
    ) -> None:
        check_positive(cell_size=cell_size, link_radius_cells=link_radius_cells)
        check_not_negative(max_gap_cells=max_gap_cells, duplicate_radius_cells=duplicate_radius_cells)
        check_not_negative(min_length_cells=min_length_cells, min_score=min_score)
        check_positive(min_class_cells=min_class_cells)
        for name, angle in {"max_turn": max_turn, "max_branch_turn": max_branch_turn}.items():
            if not 0 < angle < np.pi:
                raise ValueError(f"{name} is {angle}, but an angle between 0 and pi (radians) is needed.")
        radius, gap = float(link_radius_cells), float(max_gap_cells)
        chaining = (
            bool(directed),
            (radius, float(np.cos(max_turn)), *_LINK),
            (float(duplicate_radius_cells), _PARALLEL, _SHARE, _CORE),
            (gap, _STRAIGHT, *_JOIN),
        )
        meeting = (radius, gap, float(np.cos(max_branch_turn)) if directed else 0.0)
        joining = (meeting, _SNAP, float(min_length_cells), _MARGIN * float(duplicate_radius_cells))
        shortest_run = float(min_class_cells) if split_classes else 0.0
        rules = chaining, joining, float(min_score)
        self._rules = (float(cell_size), rules, shortest_run, SmoothingSpline(smoothing).rule)

    def __call__(self, segments: Segments) -> Polylines:
        """Gives the polylines of the segments, in the same pixels."""
        if len(segments) == 0:
            return Polylines(np.zeros((0, 2)), probabilities=segments.probabilities)
        return traced_lines(_link(*segment_arrays(segments), self._rules), segments)


@compiled
@no_type_check
def _link(endpoints, scores, labels, probabilities, rules):
    """Gives the polylines of segments, both in pixels: vertices, offsets, scores, labels and class shares."""
    check_segments(endpoints, scores)
    cell_size, line_rules, shortest_run, spline = rules
    names, votes = class_votes(labels, probabilities)
    endpoints, scores, votes = sort_segments(endpoints, scores, labels, votes, cell_size)
    lines, joints, strokes = _find_lines(endpoints, scores, votes, line_rules)
    vertices, bounds, means, shares = cut_curves(_smooth(lines, spline), lines, joints, strokes, shortest_run)
    for i in range(len(vertices)):
        vertices[i, 0], vertices[i, 1] = vertices[i, 0] * cell_size, vertices[i, 1] * cell_size
    winners = np.empty(len(means), np.int64)
    for i in range(len(means)):
        winners[i] = names[np.argmax(shares[i])]
    return vertices, bounds, means, winners, shares


@compiled
@no_type_check
def _smooth(lines, spline):
    """Gives smooth points through lines, where those of each begin, and their arc lengths on the line."""
    if spline[2] == 0:
        return lines[0], lines[1], arc_lengths(lines[0], lines[1])
    points, offsets, leads = wrap_rings(lines[0], lines[1], lines[2])
    chosen, count = np.empty(len(leads), np.int64), 0
    for c in range(len(leads)):
        if offsets[c + 1] > offsets[c]:
            chosen[count] = c
            count += 1
    samples, sizes = smooth_chains(points, offsets, chosen[:count], spline)
    bounds, count = np.zeros_like(offsets), 0
    for c in range(len(leads)):
        count += offsets[c + 1] > offsets[c]
        bounds[c + 1] = sizes[count]
    return samples, bounds, _even(points, offsets, bounds, leads)


@compiled
@no_type_check
def _even(points, offsets, bounds, leads):
    """Gives the arc lengths of samples that lie evenly along lines, from `leads` before their starts on."""
    arcs = arc_lengths(points, offsets)
    at = np.empty(bounds[-1])
    for c in range(len(leads)):
        first, stop = bounds[c], bounds[c + 1]
        for i in range(first, stop):
            at[i] = arcs[offsets[c + 1] - 1] * ((i - first) / (stop - first - 1)) - leads[c]
    return at


@compiled
@no_type_check
def _find_lines(endpoints, scores, votes, rules):
    """Gives the lines of sorted segments, their junctions, and what each line is made of, in cell units."""
    chaining, joining, lowest = rules
    directed = chaining[0]
    offsets, rings, endpoints, scores, votes = chain_segments(endpoints, scores, votes, chaining, _WEIGHTS)
    points, starts, spans = trace_lines(offsets, rings, endpoints)
    arcs = arc_lengths(points, starts)
    lengths = np.empty(len(endpoints))
    for p in range(len(endpoints)):
        dx, dy = endpoints[p, 1, 0] - endpoints[p, 0, 0], endpoints[p, 1, 1] - endpoints[p, 0, 1]
        lengths[p] = np.sqrt(dx * dx + dy * dy)
    alive = _find_alive((offsets, lengths, scores), (arcs, starts), lowest)
    for c in range(len(rings)):
        rings[c] &= points[starts[c], 0] == points[starts[c + 1] - 1, 0]
        rings[c] &= points[starts[c], 1] == points[starts[c + 1] - 1, 1]
    lines = (points, arcs, starts)
    spots, ends, passes = join_lines(lines, rings, alive, directed, joining)
    longer, bounds, shifts = extend_lines(lines, rings, alive, (spots, ends, passes))
    intervals = _shift((offsets, spans, passes[1]), (arcs, rings), (longer, bounds, shifts), passes[0])
    return (longer, bounds, rings), (spots, ends, passes), (offsets, (lengths, scores, votes), intervals)


@compiled
@no_type_check
def _find_alive(segments, lines, lowest):
    """Tells which lines have length and score enough."""
    offsets, lengths, scores = segments
    arcs, starts = lines
    alive = np.zeros(len(starts) - 1, np.bool_)
    for c in range(len(alive)):
        covered = total = 0.0
        for p in range(offsets[c], offsets[c + 1]):
            covered += lengths[p]
            total += lengths[p] * scores[p]
        length = arcs[starts[c + 1] - 1]
        alive[c] = length > 0 and covered > 0 and total >= lowest * max(covered, length * (1 - 1e-9))
    return alive


@compiled
@no_type_check
def _shift(places, old, new, owners):
    """Gives the arc lengths of segments on the extended lines, and moves those of the passes."""
    offsets, spans, passes = places
    arcs, rings = old
    longer, bounds, shifts = new
    lengths = arc_lengths(longer, bounds)
    intervals = np.zeros((len(spans), 2))
    for c in range(len(rings)):
        if bounds[c + 1] == bounds[c]:
            continue
        length = lengths[bounds[c + 1] - 1]
        for p in range(offsets[c], offsets[c + 1]):
            low, high = arcs[spans[p, 0]] + shifts[c], arcs[spans[p, 1]] + shifts[c]
            if rings[c] and low < 0:
                low, high = low + length, high + length
            if not rings[c]:
                low, high = min(max(low, 0.0), length), min(max(high, 0.0), length)
            intervals[p, 0], intervals[p, 1] = low, high
    for i in range(len(passes)):
        c = owners[i]
        if bounds[c + 1] > bounds[c]:
            passes[i] = min(max(passes[i] + shifts[c], 0.0), lengths[bounds[c + 1] - 1])
    return intervals
