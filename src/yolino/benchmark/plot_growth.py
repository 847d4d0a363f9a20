"""Draws how time and memory grow: log-log, with the exponents, beside a line of slope 1."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count
from typing import TYPE_CHECKING, Any

from yolino.benchmark.plot_style import (
    COLORS,
    GRAY,
    INK,
    LIGHT,
    SMALL,
    digits,
    machine_line,
    new_figure,
    tidy,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PANEL_HEIGHT, _HEAD = 2.15, 0.7  # inches
_MARKERS = ("o", "s", "^", "D", "v", "P")
# What has the same color and marker in each panel, by the end of its title; the others take those left.
_PLACES = {"NMS": 0, "linker tree": 1, "linker chain": 2, "linker graph": 3}
_LEAST_MEGABYTES = 0.1  # below, the measurement is mostly noise
_HEADROOM = 30  # free space above the curves, where the legend is, as a factor


def draw(result: dict[str, Any]) -> Figure | None:
    """Gives time (left) and memory (right) of all curves in the result, a row for each kind of size."""
    groups: dict[str, list[dict[str, Any]]] = {}
    for section in result["sections"].values():
        for curve in section.get("curves") or ():
            if curve["points"]:
                groups.setdefault(curve["x"], []).append(curve)
    if not groups:
        return None
    height = _PANEL_HEIGHT * len(groups) + _HEAD
    figure = new_figure(height, "How time and memory grow", machine_line(result))
    for row, (x, curves) in enumerate(groups.items()):
        unit = curves[0]["unit"]
        panels = {"median": (f"time ({unit})", "exponent"), "megabytes": ("memory (MB)", "memory_exponent")}
        for column, (key, (title, exponent)) in enumerate(panels.items()):
            axes = figure.add_subplot(len(groups), 2, 2 * row + column + 1)
            _panel(axes, curves, key, exponent)
            tidy(axes, title=f"{title} by {x}", grid="both")
    return figure


def _panel(axes: Axes, curves: Sequence[dict[str, Any]], key: str, exponent: str) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    drawn: list[list[tuple[float, float]]] = []
    for place, curve in zip(_places(curves), curves, strict=True):
        points = _points(curve, key)
        if not points:
            continue
        slope = "" if curve[exponent] is None else f", $n^{{{curve[exponent]:.2f}}}$"
        axes.plot(
            *zip(*points, strict=True),
            color=COLORS[place % len(COLORS)],
            marker=_MARKERS[place % len(_MARKERS)],
            markersize=3.5,
            linewidth=1.5,
            label=f"{curve['title']}{slope}",
        )
        drawn.append(points)
    if not drawn:
        axes.text(0.5, 0.5, "too little to measure", transform=axes.transAxes, ha="center", color=GRAY)
        axes.set_xticks([])
        axes.set_yticks([])
        return
    _frame(axes, drawn)
    axes.legend(loc="upper left", fontsize=SMALL - 1.5, frameon=False, labelcolor=INK, borderpad=0)


def _places(curves: Sequence[dict[str, Any]]) -> list[int]:
    """Gives the place of each curve in the lists of colors and markers."""
    fixed = [
        next((place for end, place in _PLACES.items() if curve["title"].endswith(end)), None)
        for curve in curves
    ]
    left = (place for place in count() if place not in fixed)
    return [next(left) if place is None else place for place in fixed]


def _points(curve: dict[str, Any], key: str) -> list[tuple[float, float]]:
    """Gives the points that can be drawn on log axes."""
    least = _LEAST_MEGABYTES if key == "megabytes" else 0.0
    pairs = [(p["value"], p[key]) for p in curve["points"]]
    return [(x, y) for x, y in pairs if y is not None and y > least and x > 0]


def _frame(axes: Axes, drawn: list[list[tuple[float, float]]]) -> None:
    """Sets limits and ticks, and draws the line of slope 1 below the curves."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    xs, ys = ([pair[i] for points in drawn for pair in points] for i in (0, 1))
    left, right = min(xs) / 1.3, max(xs) * 1.3
    low, high = min(ys) / 3, max(ys) * _HEADROOM
    axes.set_xlim(left, right)
    axes.set_ylim(low, high)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(numticks=7))
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(FuncFormatter(lambda value, _: digits(value)))
    last = min(points[-1][1] for points in drawn) / 2.5
    axes.plot([left, right], [last * left / right, last], color=GRAY, linewidth=1, dashes=(4, 3))
    axes.annotate(
        "slope 1",
        (right, last),
        xytext=(-2, -3),
        textcoords="offset points",
        ha="right",
        va="top",
        fontsize=SMALL - 1.5,
        color=GRAY,
        bbox={"facecolor": "white", "edgecolor": LIGHT, "linewidth": 0, "pad": 0.5},
    )


__all__ = ["draw"]
