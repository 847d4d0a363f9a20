"""How thick lines can be: thinner where many of them are close to each other."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, Int

from yolino.types import Polylines
from yolino.viz.strokes import Canvas, Thickness, auto_thickness, image_edge, outlined

_COVERED = 0.08  # of the image, by lines of a thickness that nobody asked for
_CROWDED = 0.45  # of the surroundings of a line, by the strokes of all lines there
_AROUND = 1 / 32  # of the edge of the image: edge of the surroundings
_CELLS = 3  # along the edge of the surroundings
_THINNEST = 3  # times as thin as alone is a line in a crowd at most


def fitting_widths(canvas: Canvas, lines: Polylines, thickness: Thickness) -> Int[np.ndarray, " n"]:
    """Gives the thickness of each line in pixels.

    If "auto", all lines together leave most of the image to be seen, and lines in a crowd are up to three
    times thinner, until they leave half of their surroundings to be seen.

    Args:
        canvas: What they are drawn on.
        lines: In pixels, cut to the canvas; parts with the same label get the same thickness.
        thickness: Pixels, or "auto".
    """
    width = auto_thickness(canvas, thickness)
    if thickness != "auto":
        return np.full(len(lines), width, np.int64)
    room = _COVERED * canvas.shape[0] * canvas.shape[1]
    length = float(lines.lengths.sum())
    while width > 1 and outlined(width) * length > room:
        width -= 1
    density = line_density(canvas, lines)
    widths = np.full(len(lines), width, np.int64)
    for thinner in range(width - 1, -(-width // _THINNEST) - 1, -1):
        widths[outlined(thinner + 1) * density > _CROWDED] = thinner
    return widths


def line_density(canvas: Canvas, lines: Polylines) -> Float[np.ndarray, " n"]:
    """Gives the length of all lines around each one per area there, in 1/px; the same for equal labels."""
    cell = max(1.0, _AROUND * image_edge(canvas) / _CELLS)
    pieces = lines.endpoints
    delta = pieces[:, 1] - pieces[:, 0]
    run = np.hypot(delta[:, 0], delta[:, 1])
    counts = np.maximum(1, np.ceil(run / cell)).astype(np.int64)
    row = np.repeat(np.arange(len(pieces)), counts)
    share = (np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts) + 0.5) / counts[row]
    points = pieces[row, 0] + share[:, None] * delta[row]
    shape = int(canvas.shape[0] / cell) + 1, int(canvas.shape[1] / cell) + 1
    at = np.clip(np.floor(points / cell).astype(np.int64), 0, (shape[1] - 1, shape[0] - 1))
    place, weight = at[:, 1] * shape[1] + at[:, 0], run[row] / counts[row]
    lengths = np.bincount(place, weight, shape[0] * shape[1]).reshape(shape)
    around = cv2.blur(lengths, (_CELLS, _CELLS), borderType=cv2.BORDER_REFLECT) / cell**2
    _, group = np.unique(lines.labels, return_inverse=True)
    owner, groups = group[lines.owners[row]], int(group.max(initial=-1)) + 1
    total = np.bincount(owner, weight, groups)
    mean = np.bincount(owner, weight * around.reshape(-1)[place], groups) / np.maximum(total, 1e-9)
    return np.asarray(mean[group])


__all__ = ["fitting_widths", "line_density"]
