"""Junctions: the places that lines share, and which lines are left when short loose ones go, compiled.

Line c has two ends, its start `2 c` and its end `2 c + 1`. Each end is at a junction; one that no other line
shares is a loose end. A line may pass through further junctions, where other lines end.
"""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from yolino.compiled import compiled
from yolino.postprocess.hosts import find_hosts
from yolino.postprocess.sorting import sort_rows
from yolino.postprocess.traces import place_at


@compiled
@no_type_check
def join_lines(lines, rings, alive, directed, rules):
    """Gives the junctions of lines, and marks those that are dropped as no longer alive.

    A line that is too short is dropped unless its ends meet different junctions, and not both of them on one
    line: then it connects them. A line whose ends both meet a longer one, and which nowhere leaves it
    farther than a margin, is dropped too.

    Args:
        lines: Points, their arc lengths, where those of each line begin.
        rings: Whether each line is closed.
        alive: Whether each line is there at all; changed.
        directed: Whether directions count.
        rules: The rule of `find_hosts`; how near junctions on one line are one; the length of short lines;
            how far from a line one that leaves it and comes back must go.

    Returns:
        Places of the junctions; the junction at each end (-1 for a loose end); and the passes: line, arc
        length there and junction, sorted by line and arc length.
    """
    host_rule, snap, shortest, margin = rules
    arcs, starts = lines[1], lines[2]
    short = np.zeros(len(rings), np.bool_)
    loose = np.zeros(2 * len(rings), np.bool_)
    for c in range(len(rings)):
        short[c] = alive[c] and arcs[starts[c + 1] - 1] < shortest
        loose[2 * c] = loose[2 * c + 1] = alive[c] and not rings[c]
    hosts, places = find_hosts(lines, loose, alive, directed, host_rule)
    ends, passes = _group(lines, rings, hosts, places, snap)
    beside = np.zeros(len(rings), np.bool_)
    for c in range(len(rings)):
        if hosts[2 * c] >= 0 and hosts[2 * c] == hosts[2 * c + 1]:
            beside[c] = short[c] or _runs_beside(lines, c, hosts[2 * c], places, margin)
    if _prune(ends, passes[0], passes[2], alive, (short, beside)):
        _meet_others(lines, (hosts, places), alive, directed, host_rule)
        ends, passes = _group(lines, rings, hosts, places, snap)
    return _locate(lines, alive, ends, passes), ends, passes


@compiled
@no_type_check
def _meet_others(lines, met, alive, directed, rule):
    """Finds new hosts for the ends whose host is no longer alive: the others have the best of all still."""
    hosts, places = met
    lost = np.zeros(len(hosts), np.bool_)
    for end in range(len(hosts)):
        if not alive[end >> 1]:
            hosts[end] = -1
        lost[end] = hosts[end] >= 0 and not alive[hosts[end]]
    others, elsewhere = find_hosts(lines, lost, alive, directed, rule)
    for end in range(len(hosts)):
        if lost[end]:
            hosts[end], places[end] = others[end], elsewhere[end]


@compiled
@no_type_check
def _group(lines, rings, hosts, places, snap):
    """Gives the junction of each end (-1: loose), and the passes.

    An end that meets a line near one of its ends meets that end. Places on one line within `snap` of the
    first of them are one.
    """
    _, arcs, starts = lines
    guests = np.flatnonzero(hosts >= 0)
    rows = np.empty((len(guests), 2))
    for g in range(len(guests)):
        rows[g, 0], rows[g, 1] = hosts[guests[g]], places[guests[g]]
    order = sort_rows(rows)
    count = len(hosts)
    parents = np.arange(count + len(guests))
    lines_of, arcs_of = np.empty(len(guests), np.int64), np.empty(len(guests))
    passes = members = 0
    first = 0.0
    for p in order:
        end = guests[p]
        host, place = hosts[end], places[end]
        length = arcs[starts[host + 1] - 1]
        if not rings[host] and min(place, length - place) <= snap:
            _unite(parents, end, 2 * host + (1 if length - place < place else 0))
            continue
        if passes == 0 or lines_of[passes - 1] != host or place - first > snap:
            first, members = place, 0
            lines_of[passes], arcs_of[passes] = host, 0.0
            passes += 1
        members += 1
        arcs_of[passes - 1] += (place - arcs_of[passes - 1]) / members
        _unite(parents, end, count + passes - 1)
    sizes = np.zeros(len(parents), np.int64)
    for i in range(count + passes):
        sizes[_root(parents, i)] += 1
    names = np.full(len(parents), -1, np.int64)
    junctions = 0
    for i in range(count + passes):
        root = _root(parents, i)
        if sizes[root] > 1 and names[root] < 0:
            names[root] = junctions
            junctions += 1
    ends, nodes = np.empty(count, np.int64), np.empty(passes, np.int64)
    for i in range(count):
        ends[i] = names[_root(parents, i)]
    for i in range(passes):
        nodes[i] = names[_root(parents, count + i)]
    return ends, (lines_of[:passes], arcs_of[:passes], nodes)


