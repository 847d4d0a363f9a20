"""Draws where the time of a frame goes: stacked bars of its steps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from yolino.benchmark.frames import STEPS
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
    values,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_STEPS = {
    "preprocess": COLORS[5],
    "network": LIGHT,
    "threshold": COLORS[4],
    "nms": COLORS[1],
    "linking": COLORS[2],
    "mapping": COLORS[3],
}
_LEAST_SHARE = 0.055  # of the axis: narrower parts have no room for a number


def draw(result: dict[str, Any]) -> Figure | None:
    """Gives the steps of each kind of frame: above with the network, below without it."""
    bars = _bars(values(result, "stages", "ms"))
    if not bars:
        return None
    figure = new_figure(1.75 + 0.75 * len(bars), "Where the time of a frame goes", machine_line(result))
    axes = figure.subplots(2, 1)
    everything = list(_STEPS)
    _panel(axes[0], bars, everything, "whole frame (ms)")
    _panel(axes[1], bars, [step for step in everything if step != "network"], "without the network (ms)")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(
        handles,
        labels,
        loc="outside lower left",
        ncols=3,
        fontsize=SMALL,
        frameon=False,
        labelcolor=INK,
        handlelength=1,
        handleheight=1,
    )
    return figure


def _bars(measures: Mapping[str, dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Gives for each kind of frame, by its title, the milliseconds of its steps."""
    bars: dict[str, dict[str, float]] = {}
    for name, measured in measures.items():
        kind, _, step = name.rpartition("_")
        if kind and step in STEPS:
            bars.setdefault(measured["title"].partition(":")[0], {})[step] = measured["value"]
    return bars


def _panel(axes: Axes, bars: Mapping[str, Mapping[str, float]], steps: list[str], title: str) -> None:
    names = [name.replace(", ", ",\n") for name in bars]
    totals = [sum(bar.get(step, 0.0) for step in steps) for bar in bars.values()]
    left = [0.0] * len(bars)
    for step in steps:
        widths = [bar.get(step, 0.0) for bar in bars.values()]
        axes.barh(
            names, widths, left=left, height=0.62, color=_STEPS[step], label=STEPS[step], edgecolor="white"
        )
        for row, width in enumerate(widths):
            if width > _LEAST_SHARE * max(totals):
                color = "white" if step in ("nms", "linking") else INK
                middle = left[row] + width / 2
                axes.text(middle, row, digits(width), ha="center", va="center", fontsize=SMALL, color=color)
            left[row] += width
    for row, total in enumerate(totals):
        text = f"  {digits(total)} ms"
        axes.text(total, row, text, va="center", fontsize=SMALL, color=GRAY, fontweight="bold")
    axes.set_xlim(0, 1.13 * max(totals))
    axes.invert_yaxis()
    tidy(axes, title=title)
    axes.tick_params(axis="y", labelcolor=INK)


__all__ = ["draw"]
