"""What can be tuned: the values that are tried for each parameter of each linker."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from yolino.header import Header
from yolino.inference.postprocessing import DEFAULT_LINKER
from yolino.inference.predictor import DEFAULT_THRESHOLD
from yolino.postprocess import LINKERS, NMS

Number = float | int
Point = tuple[int, ...]
"""A setting: of each parameter, the index of its value."""

_NMS, _LINKER = "nms.", "linker_options."

# Neighboring values are about as far apart as two settings can be told apart. Lengths are in cells, angles in
# radians.
_COMMON: dict[str, tuple[Number, ...]] = {
    "threshold": (
        0.1,
        0.15,
        0.2,
        0.25,
        0.3,
        0.35,
        0.4,
        0.45,
        0.5,
        0.55,
        0.6,
        0.65,
        0.7,
        0.75,
        0.8,
        0.85,
        0.9,
    ),
    "nms.epsilon": (0.005, 0.01, 0.015, 0.02, 0.025, 0.03, 0.04, 0.06),
    "nms.midpoint_weight": (0.025, 0.04, 0.07, 0.1, 0.15, 0.2),
    "nms.direction_weight": (0.0125, 0.025, 0.05, 0.1, 0.2),
    "nms.score_power": (0.0, 1.0, 3.0, 6.0, 10.0, 20.0),
}
_LENGTHS = (0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 9.0, 10.0, 12.0, 15.0)
_SCORES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
_SMOOTHINGS = (0.0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
_RADII = (0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0)
_TURNS = tuple(round(math.radians(angle), 4) for angle in (20, 30, 45, 60, 75))
_GAPS = (0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 13.0, 16.0, 20.0)
_DUPLICATES = (0.0, 0.35, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 2.5)
_ENDS: dict[str, tuple[Number, ...]] = {
    "linker_options.min_length_cells": _LENGTHS,
    "linker_options.min_score": _SCORES,
    "linker_options.smoothing": _SMOOTHINGS,
}
SPACES: dict[str, dict[str, tuple[Number, ...]]] = {
    "tree": {
        **_COMMON,
        "linker_options.successor_radius_cells": _RADII,
        "linker_options.branch_radius_cells": (0.0, *_RADII),
        "linker_options.max_downward_cells": (0.0, 0.1, 0.25, 0.5, 1.0),
        "linker_options.min_segments": (1, 2, 3, 4, 5, 6, 8, 10),
        **_ENDS,
    },
    "chain": {
        **_COMMON,
        "linker_options.link_radius_cells": _RADII,
        "linker_options.max_turn": _TURNS,
        "linker_options.max_gap_cells": _GAPS,
        "linker_options.duplicate_radius_cells": _DUPLICATES,
        "linker_options.min_end_score": (0.0, *_COMMON["threshold"][4:]),
        "linker_options.level_ends_cells": (0.0, 1.0, 1.5, 2.0, 3.0),
        **_ENDS,
    },
    "graph": {
        **_COMMON,
        "linker_options.link_radius_cells": _RADII,
        "linker_options.max_turn": _TURNS,
        "linker_options.max_branch_turn": _TURNS,
        "linker_options.max_gap_cells": _GAPS,
        "linker_options.duplicate_radius_cells": _DUPLICATES,
        **_ENDS,
    },
}


@dataclass(frozen=True)
class Space:
    """The settings that are tried, around those that a model has.

    Attributes:
        names: Names of the parameters, as in the header's post-processing: `nms.epsilon`.
        values: Values of each, in order.
        start: Where the model is.
        defaults: What each is where a header does not say.
        given: The header's post-processing, with the linker.
    """

    names: tuple[str, ...]
    values: tuple[tuple[Number, ...], ...]
    start: Point
    defaults: tuple[Number, ...]
    given: Mapping[str, Any]

    @property
    def lowest_threshold(self) -> float:
        """The lowest score of a segment in any setting."""
        tried = dict(zip(self.names, self.values, strict=True)).get("threshold", ())
        return float(min([*tried, self.given.get("threshold", DEFAULT_THRESHOLD)]))

    def setting(self, point: Point) -> dict[str, Number]:
        """Gives the value of each parameter."""
        return {name: self.values[i][at] for i, (name, at) in enumerate(zip(self.names, point, strict=True))}

    def postprocess(self, point: Point) -> dict[str, Any]:
        """Gives the header's post-processing for a setting; what is as the header has it stays as it is."""
        found = {
            key: dict(value) if isinstance(value, Mapping) else value for key, value in self.given.items()
        }
        for i, (name, value) in enumerate(self.setting(point).items()):
            if point[i] == self.start[i]:
                continue
            section, _, key = name.rpartition(".")
            (found.setdefault(section, {}) if section else found)[key] = value
        return found


def build_space(header: Header, *, linker: str | None = None, only: Sequence[str] = ()) -> Space:
    """Gives the settings around those of a model.

    Args:
        header: The model's.
        linker: A name in `LINKERS`; another than the model's begins with its own defaults.
        only: Names of the parameters to change, such as `threshold`; all by default.

    Raises:
        ValueError: The linker or a parameter is unknown.
    """
    given = dict(header.postprocess)
    own = given.get("linker", DEFAULT_LINKER)
    name = own if linker is None else linker
    if name not in SPACES:
        raise ValueError(f"The linker {name!r} is unknown; known are {', '.join(SPACES)}.")
    if name != own:
        given = {**given, "linker": name, "linker_options": {}}
    _check_names(only, name)
    found = []
    for parameter, tried in SPACES[name].items():
        default = _default(parameter, name)
        now = _value(given, parameter, default)
        if now is None:  # which switches a rule off
            continue
        if not only or parameter in only:
            values = tuple(sorted({*tried, now}))
            found.append((parameter, values, values.index(now), default))
    if not found:
        raise ValueError(f"None of {', '.join(only)} is in use in this model: there is nothing to tune.")
    names, values, start, defaults = zip(*found, strict=True)
    return Space(names, values, start, defaults, given)


def _check_names(only: Sequence[str], linker: str) -> None:
    for parameter in only:
        if parameter not in SPACES[linker]:
            from yolino.config import suggest

            raise ValueError(
                f"The parameter {parameter!r} is unknown; {suggest(parameter, SPACES[linker])}"
                f"With the linker {linker} there are {', '.join(SPACES[linker])}."
            )


def _default(parameter: str, linker: str) -> Any:
    """Gives what a parameter is where the header does not say."""
    if parameter == "threshold":
        return DEFAULT_THRESHOLD
    owner: Callable[..., Any] = NMS if parameter.startswith(_NMS) else LINKERS[linker]
    return inspect.signature(owner).parameters[parameter.rpartition(".")[2]].default


def _value(given: Mapping[str, Any], parameter: str, default: Any) -> Any:
    section, _, key = parameter.rpartition(".")
    return (given.get(section, {}) if section else given).get(key, default)


__all__ = ["SPACES", "Number", "Point", "Space", "build_space"]
