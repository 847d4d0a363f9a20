"""The way to a good setting: one parameter at a time, again from elsewhere, back where it gives little."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from yolino.tuning.space import Point, Space

Value = Callable[[Point], float]
Error = Callable[[Point, Point], float]

_PASSES = 10  # over all parameters; three are enough for most
_MOVED = 3  # parameters that a new beginning changes
_RESTARTS = 10  # more rarely find anything new
_SURE = 2.0  # standard errors: changes that give less are taken back
_EVEN = 1e-9  # gains as small as this are none


class Search:
    """Looks for the setting with the largest value, on plateaus rather than on peaks.

    A parameter at a time takes the value that is best when its neighbors count too: half the value itself, a
    quarter each neighbor, what is beyond the last value counts as the last. Where no parameter moves any
    more, a few of them jump to random values and it begins again; a new end is taken if the mean over it and
    its neighbors is larger.

    Args:
        space: The settings.
        value: What is to be large.
        spent: Gives how many settings have been scored.
        trials: After so many it ends.
        rng: Source of the order of the parameters and of the jumps.
    """

    def __init__(
        self, space: Space, value: Value, spent: Callable[[], int], trials: int, rng: np.random.Generator
    ) -> None:
        self._space, self._value, self._spent, self._rng = space, value, spent, rng
        self._last = spent() + trials

    def __call__(self, start: Point) -> Point:
        """Gives the best setting that was found from `start` on."""
        best = self.descend(start)
        height = self.height(best)
        for _ in range(_RESTARTS):
            if self._ended():
                break
            end = self.descend(self._jump(best))
            if self._ended():
                break
            if (found := self.height(end)) > height + _EVEN:
                best, height = end, found
        return best

    def descend(self, point: Point) -> Point:
        """Gives the setting from which no single parameter leads on."""
        for _ in range(_PASSES):
            before = point
            for i in self._rng.permutation(len(point)):
                if self._ended():
                    return point
                point = self._move(point, int(i))
            if point == before:
                break
        return point

    def height(self, point: Point) -> float:
        """Gives the mean, over the parameters, of the value where its neighbors count too."""
        return float(np.mean([smooth(self._curve(point, i))[at] for i, at in enumerate(point)]))

    def _move(self, point: Point, parameter: int) -> Point:
        """Gives the setting with the best value of one parameter."""
        curve = smooth(self._curve(point, parameter))
        best = int(curve.argmax())
        if curve[best] <= curve[point[parameter]] + _EVEN:
            return point
        return replaced(point, parameter, best)

    def _curve(self, point: Point, parameter: int) -> Float[np.ndarray, " v"]:
        count = len(self._space.values[parameter])
        return np.array([self._value(replaced(point, parameter, at)) for at in range(count)])

    def _jump(self, point: Point) -> Point:
        for i in self._rng.permutation(len(point))[:_MOVED]:
            point = replaced(point, int(i), int(self._rng.integers(len(self._space.values[i]))))
        return point

    def _ended(self) -> bool:
        return self._spent() >= self._last


def smooth(curve: Float[np.ndarray, " v"]) -> Float[np.ndarray, " v"]:
    """Gives half of each value and a quarter of each neighbor; beyond the ends all is as there."""
    wide = np.pad(curve, 1, mode="edge")
    return np.asarray(wide[1:-1] / 2 + (wide[:-2] + wide[2:]) / 4)


def simplify(best: Point, start: Point, value: Value, error: Error) -> Point:
    """Gives the setting without the changes that may be worth nothing.

    The change that gives least is taken back first, until the next one gives more than two standard errors of
    what it gives. This is the one-standard-error rule (Breiman et al., Classification and Regression Trees,
    1984) with two of them: the best of some ten values of each of a dozen parameters is good by luck, too.

    Args:
        best: The best setting.
        start: The setting before.
        value: What is to be large.
        error: Standard error of the difference between two settings.
    """
    point = best
    while changed := [i for i in range(len(point)) if point[i] != start[i]]:
        back = max((replaced(point, i, start[i]) for i in changed), key=value)
        if value(point) - value(back) > _SURE * error(point, back) + _EVEN:
            break
        point = back
    return point


def replaced(point: Point, parameter: int, at: int) -> Point:
    """Gives the setting with another value of one parameter."""
    return (*point[:parameter], at, *point[parameter + 1 :])


__all__ = ["Search", "replaced", "simplify", "smooth"]
