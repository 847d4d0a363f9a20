"""Where loose ends of lines belong: the place on another line that each leaves from or runs into, compiled.

Line c has two ends, its start `2 c` and its end `2 c + 1`. All lengths are in cell units.
"""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from yolino.compiled import compiled
from yolino.postprocess.cells import neighborhoods, sort_points

_STRETCH = 1.0  # cells of a line that are looked up together
_LOOK_BACK = 1.5  # cells at the end of a line that tell its direction
_TURN_WEIGHT = 0.5  # cells that 1 - cosine of the angle costs
_LEAD = 1.5  # cells: how far ahead of its nearest place an end may meet a line that it runs along
_OWN = 4.0  # radii along itself beyond which a line may meet itself
_ALONG = 0.9  # least cosine of the angle at which an end runs along a line
_SLACK = 0.25  # cells by which an end may miss a piece of a line across a gap
_CROSS = 0.35  # least sine of the angle at which an end reaches a line across a gap


@compiled
@no_type_check
def find_hosts(lines, loose, alive, directed, rule):
    """Gives the line that each loose end meets, -1 for none, and the arc length there.

    An end meets a line that is within the radius, or which its direction leads to within the gap. The
    directions there differ by an angle of at least the given cosine (if undirected, the way on along the line
    is either of both). Of several lines the nearest one is met, where a turn counts as distance.

    Args:
        lines: Points, their arc lengths, where those of each line begin.
        loose: Whether each end is.
        alive: Whether each line is; others are not met.
        directed: Whether directions count.
        rule: Radius, gap, least cosine.
    """
    points, _, starts = lines
    hosts, places = np.full(len(loose), -1, np.int64), np.zeros(len(loose))
    ends = np.flatnonzero(loose)
    if len(ends) == 0:
        return hosts, places
    middles, pieces, owners, ways = _stretches(points, starts, alive)
    # What an end meets lies no farther from it than this: nor does the middle of that stretch, and a half.
    reach = max(rule[0], rule[1]) + _SLACK + _STRETCH / 2
    spots = np.empty((len(ends) + len(middles), 2))
    spots[len(ends) :] = middles
    for e in range(len(ends)):
        p = _tip(starts, ends[e])
        spots[e, 0], spots[e, 1] = points[p, 0], points[p, 1]
    _, order, keys, columns = sort_points(spots, reach)
    runs = neighborhoods(keys, columns)
    for p in range(len(order)):
        if order[p] >= len(ends):
            continue
        end, x, y = ends[order[p]], spots[order[p], 0], spots[order[p], 1]
        way = _outward(points, starts, end)
        best = (np.inf, np.int64(-1), 0.0)
        for row in range(3):
            for q in range(runs[p, row, 0], runs[p, row, 1]):
                j = order[q] - len(ends)
                if j < 0:
                    continue
                dx, dy = middles[j, 0] - x, middles[j, 1] - y
                if dx * dx + dy * dy <= reach * reach:
                    found = _meet(lines, (end, way), (pieces[j], owners[j], ways[j]), directed, rule)
                    best = found if found < best else best
        if best[1] >= 0:
            hosts[end], places[end] = best[1], best[2]
    return hosts, places


@compiled
@no_type_check
def _stretches(points, starts, alive):
    """Gives the middles of short stretches of all pieces between points, and what pieces they belong to.

    That is: the piece, its line, and its unit direction and length.
    """
    total = 0
    for turn in range(2):
        if turn == 1:
            middles = np.empty((total, 2))
            pieces, owners = np.empty(total, np.int64), np.empty(total, np.int64)
            ways = np.empty((total, 3))
            total = 0
        for c in range(len(starts) - 1):
            if not alive[c]:
                continue
            for i in range(starts[c], starts[c + 1] - 1):
                dx, dy = points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1]
                length = np.sqrt(dx * dx + dy * dy)
                count = int(length / _STRETCH) + 1 if length > 0 else 0
                if turn == 1:
                    for k in range(count):
                        share = (k + 0.5) / count
                        middles[total + k, 0] = points[i, 0] + share * dx
                        middles[total + k, 1] = points[i, 1] + share * dy
                        pieces[total + k], owners[total + k] = i, c
                        ways[total + k, 0], ways[total + k, 1] = dx / length, dy / length
                        ways[total + k, 2] = length
                total += count
    return middles, pieces, owners, ways


@compiled(inline=True)
@no_type_check
def _tip(starts, end):
    c = end >> 1
    return starts[c + 1] - 1 if end & 1 else starts[c]


@compiled
@no_type_check
def _outward(points, starts, end):
    """Gives the unit direction that leads out of a line at its end."""
    tip = _tip(starts, end)
    step = -1 if end & 1 else 1
    last = starts[end >> 1] if end & 1 else starts[(end >> 1) + 1] - 1
    i = tip
    walked = 0.0
    while i != last and walked < _LOOK_BACK:
        dx, dy = points[i + step, 0] - points[i, 0], points[i + step, 1] - points[i, 1]
        walked += np.sqrt(dx * dx + dy * dy)
        i += step
    x, y = points[tip, 0] - points[i, 0], points[tip, 1] - points[i, 1]
    norm = np.sqrt(x * x + y * y)
    return (x / norm, y / norm) if norm > 0 else (0.0, 0.0)


@compiled
@no_type_check
def _meet(lines, tip, piece, directed, rule):
    """Gives the cost at which an end meets a piece of a line (infinite: none), that line and the place."""
    (points, arcs, starts), (end, way) = lines, tip
    radius, reach, straight = rule
    (i, c, unit), nothing = piece, (np.inf, np.int64(-1), 0.0)
    dx, dy, length = unit[0], unit[1], unit[2]
    cosine = way[0] * dx + way[1] * dy
    onward = cosine if end & 1 else -cosine
    if (onward if directed else abs(onward)) < straight:
        return nothing
    tip = _tip(starts, end)
    gx, gy = points[tip, 0] - points[i, 0], points[tip, 1] - points[i, 1]
    along, beside = gx * dx + gy * dy, gx * dy - gy * dx  # beside: of the tip, positive on the left
    foot = min(max(along, 0.0), length)
    distance = np.sqrt((along - foot) * (along - foot) + beside * beside)
    sine = way[0] * dy - way[1] * dx
    cost = distance
    if distance > radius:
        # Along its direction the end is beside - g * ..., so it meets the line after g cells.
        if abs(sine) < _CROSS or beside * sine >= 0:
            return nothing
        cost = -beside / sine
        foot = along + cost * cosine
        if cost > reach or foot < -_SLACK or foot > length + _SLACK:
            return nothing
        foot, lead = min(max(foot, 0.0), length), 0.0
    else:
        # An end that runs along the line meets it farther on, so that there is no kink.
        lead = min(abs(beside) * abs(cosine) / max(abs(sine), 1e-9), _LEAD)
        if beside * sine >= 0:  # it runs beside the line, or has crossed it
            lead = min(2 * abs(beside), _LEAD) if abs(cosine) > _ALONG else 0.0
    place = arcs[i] + foot
    if c == end >> 1 and abs(place - arcs[tip]) < _OWN * radius:
        return nothing
    place += lead if cosine > 0 else -lead
    place = min(max(place, 0.0), arcs[starts[c + 1] - 1])
    return cost + _TURN_WEIGHT * (1 - (onward if directed else abs(cosine))), np.int64(c), place