@compiled
@no_type_check
def _root(parents, i):
    while parents[i] != i:
        parents[i] = parents[parents[i]]
        i = parents[i]
    return i


@compiled
@no_type_check
def _unite(parents, i, j):
    i, j = _root(parents, i), _root(parents, j)
    parents[max(i, j)] = min(i, j)


@compiled
@no_type_check
def _prune(ends, lines, nodes, alive, marks):
    """Drops the short lines that connect nothing, again and again; tells whether one had met another line."""
    short, beside = marks
    degrees = np.zeros(max(ends.max() + 1, 0) if len(ends) else 0, np.int64)
    for c in range(len(alive)):
        for end in (2 * c, 2 * c + 1):
            if alive[c] and ends[end] >= 0:
                degrees[ends[end]] += 1
    for i in range(len(nodes)):
        degrees[nodes[i]] += 2
    met = False
    dropped = True
    while dropped:
        dropped = False
        for c in range(len(alive)):
            if not (alive[c] and (short[c] or beside[c])):
                continue
            a, b = ends[2 * c], ends[2 * c + 1]
            if a >= 0 and b >= 0 and a != b and not beside[c] and degrees[a] > 1 and degrees[b] > 1:
                continue
            alive[c], dropped = False, True
            for node in (a, b):
                if node >= 0:
                    degrees[node] -= 1
                    met = True
        for i in range(len(nodes)):
            if nodes[i] >= 0 and not alive[lines[i]]:
                degrees[nodes[i]] -= 2
                nodes[i] = -1
                met = True
                dropped = True
    return met


@compiled
@no_type_check
def _runs_beside(lines, c, host, places, radius):
    """Tells whether all points of a line lie within the radius of its host between the places of its ends."""
    points, arcs, starts = lines
    low, high = min(places[2 * c], places[2 * c + 1]), max(places[2 * c], places[2 * c + 1])
    length, rival = arcs[starts[c + 1] - 1], arcs[starts[host + 1] - 1]
    if host == c or radius <= 0 or rival < length or (rival == length and host > c):
        return False
    if high - low > 2 * length + 4 * radius:
        return False
    first = (
        starts[host] + np.searchsorted(arcs[starts[host] : starts[host + 1]], low - radius, side="right") - 1
    )
    first = max(first, starts[host])
    for p in range(starts[c], starts[c + 1]):
        near = False
        for i in range(first, starts[host + 1] - 1):
            if arcs[i] > high + radius:
                break
            dx, dy = points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1]
            gx, gy = points[p, 0] - points[i, 0], points[p, 1] - points[i, 1]
            square = dx * dx + dy * dy
            share = min(max((gx * dx + gy * dy) / square, 0.0), 1.0) if square > 0 else 0.0
            gx, gy = gx - share * dx, gy - share * dy
            if gx * gx + gy * gy <= radius * radius:
                near = True
                break
        if not near:
            return False
    return True


@compiled
@no_type_check
def _locate(lines, alive, ends, passes):
    """Gives the places of the junctions: on the line that passes, else in the middle of the ends."""
    points, arcs, starts = lines
    lines_of, arcs_of, nodes = passes
    count = -1
    for node in ends:
        count = max(count, node)
    for node in nodes:
        count = max(count, node)
    spots, members = np.zeros((count + 1, 2)), np.zeros(count + 1)
    for end in range(len(ends)):
        node = ends[end]
        if node >= 0 and alive[end >> 1]:
            p = starts[(end >> 1) + 1] - 1 if end & 1 else starts[end >> 1]
            members[node] += 1
            for k in range(2):
                spots[node, k] += (points[p, k] - spots[node, k]) / members[node]
    for i in range(len(nodes)):
        c = lines_of[i]
        spots[nodes[i], 0], spots[nodes[i], 1] = place_at(points, arcs, starts[c], starts[c + 1], arcs_of[i])
    return spots
