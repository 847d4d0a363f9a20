"""The stages of the post-processing side by side (paper, appendix, section Post-processing)."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from numpy.typing import NDArray

from yolino.image import as_rgb
from yolino.types import Polylines, Segments
from yolino.viz.keys import draw_scale, draw_wheel
from yolino.viz.lines import draw_polylines, draw_segments
from yolino.viz.sheet import contact_sheet
from yolino.viz.strokes import Canvas

_TILE = (480, 1280)  # pixels: smallest and largest longer edge of a tile
_PALE = 0.4
TITLES = ("candidates", "above the threshold", "after the NMS", "polylines")


def draw_stages(
    image: NDArray[np.generic],
    candidates: Segments | None,
    kept: Segments,
    merged: Segments,
    polylines: Polylines,
    *,
    directed: bool = True,
    color_by: str = "identity",
    titles: Sequence[str] = TITLES,
    columns: int = 2,
    edge: int | None = None,
) -> Canvas:
    """Gives one picture of four: candidates, those above the threshold, after the NMS, linked polylines.

    Candidates have the color of their score, segments that of their direction. The titles tell how many
    there are.

    Args:
        image: RGB or gray pixels.
        candidates: All that the network says; None shows the image alone.
        kept: Segments with a score above the threshold.
        merged: What the NMS leaves of them.
        polylines: What the linker makes of those.
        directed: False draws no arrows and gives opposite directions the same hue.
        color_by: Color of the polylines, as in `draw_polylines`.
        titles: Four titles.
        columns: Tiles in a row: 4, 2 or 1.
        edge: Longer edge of a tile in pixels; by default the image's, but at least 480 and at most 1280.

    Raises:
        ValueError: If the image is none, a coordinate is not finite, or there are not four titles.
    """
    if len(titles) != len(TITLES):
        raise ValueError(f"{len(titles)} titles are given, but there are {len(TITLES)} stages.")
    small, scale = _resized(as_rgb(image), edge)
    first = small if candidates is None else _draw_candidates(small, _scaled(candidates, scale), kept)
    tiles = [first]
    for segments in (kept, merged):
        drawn = draw_segments(small, _scaled(segments, scale), directed=directed)
        tiles.append(draw_wheel(drawn, directed=directed))
    lines = polylines.with_vertices(polylines.vertices * scale)
    tiles.append(draw_polylines(small, lines, color_by=color_by, directed=directed))
    values = (candidates, kept, merged, polylines)
    named = [
        "image" if value is None else f"{len(value)} {title}"
        for value, title in zip(values, titles, strict=True)
    ]
    return contact_sheet(tiles, named, columns=columns, tile=(small.shape[0], small.shape[1]))


def _draw_candidates(image: Canvas, candidates: Segments, kept: Segments) -> Canvas:
    """Gives the image with candidates in the color of their score, those below the threshold pale."""
    threshold = kept.scores.min() if len(kept) else np.inf
    below = draw_segments(image, candidates[candidates.scores < threshold], color_by="score", thickness=1)
    pale = cv2.addWeighted(image, 1 - _PALE, below, _PALE, 0)
    above = candidates[candidates.scores >= threshold]
    return draw_scale(draw_segments(np.asarray(pale, np.uint8), above, color_by="score", thickness=1))


def _resized(
    image: Canvas, edge: int | None
) -> tuple[UInt8[np.ndarray, "nh nw 3"], Float[np.ndarray, "xy=2"]]:
    """Gives the image in the size of a tile, and by how much x and y are scaled."""
    longer = max(image.shape[:2])
    wanted = min(max(longer, _TILE[0]), _TILE[1]) if edge is None else edge
    if wanted == longer:
        return image, np.ones(2)
    size = [max(1, round(n * wanted / longer)) for n in image.shape[1::-1]]
    interpolation = cv2.INTER_AREA if wanted < longer else cv2.INTER_LINEAR
    small = np.asarray(cv2.resize(image, size, interpolation=interpolation), np.uint8)
    return small, np.array(size) / image.shape[1::-1]


def _scaled(segments: Segments, scale: Float[np.ndarray, "xy=2"]) -> Segments:
    return segments.with_endpoints(segments.endpoints * scale)


__all__ = ["TITLES", "draw_stages"]
