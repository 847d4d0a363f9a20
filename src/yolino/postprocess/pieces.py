"""Smooth lines cut at junctions and where the class changes: vertices, scores and class shares, compiled.

A stop is a place on a line where it is cut: an arc length, and the place that the line goes through there
exactly (NaN: wherever it is). The first and the last stop of a line are its ends.
"""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from yolino.compiled import compiled
from yolino.postprocess.class_runs import class_runs
from yolino.postprocess.traces import arc_lengths, place_at

_FADE = 2.0  # cells from a stop to where the smooth line is what it was
_NEAR = 0.02  # cells: samples this near to a stop are left out
_PULL = 1.5  # cells within which a change of class moves to a junction
_LEAST = 0.25  # cells between stops
_LEVEL = 1e-9  # what is less comes from rounding
_LIGHT = 1e-12  # added to scores in the weights of classes: where all are zero, lengths alone count


@compiled
@no_type_check
def cut_curves(curves, lines, joints, segments, rule):
    """Gives the vertices of all pieces, where those of each begin, scores, and the share of each class.

    Args:
        curves: Smooth points, where those of each line begin, their arc lengths on the line.
        lines: Points, where those of each line begin, whether each is closed.
        joints: Places, junction at each end and passes (see `join_lines`), arc lengths on these lines.
        segments: Where those of each line begin; lengths, scores, votes; arc lengths at start and end.
        rule: Length of the shortest run of a class, 0 for no cuts.
    """
    samples, sizes, at = curves
    points, starts, rings = lines
    offsets, (lengths, scores, votes), intervals = segments
    arcs = arc_lengths(points, starts)
    room = len(joints[2][0]) + 2 * len(starts) + len(lengths)
    vertices, bounds = np.empty((len(samples) + 2 * room, 2)), np.zeros(room + 1, np.int64)
    means, shares = np.zeros(room), np.zeros((room, votes.shape[1]))
    filled = count = seen = 0
    for c in range(len(starts) - 1):
        if starts[c + 1] == starts[c]:
            while seen < len(joints[2][0]) and joints[2][0][seen] <= c:
                seen += 1
            continue
        first = seen
        while seen < len(joints[2][0]) and joints[2][0][seen] <= c:
            seen += 1
        span, rows = (sizes[c], sizes[c + 1]), (offsets[c], offsets[c + 1])
        length = arcs[starts[c + 1] - 1]
        own = (lengths[rows[0] : rows[1]], scores[rows[0] : rows[1]], votes[rows[0] : rows[1]])
        stops, places = _stops(
            (points, starts, c), joints, (first, seen), (own, intervals[rows[0] : rows[1]]), (length, rule)
        )
        if rings[c] and joints[1][2 * c] < 0 and first == seen:
            places[0, 0] = np.nan  # where a ring begins means nothing
        moves = _moves(samples, at, span, stops, places)
        covers = _weigh(own, intervals[rows[0] : rows[1]], stops, (length, count), shares)
        for j in range(len(stops) - 1):
            filled = _write((samples, at), span, (stops, places, moves, j), vertices, filled)
            count += 1
            bounds[count] = filled
            means[count - 1] = covers[j]
    return vertices[:filled], bounds[: count + 1], means[:count], shares[:count]


@compiled
@no_type_check
def _stops(line, joints, passing, segments, rule):
    """Gives arc lengths and places of the stops of one line, in order."""
    points, starts, c = line
    spots, _, passes = joints
    own, intervals = segments
    length, shortest = rule
    stops = np.empty(len(own[0]) + passing[1] - passing[0] + 2)
    places = np.full((len(stops), 2), np.nan)
    for k in range(2):
        places[0, k], places[1, k] = points[starts[c], k], points[starts[c + 1] - 1, k]
    stops[0], stops[1] = 0.0, length
    count = 2
    for i in range(passing[0], passing[1]):
        arc = passes[1][i]
        if arc <= 1e-9 or arc >= length - 1e-9:
            continue
        stops[count] = arc
        places[count, 0], places[count, 1] = spots[passes[2][i], 0], spots[passes[2][i], 1]
        count += 1
    fixed = count
    if shortest > 0 and own[2].shape[1] > 1:
        count = _add_changes(own, intervals, shortest, stops, (fixed, length))
    order = np.argsort(stops[:count])
    chosen, spot = np.empty(count), np.empty((count, 2))
    for i in range(count):
        chosen[i] = stops[order[i]]
        spot[i, 0], spot[i, 1] = places[order[i], 0], places[order[i], 1]
    return chosen, spot


