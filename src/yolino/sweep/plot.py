"""Draws the training and validation curves of all runs of a sweep, a row of panels for each group."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from yolino.io import write_atomic
from yolino.sweep.curves import Curve, read_curves
from yolino.sweep.description import Group, Sweep
from yolino.sweep.result import Row, run_folders

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito's colors: color-blind people tell them apart. Beyond them, the dashes change.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
DASHES = ("-", (0, (5, 1.5)), (0, (1.5, 1.5)))
GRAY, LIGHT, INK = "#767676", "#DDDDDD", "#222222"
WIDTH, HEIGHT, HEAD, DPI = 9.0, 2.3, 0.75, 160  # inches; HEIGHT of a group
_LEGEND = 12  # rows that can be named beside a panel of this height
_INSIDE = 4  # rows whose names have room inside, below the curves
Runs = dict[str, list[dict[str, Curve]]]


def draw_curves(sweep: Sweep, rows: dict[str, Row], out: Path) -> Path | None:
    """Writes `curves.png`; gives its path, or None while no run has validated anything.

    To the left validation F1, to the right the localization loss, in training (thin) and validation (thick).
    Runs of one row with other seeds have the same color.

    Raises:
        ModuleNotFoundError: Matplotlib is not installed.
        OSError: The file cannot be written.
    """
    curves = {name: _of_row(name, out) for name in rows}
    groups = [group for group in sweep.layout.groups if any(curves[row] for row in group.rows)]
    if not groups:
        return None
    from matplotlib.figure import Figure

    heights = [HEIGHT * max(1.0, sum(map(bool, map(curves.get, g.rows))) / _LEGEND) for g in groups]
    figure = Figure(figsize=(WIDTH, HEAD + sum(heights)), dpi=DPI, layout="constrained", facecolor="white")
    panels = figure.subplots(len(groups), 2, squeeze=False, height_ratios=heights)
    figure.suptitle(sweep.layout.title, x=0.01, ha="left", fontsize=12, fontweight="bold", color=INK)
    for (left, right), group in zip(panels, groups, strict=True):
        _draw_group(left, right, group, curves)
    for panel in panels[-1]:
        panel.set_xlabel("step", fontsize=9, color=GRAY)
    path = out / "curves.png"
    write_atomic(path, _png(figure))
    return path


def _of_row(name: str, out: Path) -> list[dict[str, Curve]]:
    """Gives the curves of the runs of a row, finished or not, by seed."""
    found = [read_curves(folder) for folder in run_folders(name, out).values()]
    return [curves for curves in found if "val/f1" in curves]


def _draw_group(left: Axes, right: Axes, group: Group, curves: Runs) -> None:
    for i, row in enumerate(group.rows):
        color, dashes = COLORS[i % len(COLORS)], DASHES[i // len(COLORS) % len(DASHES)]
        for n, run in enumerate(curves[row]):
            label = {"label": row} if n == 0 else {}
            _line(left, run["val/f1"], color=color, linestyle=dashes, linewidth=1.6, **label)
            if "val/loc" in run:
                _line(right, run["val/loc"], color=color, linestyle=dashes, linewidth=1.6)
            if "train/loc" in run:
                _line(right, run["train/loc"], color=color, linestyle=dashes, linewidth=0.8, alpha=0.6)
    _tidy(left, f"{group.title}: validation F1" if group.title else "Validation F1")
    _tidy(right, "Localization loss: validation thick, training thin")
    left.set_ylim(0, 1)
    right.set_ylim(bottom=0)
    many = len(group.rows) > _INSIDE
    place = {"loc": "center right", "bbox_to_anchor": (-0.12, 0.5)} if many else {"loc": "lower right"}
    left.legend(frameon=False, fontsize=8, labelcolor=INK, **place)


def _line(axes: Axes, curve: Curve, **style: Any) -> None:
    steps, values = curve
    known = np.isfinite(values)
    # A single point would draw no line.
    axes.plot(steps[known], values[known], marker="o" if known.sum() == 1 else None, markersize=3, **style)


def _tidy(axes: Axes, title: str) -> None:
    axes.set_title(title, loc="left", fontsize=9, color=INK)
    axes.spines[["top", "right", "left", "bottom"]].set_visible(False)
    axes.tick_params(length=0, labelsize=8, colors=GRAY, which="both")
    axes.set_axisbelow(True)
    axes.grid(axis="y", color=LIGHT, linewidth=0.6)


def _png(figure: Figure) -> bytes:
    stream = BytesIO()
    figure.savefig(stream, format="png")
    return stream.getvalue()


__all__ = ["draw_curves"]
