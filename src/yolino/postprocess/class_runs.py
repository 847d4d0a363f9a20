"""Where the class changes along a chain: the best runs of at least a length, compiled."""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from yolino.compiled import compiled

_CHANGE = 0.25  # of the shortest run: the votes that a change must win


@compiled
@no_type_check
def class_runs(lengths, votes, shortest):
    """Gives the class of each segment of a chain, so that each run of one class is long enough.

    Of all ways to cut the chain into runs of at least the length `shortest`, the one with the most votes
    wins, where each change costs a quarter of what a run of that length has (a Potts model with a smallest
    length, solved exactly). A chain that is shorter has one class.

    Args:
        lengths: Length of each segment.
        votes: How much each segment is for each class, by its length.
        shortest: Least length of a run.
    """
    n, classes = votes.shape
    best, first = np.full((n + 1, classes), -np.inf), np.zeros((n + 1, classes), np.int64)
    sums, at = np.zeros((n + 1, classes)), np.zeros(n + 1)
    for i in range(n):
        at[i + 1] = at[i] + lengths[i]
        for k in range(classes):
            sums[i + 1, k] = sums[i, k] + votes[i, k]
    total = 0.0
    for k in range(classes):  # in this order, as numpy's sum is not in both tiers
        total += sums[n, k]
    price = _CHANGE * shortest * total / at[n] if at[n] > 0 else 0.0
    cut = 1  # from here on cuts leave too short a run before i; those before were tried
    for i in range(1, n + 1):
        for k in range(classes):
            if i == n or at[i] >= shortest:
                best[i, k] = sums[i, k]
            if first[i - 1, k] > 0:
                on = best[i - 1, k] + votes[i - 1, k]
                if on > best[i, k]:
                    best[i, k], first[i, k] = on, first[i - 1, k]
        while cut < i and at[i] - at[cut] >= shortest:
            _change(best, first, sums, (cut, i), price)
            cut += 1
    return _read(best, first)


@compiled(inline=True)
@no_type_check
def _change(best, first, sums, run, price):
    """Notes where the best labelling before segment `i` has its last change at `cut`.

    The class before the change is the best there, or the second best for the best class itself.
    """
    cut, i = run
    leader, most, more = 0, -np.inf, -np.inf
    for k in range(best.shape[1]):
        if best[cut, k] > most:
            leader, most, more = k, best[cut, k], most
        elif best[cut, k] > more:
            more = best[cut, k]
    for k in range(best.shape[1]):
        mass = (more if k == leader else most) + sums[i, k] - sums[cut, k] - price
        if mass > best[i, k]:
            best[i, k], first[i, k] = mass, cut


@compiled
@no_type_check
def _read(best, first):
    """Gives the classes that led to the best sum."""
    n, classes = len(best) - 1, best.shape[1]
    runs = np.empty(n, np.int64)
    stop, k = n, 0
    for other in range(classes):
        if best[n, other] > best[n, k]:
            k = other
    while stop > 0:
        begin = first[stop, k]
        runs[begin:stop] = k
        if begin > 0:
            ahead = -1
            for other in range(classes):
                if other != k and (ahead < 0 or best[begin, other] > best[begin, ahead]):
                    ahead = other
            k = ahead
        stop = begin
    return runs
