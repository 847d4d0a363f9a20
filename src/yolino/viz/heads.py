"""Arrow heads along lines: where they belong, which of them find room, and how they are drawn."""

from __future__ import annotations

from math import ceil

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from yolino.types import Polylines
from yolino.viz.colors import OUTLINE
from yolino.viz.strokes import SHIFT, Canvas, fixed, outlined

Widths = Int[np.ndarray, " n"]

_SHORTEST = 3  # pixels; on shorter lines a direction cannot be seen
_HEADS = 1000  # on one polyline
_MOVES = (0.0, 0.2, -0.2, 0.4, -0.4)  # of the way to the next head, to find room
_APART = 2.0  # lengths of a head to the next one, of any line


def arrow_axes(
    polylines: Polylines, widths: Widths | int, *, move: float = 0.0
) -> tuple[Float[np.ndarray, "k 2 2"], Int[np.ndarray, " k"]]:
    """Gives where arrow heads belong: evenly along each polyline, at least one.

    A short polyline gets one head, of at most half its length; one so short that the head would hide in its
    stroke gets none.

    Args:
        polylines: In pixels.
        widths: Of the stroke of each in pixels.
        move: By which part of the way to the next head all are moved along, -0.5 to 0.5.

    Returns:
        Foot and tip of each head, and the row of `polylines.endpoints` that it lies on.
    """
    pieces, owners = polylines.endpoints, polylines.owners
    delta = pieces[:, 1] - pieces[:, 0]
    run = np.hypot(delta[:, 0], delta[:, 1])
    at = np.concatenate([[0.0], np.cumsum(run)])  # all polylines one after the other
    first = np.searchsorted(owners, np.arange(len(polylines) + 1))
    total = at[first[1:]] - at[first[:-1]]
    wide = np.broadcast_to(np.asarray(widths), (len(polylines),))
    head = np.minimum(_head_lengths(wide), total / 2)
    counts = np.clip(np.rint(total / np.maximum(12 * head, 1e-9)), 1, _HEADS).astype(np.int64)
    counts[head < _least_heads(wide)] = 0
    owner = np.repeat(np.arange(len(polylines)), counts)
    within = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    feet = at[first[owner]] + (within + 0.5 + move) / counts[owner] * (total - head)[owner]
    places = [_along(pieces, at, run, where) for where in (feet, feet + head[owner])]
    return np.stack([places[0][0], places[1][0]], axis=1), places[1][1]


def placed_axes(
    canvas: Canvas, polylines: Polylines, widths: Widths
) -> tuple[Float[np.ndarray, "k 2 2"], Int[np.ndarray, " k"]]:
    """Gives the `arrow_axes` that find room: none comes closer to another than two lengths of a head.

    A head is moved along its line where its place is taken, and left out where there is no room nearby: at
    an intersection of many lines a few heads stay, not a blob. Large heads choose first, then those of lines
    with better scores.

    Args:
        canvas: What they are to be drawn on; heads outside of it are left out.
        polylines: In pixels.
        widths: Of the stroke of each in pixels.
    """
    tries = [arrow_axes(polylines, widths, move=move) for move in _MOVES]
    axes = np.stack([axes for axes, _ in tries])
    rows = np.stack([rows for _, rows in tries])
    if axes.shape[1] == 0:
        return axes[0], rows[0]
    owners = polylines.owners[rows[0]]
    lengths = np.minimum(_head_lengths(widths), polylines.lengths / 2)[owners]
    step = max(1.0, float(lengths.min()) / 4)
    order = np.lexsort((-polylines.scores[owners], -lengths))
    chosen = _choose(canvas, axes.mean(axis=2), lengths, order, step)
    heads = np.flatnonzero(chosen >= 0)
    return axes[chosen[heads], heads], rows[chosen[heads], heads]


