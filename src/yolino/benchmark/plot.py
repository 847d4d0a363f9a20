"""Draws the result of a benchmark: where a frame's time goes, races, growth, engines and the roofline."""

from __future__ import annotations

import importlib
import importlib.util
import os
from collections.abc import Iterable
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from yolino.io import write_atomic

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Name of the picture -> module below `yolino.benchmark` whose `draw` gives it, or None without its numbers.
PICTURES = {
    "frame": "plot_frame",
    "races": "plot_races",
    "growth": "plot_growth",
    "engines": "plot_engines",
    "roofline": "plot_roofline",
}
# Name of the picture -> sections that it draws.
DRAWN = {
    "frame": ("stages",),
    "races": ("nms", "linking", "points", "matching", "loading", "darknet19"),
    "growth": ("growth",),
    "engines": ("engines", "paper", "files"),
    "roofline": ("roofline", "engines", "paper"),
}
DPI = 160
_COLORS = 64


def plot(result: dict[str, Any], folder: str | Path) -> list[Path]:
    """Writes the pictures that the result has the numbers for, 1280 px wide, into a folder.

    Args:
        result: What `benchmark` gave, or `read_result`.
        folder: Where to write `frame.png`, `races.png`, `growth.png`, `engines.png` and `roofline.png` (the
            last not of a quick run, whose roofline is nonsense); it is made if need be.

    Returns:
        The files that were written.

    Raises:
        ModuleNotFoundError: Matplotlib is not installed.
        ValueError: No section of the result has anything to draw, or the folder is a file.
        OSError: The folder cannot be written.
    """
    check_plot(folder)
    written = []
    for name, module in PICTURES.items():
        figure = importlib.import_module(f"yolino.benchmark.{module}").draw(result)
        if figure is not None:
            path = Path(folder) / f"{name}.png"
            write_atomic(path, _png(figure))
            written.append(path)
    if not written:
        sections = ", ".join(result["sections"]) or "none"
        raise ValueError(
            f"Nothing can be drawn of the sections that were measured ({sections}): "
            f"measure {_either(drawable(quick=result['settings']['quick']))}."
        )
    return written


def check_plot(folder: str | Path, sections: Iterable[str] | None = None, *, quick: bool = False) -> None:
    """Sees that pictures can be drawn, before minutes of measuring.

    Args:
        folder: Where they are to be written.
        sections: Names of the sections that will be measured; None if that is not known.
        quick: Whether they will be measured quickly.

    Raises:
        ModuleNotFoundError: Matplotlib is not installed.
        ValueError: The folder is a file, or below one, or no section can be drawn.
        PermissionError: The folder cannot be written.
    """
    if importlib.util.find_spec("matplotlib") is None:
        raise ModuleNotFoundError("Plots need matplotlib: pip install 'yolino[plot]'.")
    folder = Path(folder)
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not there.is_dir():
        raise ValueError(f"{there} is a file, but the pictures need a folder: give another name.")
    if not os.access(there, os.W_OK | os.X_OK):
        raise PermissionError(f"The folder {there} cannot be written: give another one for the pictures.")
    names = drawable(quick=quick)
    if sections is not None and not set(names) & set(sections := list(sections)):
        run = "of a quick run of" if quick else "of"
        raise ValueError(f"Nothing can be drawn {run} {', '.join(sections)}: measure {_either(names)}.")


def drawable(*, quick: bool = False) -> list[str]:
    """Gives the names of the sections that a picture can be drawn of."""
    pictures = [sections for name, sections in DRAWN.items() if not (quick and name == "roofline")]
    return list(dict.fromkeys(section for sections in pictures for section in sections))


def _either(names: list[str]) -> str:
    return f"{', '.join(names[:-1])} or {names[-1]}"


def _png(figure: Figure) -> bytes:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image  # matplotlib needs it, too

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    # Few colors, a third of the bytes.
    picture = Image.fromarray(np.asarray(canvas.buffer_rgba())[:, :, :3].copy()).quantize(_COLORS)
    stream = BytesIO()
    picture.save(stream, "PNG", optimize=True)
    return stream.getvalue()


__all__ = ["DPI", "DRAWN", "PICTURES", "check_plot", "drawable", "plot"]
