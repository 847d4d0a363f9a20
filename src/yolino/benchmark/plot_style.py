"""How the plots of the benchmark look: sizes, colors, and what every axis has."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from yolino.benchmark.plot import DPI

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH = 8.0  # inches
# Okabe and Ito's colors: color-blind people tell them apart.
BLUE, ORANGE, GREEN, PINK, YELLOW, SKY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"
COLORS = (BLUE, ORANGE, GREEN, PINK, YELLOW, SKY)
GRAY, LIGHT, INK = "#767676", "#DDDDDD", "#222222"
SMALL, NORMAL, LARGE = 9, 10, 12


def new_figure(height: float, title: str, subtitle: str = "") -> Figure:
    """Gives an empty figure of the usual width.

    Args:
        height: In inches.
        title: What it says, above everything.
        subtitle: What it was measured on, below the title.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height), dpi=DPI, layout="constrained", facecolor="white")
    text = f"{title}\n" if subtitle else title
    style = {"x": 0.012, "ha": "left", "color": INK}
    figure.suptitle(text, fontsize=LARGE, fontweight="bold", linespacing=1.5, **style)
    if subtitle:
        figure.text(0.012, 1 - 0.3 / height, subtitle, ha="left", va="top", fontsize=SMALL, color=GRAY)
    return figure


def machine_line(result: dict[str, Any]) -> str:
    """Gives what the numbers were measured on, in a line."""
    machine, model = result["machine"], result["model"]
    parts = [f"{machine['cpu']}, {machine['threads']} threads"]
    if model is not None:
        parts.insert(0, f"{model['name']} {model['size'][0]}x{model['size'][1]} on {model['device']}")
    if result["settings"]["quick"]:
        parts.append("QUICK: the numbers mean nothing")
    return "; ".join(parts)


def tidy(axes: Axes, *, title: str = "", grid: str = "x") -> None:
    """Takes away what says nothing: upper and right spines, ticks, dark grid lines.

    Args:
        axes: What to tidy.
        title: Heading, to the left.
        grid: Axis whose values are to be read off: "x", "y" or "both"; "" draws no lines.
    """
    axes.set_title(title, loc="left", fontsize=NORMAL, color=INK)
    axes.spines[["top", "right", "left", "bottom"]].set_visible(False)
    axes.tick_params(length=0, labelsize=SMALL, colors=GRAY, which="both")
    axes.set_axisbelow(True)
    if grid == "both":
        axes.grid(color=LIGHT, linewidth=0.6)
    elif grid:
        axes.grid(axis="x" if grid == "x" else "y", color=LIGHT, linewidth=0.6)


def digits(value: float) -> str:
    """Gives three significant digits (two below one), thousands with a comma and millions as M."""
    if abs(value) >= 1e6:
        return f"{digits(value / 1e6)}M"
    if abs(value) >= 999.5:  # what three digits round to 1,000, too
        return f"{value:,.0f}"
    return f"{value:.3g}" if abs(value) >= 1 else f"{value:.2g}"


def values(result: dict[str, Any], section: str, unit: str | None = None) -> dict[str, dict[str, Any]]:
    """Gives the measures of a section that have a value (of a unit), by name; none if it was not measured.

    Args:
        result: What `benchmark` gave.
        section: Name of the section.
        unit: Unit that they must have.
    """
    measures = result["sections"].get(section, {}).get("measures", {})
    return {
        name: measured
        for name, measured in measures.items()
        if measured["value"] is not None and unit in (None, measured["unit"])
    }


__all__ = [
    "BLUE",
    "COLORS",
    "GRAY",
    "GREEN",
    "INK",
    "LARGE",
    "LIGHT",
    "NORMAL",
    "ORANGE",
    "PINK",
    "SKY",
    "SMALL",
    "WIDTH",
    "YELLOW",
    "digits",
    "machine_line",
    "new_figure",
    "tidy",
    "values",
]
