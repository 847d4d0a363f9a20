"""Timing side by side: contestants take turns, so that what slows the machine down slows all of them."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from time import perf_counter

import cv2
import numpy as np
from jaxtyping import Float

LEAST_ROUNDS = 3
_SLICE_S = 2e-3  # a shorter call is repeated within a round until it takes about this long
_MOST_CALLS = 100


@dataclass(frozen=True, eq=False)
class Times:
    """How long one contestant took in each round, in seconds per call."""

    seconds: Float[np.ndarray, " n"]

    @property
    def median(self) -> float:
        """Median in seconds."""
        return float(np.median(self.seconds))

    @property
    def quartiles(self) -> tuple[float, float]:
        """First and third quartile in seconds."""
        low, high = np.quantile(self.seconds, (0.25, 0.75))
        return float(low), float(high)


def race(
    contestants: Mapping[str, Callable[[], object]],
    *,
    rounds: int,
    seconds: float,
    calls: int | None = None,
) -> dict[str, Times]:
    """Gives the times of all contestants; in each round every one has its turn, each round another one first.

    Each is called twice before, which compiles and fills caches.

    Args:
        contestants: What to call, by name.
        rounds: Largest number of rounds.
        seconds: No further round starts after this time, once there are at least three.
        calls: Calls per turn; by default as many as take 2 ms together, at least one.
    """
    counts = {name: _calls(run, calls) for name, run in contestants.items()}
    names, taken = list(contestants), {name: list[float]() for name in contestants}
    start = perf_counter()
    for number in range(rounds):
        if number >= LEAST_ROUNDS and perf_counter() - start > seconds:
            break
        first = number % len(names)
        for name in names[first:] + names[:first]:
            taken[name].append(_turn(contestants[name], counts[name]))
    return {name: Times(np.array(values)) for name, values in taken.items()}


def _turn(run: Callable[[], object], calls: int) -> float:
    start = perf_counter()
    for _ in range(calls):
        run()
    return (perf_counter() - start) / calls


def _calls(run: Callable[[], object], calls: int | None) -> int:
    run()
    once = _turn(run, 1)
    return calls or min(max(math.ceil(_SLICE_S / once), 1), _MOST_CALLS)


@contextlib.contextmanager
def opencv_threads(count: int) -> Iterator[None]:
    """Lets OpenCV use `count` threads within the block."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(count)
    try:
        yield
    finally:
        cv2.setNumThreads(before)


__all__ = ["LEAST_ROUNDS", "Times", "opencv_threads", "race"]
