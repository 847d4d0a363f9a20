"""Draws the races: our time beside that of each counterpart, on a log axis, with the factor between them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from yolino.benchmark.plot_style import (
    BLUE,
    GRAY,
    INK,
    LIGHT,
    ORANGE,
    SMALL,
    digits,
    machine_line,
    new_figure,
    tidy,
    values,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Section -> the factor's measure, and those of our time and the other's; * stands for the same in all three.
_PAIRS = {
    "nms": [("speedup_*", "ours_*", "sklearn_*", "NMS, {}: scikit-learn")],
    "linking": [("speedup_*", "*", "loops", "linker {}: plain Python")],
    "points": [("speedup", "ours", "loop", "point metric: loop with numpy")],
    "matching": [
        ("speedup", "ours", "pairs", "matching: loop over pairs"),
        ("speedup_cells", "ours", "cells", "matching: loop over cells"),
    ],
    "loading": [
        ("speedup", "ours", "torchvision", "loading: torchvision"),
        ("speedup_draft", "ours", "torchvision_draft", "loading: torchvision, half-size decoding"),
    ],
    "darknet19": [("speedup", "model_total", "darknet19_total", "frame: Darknet-19, same engine")],
}


class _Race(NamedTuple):
    title: str
    factor: float
    ours: float
    other: float


def draw(result: dict[str, Any]) -> Figure | None:
    """Gives a row for each race."""
    races = _races(result)
    if not races:
        return None
    figure = new_figure(1.3 + 0.3 * len(races), "yolino beside other implementations", machine_line(result))
    axes = figure.subplots()
    axes.set_xscale("log")
    rows = range(len(races))
    axes.hlines(rows, [r.ours for r in races], [r.other for r in races], color=LIGHT, linewidth=4)
    axes.scatter([r.ours for r in races], rows, s=42, color=BLUE, label="yolino", zorder=3)
    axes.scatter([r.other for r in races], rows, s=42, color=ORANGE, marker="s", label="the other", zorder=3)
    for row, race in enumerate(races):
        _label(axes, row, race)
    axes.set_yticks(list(rows), [r.title for r in races])
    axes.set_ylim(len(races) - 0.4, -0.6)
    smallest, largest = min(min(r.ours, r.other) for r in races), max(max(r.ours, r.other) for r in races)
    axes.set_xlim(smallest / 5, largest * 12)
    _ticks(axes)
    tidy(axes, title="milliseconds, log scale; the factor is the median over rounds")
    axes.tick_params(axis="y", labelcolor=INK)
    figure.legend(loc="outside lower left", ncols=2, fontsize=SMALL, frameon=False, labelcolor=INK)
    return figure


def _label(axes: Axes, row: int, race: _Race) -> None:
    left, right = min(race.ours, race.other), max(race.ours, race.other)
    style: dict[str, Any] = {"textcoords": "offset points", "va": "center", "fontsize": SMALL}
    axes.annotate(digits(left), (left, row), xytext=(-7, 0), ha="right", color=GRAY, **style)
    axes.annotate(digits(right), (right, row), xytext=(7, 0), ha="left", color=GRAY, **style)
    axes.annotate(
        f"{digits(race.factor)}x",
        (right, row),
        xytext=(40, 0),
        ha="left",
        color=INK,
        fontweight="bold",
        **style,
    )


def _ticks(axes: Axes) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    axes.xaxis.set_major_locator(LogLocator(numticks=9))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: digits(value)))


def _races(result: dict[str, Any]) -> list[_Race]:
    found = []
    for section, patterns in _PAIRS.items():
        measures = values(result, section)
        for factor, ours, other, title in patterns:
            stem = factor.rstrip("*")
            for name in [n for n in measures if n == factor or (stem != factor and n.startswith(stem))]:
                case = name.removeprefix(stem)
                keys = [pattern.replace("*", case) for pattern in (ours, other)]
                if all(key in measures for key in keys):
                    numbers = (measures[key]["value"] for key in (name, *keys))
                    found.append(_Race(title.format(_words(case)), *numbers))
    return found


def _words(case: str) -> str:
    """Gives a case of a race in words: numbers are candidates."""
    if case.isdigit():
        return f"{int(case):,} candidates"
    return "one radius" if case == "heap" else case


__all__ = ["draw"]
