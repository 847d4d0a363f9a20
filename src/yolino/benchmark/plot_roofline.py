"""Draws the roofline: what the machine computes at most, and what networks reach of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from yolino.benchmark.plot_style import (
    BLUE,
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

# Sections that say what networks reach, and what names the network in a row.
_PREFIXES = {"engines": "", "paper": "Darknet-19, "}
_UNIT, _PART = "GFLOP/s", "_roofline"


def draw(result: dict[str, Any]) -> Figure | None:
    """Gives the matrix products of `roofline`, and below the part of them that each engine reaches.

    Nothing of a quick run: its tiny products are mostly overhead, and networks "reach" 1,300 % of them.
    """
    if result["settings"]["quick"]:
        return None
    peaks = {m["title"]: m["value"] for m in values(result, "roofline", _UNIT).values()}
    reached = {
        _PREFIXES[section] + m["title"].partition(":")[0]: m["value"]
        for section in _PREFIXES
        for name, m in values(result, section, "%").items()
        if name.endswith(_PART)
    }
    panels = [
        (peaks, f"matrix product, billions of operations per second ({_UNIT})", LIGHT, ""),
        (reached, "part of it that the network reaches (%)", BLUE, " %"),
    ]
    panels = [panel for panel in panels if panel[0]]
    if not panels:
        return None
    heights = [len(panel[0]) for panel in panels]
    height = 0.8 + sum(0.75 + 0.3 * rows for rows in heights)
    figure = new_figure(height, "What this machine computes at most", machine_line(result))
    every = figure.subplots(len(panels), 1, squeeze=False, height_ratios=heights)[:, 0]
    for axes, (bars, title, color, unit) in zip(every, panels, strict=True):
        _panel(axes, bars, color, unit)
        tidy(axes, title=title)
        axes.tick_params(axis="y", labelcolor=INK)
    return figure


def _panel(axes: Axes, bars: Mapping[str, float], color: str, unit: str) -> None:
    axes.barh(range(len(bars)), list(bars.values()), height=0.7, color=color)
    for row, value in enumerate(bars.values()):
        axes.text(value, row, f" {digits(value)}{unit}", va="center", fontsize=SMALL, color=INK)
    axes.set_yticks(range(len(bars)), [name.removeprefix("matrix product, ") for name in bars])
    axes.set_ylim(len(bars) - 0.4, -0.6)
    axes.margins(x=0.1)


__all__ = ["draw"]