@compiled
@no_type_check
def _add_changes(own, intervals, shortest, stops, known):
    """Writes the arc lengths where the class changes behind the stops, and gives how many there are."""
    lengths, scores, votes = own
    fixed, length = known
    weighted = np.empty_like(votes)
    for i in range(len(lengths)):
        for k in range(votes.shape[1]):
            weighted[i, k] = lengths[i] * scores[i] * votes[i, k]
    runs = class_runs(lengths, weighted, shortest)
    count = fixed
    for i in range(1, len(runs) + 1):
        if i == len(runs):  # around a ring that begins elsewhere
            if runs[0] == runs[-1] or intervals[0, 0] < _LEAST or length - intervals[0, 0] < _LEAST:
                continue
            arc = intervals[0, 0]
        elif runs[i] == runs[i - 1]:
            continue
        else:
            arc = (intervals[i - 1, 1] + intervals[i, 0]) / 2
            if intervals[i, 0] < intervals[i - 1, 1] - 1e-6:
                arc = intervals[i, 0]
        near = False
        for j in range(count):
            gap = abs(stops[j] - arc)
            near |= gap < (_PULL if 2 <= j < fixed else _LEAST)
        if not near:
            stops[count] = arc
            count += 1
    return count


@compiled
@no_type_check
def _moves(samples, at, span, stops, places):
    """Gives how far the smooth line must move at each stop; where a place is free, it becomes the line's."""
    moves = np.zeros((len(stops), 2))
    for j in range(len(stops)):
        x, y = place_at(samples, at, span[0], span[1], stops[j])
        if np.isnan(places[j, 0]):
            places[j, 0], places[j, 1] = x, y
            if j == 0:
                places[-1, 0], places[-1, 1] = x, y
        moves[j, 0], moves[j, 1] = places[j, 0] - x, places[j, 1] - y
    return moves


@compiled
@no_type_check
def _write(curve, span, piece, vertices, filled):
    """Writes the vertices of the piece from stop j on, and gives how many vertices there are."""
    (samples, at), (stops, places, moves, j) = curve, piece
    low, high = stops[j], stops[j + 1]
    fade = min(_FADE, high - low)
    vertices[filled, 0], vertices[filled, 1] = places[j, 0], places[j, 1]
    filled += 1
    i, stop = span[0] + np.searchsorted(at[span[0] : span[1]], low + _NEAR, side="right"), span[1]
    while i < stop and at[i] < high - _NEAR:
        before, behind = max(1 - (at[i] - low) / fade, 0.0), max(1 - (high - at[i]) / fade, 0.0)
        for k in range(2):
            vertices[filled, k] = samples[i, k] + before * moves[j, k] + behind * moves[j + 1, k]
        filled += 1
        i += 1
    vertices[filled, 0], vertices[filled, 1] = places[j + 1, 0], places[j + 1, 1]
    return filled + 1


@compiled
@no_type_check
def _weigh(own, intervals, stops, known, shares):
    """Gives the score of each piece of a line, the mean by length where gaps count as zero; writes shares."""
    lengths, scores, votes = own
    length, first = known
    pieces = len(stops) - 1
    # Of each piece: covered length, that times the score, the weight of the shares, lowest and highest score.
    sums = np.zeros((pieces, 5))
    sums[:, 3] = np.inf
    for i in range(len(lengths)):
        low, high = intervals[i]
        for lap in range(2 if high > length else 1):  # on a ring a segment may run over its end
            begin, end = (low, min(high, length)) if lap == 0 else (0.0, high - length)
            j = min(max(np.searchsorted(stops, begin, side="right") - 1, 0), pieces - 1)
            while True:
                share = 1.0
                if high - low > _LEVEL:
                    share = max(min(end, stops[j + 1]) - max(begin, stops[j]), 0.0) / (high - low)
                if share > 0:
                    _add(sums[j], shares[first + j], share * lengths[i], scores[i], votes[i])
                j += 1
                if j >= pieces or stops[j] >= end:
                    break
    means = np.zeros(pieces)
    for j in range(pieces):
        covered, total, weight, least, most = sums[j]
        for k in range(votes.shape[1]):
            shares[first + j, k] = shares[first + j, k] / weight if weight > 0 else 1 / votes.shape[1]
        if covered > 0:
            span = stops[j + 1] - stops[j]
            mean = min(max(total / covered, least), most)
            means[j] = mean * covered / span if covered < span * (1 - _LEVEL) else mean
    return means


@compiled(inline=True)
@no_type_check
def _add(sums, shares, length, score, votes):
    """Adds a part of a segment to what is known of a piece."""
    weight = length * (score + _LIGHT)
    sums[0] += length
    sums[1] += length * score
    sums[2] += weight
    sums[3], sums[4] = min(sums[3], score), max(sums[4], score)
    for k in range(len(votes)):
        shares[k] += weight * votes[k]
