"""Draws the result of a benchmark: where a frame's time goes, races, growth, engines and the roofline."""

from __future__ import annotations

import importlib
import importlib.util
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
DPI = 160
_COLORS = 64


def plot(result: dict[str, Any], folder: str | Path) -> list[Path]:
    """Writes the pictures that the result has the numbers for, 1280 px wide, into a folder.

    Args:
        result: What `benchmark` gave, or `read_result`.
        folder: Where to write `frame.png`, `races.png`, `growth.png`, `engines.png` and `roofline.png`; it is
            made if need be.

    Returns:
        The files that were written.

    Raises:
        ModuleNotFoundError: Matplotlib is not installed.
        ValueError: No section of the result has anything to draw.
        OSError: The folder cannot be written.
    """
    check_matplotlib()
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
            "measure stages, nms, growth or engines, say."
        )
    return written


def check_matplotlib() -> None:
    """Sees that matplotlib is installed.

    Raises:
        ModuleNotFoundError: It is not.
    """
    if importlib.util.find_spec("matplotlib") is None:
        raise ModuleNotFoundError("Plots need matplotlib: pip install 'yolino[plot]'.")


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


__all__ = ["DPI", "PICTURES", "check_matplotlib", "plot"]
