"""Drawing: polylines, segments, cells and matched points on images, and sheets of many images.

Every function gives a new uint8 RGB image and leaves its input as it is. Lines have a bright core in a dark
outline, so that they show on any background, and a thickness that follows the size of the image.
"""

from __future__ import annotations

from yolino.viz.cells import cell_edge, draw_cells, readable_zoom
from yolino.viz.colors import FALSE_ALARM, HIT, MISS, PALETTE, direction_colors, palette, score_colors
from yolino.viz.keys import draw_legend, draw_scale, draw_wheel
from yolino.viz.lines import draw_points, draw_polylines, draw_segments, find_junctions
from yolino.viz.sheet import contact_sheet, draw_matches, draw_regions, fit_tile
from yolino.viz.stages import draw_stages
from yolino.viz.strokes import enlarge, tiny_zoom

__all__ = [
    "FALSE_ALARM",
    "HIT",
    "MISS",
    "PALETTE",
    "cell_edge",
    "contact_sheet",
    "direction_colors",
    "draw_cells",
    "draw_legend",
    "draw_matches",
    "draw_points",
    "draw_polylines",
    "draw_regions",
    "draw_scale",
    "draw_segments",
    "draw_stages",
    "draw_wheel",
    "enlarge",
    "find_junctions",
    "fit_tile",
    "palette",
    "readable_zoom",
    "score_colors",
    "tiny_zoom",
]
