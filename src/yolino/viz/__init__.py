"""Drawing: polylines, segments and matched points on images, and sheets of many images.

Every function gives a new uint8 RGB image and leaves its input as it is. Lines have a bright core in a dark
outline, so that they show on any background, and a thickness that follows the size of the image.
"""

from __future__ import annotations

from yolino.viz.colors import FALSE_ALARM, HIT, MISS, PALETTE, direction_colors, palette, score_colors
from yolino.viz.lines import draw_points, draw_polylines, draw_segments
from yolino.viz.sheet import contact_sheet, draw_legend, draw_matches, draw_regions

__all__ = [
    "FALSE_ALARM",
    "HIT",
    "MISS",
    "PALETTE",
    "contact_sheet",
    "direction_colors",
    "draw_legend",
    "draw_matches",
    "draw_points",
    "draw_polylines",
    "draw_regions",
    "draw_segments",
    "palette",
    "score_colors",
]
