"""Draws the sections that compare engines: a row for each, with a bar for each thing that was measured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from yolino.benchmark.plot_style import (
    BLUE,
    INK,
    ORANGE,
    SKY,
    SMALL,
    YELLOW,
    digits,
    machine_line,
    new_figure,
    tidy,
    values,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Table = Mapping[str, Mapping[str, float]]

# Sections whose measures are titled `engine: what was measured`, and the unit of those that are drawn.
_SECTIONS = {"engines": "ms", "paper": "ms", "files": "images/s"}
_COLORS = (BLUE, ORANGE, SKY, YELLOW)
_BAR, _GAP, _AROUND = 0.2, 0.12, 1.05  # inches
_WHOLE = "end to end"


def draw(result: dict[str, Any]) -> Figure | None:
    """Gives a panel for each section that was measured."""
    panels = {name: _table(result, name, unit) for name, unit in _SECTIONS.items()}
    panels = {name: table for name, table in panels.items() if table}
    if not panels:
        return None
    heights = [_AROUND + len(table) * (_BAR * len(_whats(table)) + _GAP) for table in panels.values()]
    figure = new_figure(0.6 + sum(heights), "Engines", machine_line(result))
    every = figure.subplots(len(panels), 1, squeeze=False, height_ratios=heights)[:, 0]
    for axes, (name, table) in zip(every, panels.items(), strict=True):
        _panel(axes, table, _SECTIONS[name])
        tidy(axes, title=f"{result['sections'][name]['title']} ({_SECTIONS[name]})")
        axes.tick_params(axis="y", labelcolor=INK)
    return figure


def _table(result: dict[str, Any], section: str, unit: str) -> dict[str, dict[str, float]]:
    """Gives the values of each engine by what was measured."""
    table: dict[str, dict[str, float]] = {}
    for measured in values(result, section, unit).values():
        engine, _, what = measured["title"].partition(": ")
        table.setdefault(engine, {})[what or "time"] = measured["value"]
    return table


def _whats(table: Table) -> list[str]:
    return list(dict.fromkeys(what for row in table.values() for what in row))


def _panel(axes: Axes, table: Table, unit: str) -> None:
    whats = _whats(table)
    height = _BAR / (_BAR * len(whats) + _GAP)
    for index, what in enumerate(whats):
        rows = [row for row, cells in enumerate(table.values()) if what in cells]
        widths = [cells[what] for cells in table.values() if what in cells]
        places = [row + (index - (len(whats) - 1) / 2) * height for row in rows]
        axes.barh(places, widths, height=0.9 * height, color=_COLORS[index % len(_COLORS)], label=what)
        for place, width in zip(places, widths, strict=True):
            rate = f"  {1e3 / width:,.0f} fps" if unit == "ms" and what.startswith(_WHOLE) and width else ""
            axes.text(width, place, f" {digits(width)}{rate}", va="center", fontsize=SMALL, color=INK)
    axes.set_yticks(range(len(table)), list(table))
    axes.set_ylim(len(table) - 0.5, -0.5)
    axes.margins(x=0.15)
    axes.legend(
        loc="upper left",
        bbox_to_anchor=(0, -0.25 / (len(table) * (_BAR * len(whats) + _GAP))),
        ncols=2,
        fontsize=SMALL,
        frameon=False,
        labelcolor=INK,
        borderpad=0,
    )


__all__ = ["draw"]