def _choose(
    canvas: Canvas,
    places: Float[np.ndarray, "t k 2"],
    lengths: Float[np.ndarray, " k"],
    order: Int[np.ndarray, " k"],
    step: float,
) -> Int[np.ndarray, " k"]:
    """Gives which of its places each head takes, -1 for none, on a map of free room in cells of `step` px."""
    shape = ceil(canvas.shape[0] / step), ceil(canvas.shape[1] / step)
    taken = np.zeros(shape, np.uint8)
    cells = np.floor(np.clip(places, -1e6, 1e6) / step).astype(np.int64)
    inside = ((places >= 0) & (places < canvas.shape[1::-1])).all(axis=2)
    radii = np.maximum(1, np.rint(_APART * lengths / step)).astype(np.int64).tolist()
    chosen = np.full(len(order), -1, np.int64)
    columns, rows = np.where(inside, cells[..., 0], -1).T.tolist(), cells[..., 1].T.tolist()
    for head in order.tolist():
        for i, (x, y) in enumerate(zip(columns[head], rows[head], strict=True)):
            if x >= 0 and not taken[y, x]:
                cv2.circle(taken, (x, y), radii[head], 1, cv2.FILLED)
                chosen[head] = i
                break
    return chosen


def _along(
    pieces: Float[np.ndarray, "m 2 2"],
    at: Float[np.ndarray, " m_plus_1"],
    run: Float[np.ndarray, " m"],
    where: Float[np.ndarray, " k"],
) -> tuple[Float[np.ndarray, "k 2"], Int[np.ndarray, " k"]]:
    """Gives the points at arc lengths along all pieces, and the piece of each."""
    row = np.clip(np.searchsorted(at, where) - 1, 0, max(len(pieces) - 1, 0))
    share = (where - at[row]) / np.maximum(run[row], 1e-300)
    return pieces[row, 0] + np.clip(share, 0, 1)[:, None] * (pieces[row, 1] - pieces[row, 0]), row


def draw_heads(
    canvas: Canvas, axes: Float[np.ndarray, "k 2 2"], colors: UInt8[np.ndarray, "k 3"], widths: Widths
) -> None:
    """Draws arrow heads from foot to tip, later ones on top.

    None is longer than suits the thickness of its line, and none is drawn that would hide in its stroke.
    """
    way = axes[:, 1] - axes[:, 0]
    length = np.hypot(way[:, 0], way[:, 1])
    seen = (length >= _least_heads(widths)) & _on(canvas, axes[:, 1])
    tips, way, length = axes[seen, 1], way[seen], length[seen]
    back = way * (np.minimum(_head_lengths(widths[seen]), length) / length)[:, None]
    side = 0.45 * np.stack([-back[:, 1], back[:, 0]], axis=1)
    corners = fixed(np.stack([tips, tips - back + side, tips - 0.7 * back, tips - back - side], axis=1))
    drawn = zip(corners, colors[seen].tolist(), widths[seen].tolist(), strict=True)
    for quad, color, width in drawn:
        cv2.polylines(canvas, [quad], True, OUTLINE, 1 + 2 * ceil(width / 3), cv2.LINE_AA, SHIFT)
        cv2.fillPoly(canvas, [quad], color, cv2.LINE_AA, SHIFT)


def _on(canvas: Canvas, points: Float[np.ndarray, "k 2"]) -> Bool[np.ndarray, " k"]:
    return np.asarray(((points >= 0) & (points <= canvas.shape[1::-1])).all(axis=1))


def _least_heads(widths: Widths) -> Float[np.ndarray, " n"]:
    """Gives the lengths in pixels below which a head is hardly wider than its stroke with the outline."""
    least = {width: float(max(outlined(width), _SHORTEST)) for width in np.unique(widths).tolist()}
    return np.array([least[width] for width in widths.tolist()], np.float64)


def _head_lengths(widths: Widths) -> Float[np.ndarray, " n"]:
    """Gives the lengths of heads in pixels; those of thick lines grow slower, not to lie on the next lane."""
    return np.asarray(6.0 * np.minimum(widths, 3) + 3.0 * np.maximum(widths - 3, 0) + 4)


__all__ = ["arrow_axes", "draw_heads", "placed_axes"]
