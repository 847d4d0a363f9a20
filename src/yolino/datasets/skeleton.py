"""A mask of lines to polylines: thinning, the graph of the skeleton's pixels, branches, simplification.

A junction is one vertex that all its branches share exactly; branches are cut there. The mask is continued
beyond its border as in a mirror, so that lines that leave the image reach its border.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import no_type_check

import cv2
import numpy as np
from jaxtyping import Bool, Float

from yolino.compiled import compiled
from yolino.datasets.branches import Branches
from yolino.types import Polylines

# Thicker regions are no lines; mirrored further, they would only cost time.
_WIDEST = 128
# Pixels of the mirrored margin that stay, so that lines reach the border.
_MARGIN = 1
# Distance of a place that is the same but for thinning.
_CLOSE = 2.0
# Number of points that tell the direction of a line's end, and most points that its mirror image bends.
_TAIL, _BENT = 10, 200


def mask_to_polylines(
    mask: Bool[np.ndarray, "h w"],
    *,
    tolerance: float = 1.0,
    spur: float = 8.0,
    min_length: float = 10.0,
    holes: int = 10,
) -> Polylines:
    """Gives the center lines of what is True, in pixels: `(column + 0.5, row + 0.5)` is a pixel's center.

    Branches are cut at junctions and share the junction's vertex. Closed lines repeat their first vertex.
    Directions mean nothing: each line runs from its end that lies further left (of two equal ones, further
    up), and the lines are sorted by their vertices.

    Thinning is Lee's of `skimage.morphology.skeletonize`, simplification Douglas and Peucker's of
    `skimage.measure.approximate_polygon`. Thinning displaces junctions, draws crossings out and stops short
    of ends; that is mended: a junction is where its branches meet when they go straight on.

    Args:
        mask: Where the lines are.
        tolerance: Largest distance in pixels between a pixel of the skeleton and the simplified line, away
            from junctions and ends.
        spur: Branches with a free end are cut off that stick out of the line they leave by less than this,
            in pixels.
        min_length: Lines are left out if all that is connected with them is shorter than this, in pixels.
        holes: Largest number of pixels of a hole that is filled before thinning.

    Raises:
        ValueError: One of the numbers is negative or not finite.
    """
    for name, value in (
        ("tolerance", tolerance),
        ("spur", spur),
        ("min_length", min_length),
        ("holes", holes),
    ):
        if not 0 <= value < math.inf:
            raise ValueError(f"{name} is {value}, but must be a finite number of pixels, not negative.")
    if not mask.any():
        return Polylines.from_list([])
    skeleton, radii = _thin(_fill_holes(mask, holes))
    branches = _trace(skeleton, radii)
    branches.clean(spur, min_length)
    for node in branches.free_ends():
        branches.move_end(node, *_true_end(branches.line_from(node), radii))
    limit = np.array([mask.shape[1], mask.shape[0]], np.float64)
    lines = [_finish(np.clip(line, 0.0, limit), tolerance) for line in branches.lines()]
    kept = [line.tolist() for line in lines if (line != line[0]).any()]
    return Polylines.from_list(sorted(kept))


def _fill_holes(mask: Bool[np.ndarray, "h w"], largest: int) -> Bool[np.ndarray, "h w"]:
    """Gives the mask with holes of at most `largest` pixels filled."""
    background = (~mask).view(np.uint8)
    count, pieces, stats, _ = cv2.connectedComponentsWithStats(background, connectivity=4)
    small = stats[:, cv2.CC_STAT_AREA] <= largest
    left, top = stats[:, cv2.CC_STAT_LEFT], stats[:, cv2.CC_STAT_TOP]
    right, bottom = left + stats[:, cv2.CC_STAT_WIDTH], top + stats[:, cv2.CC_STAT_HEIGHT]
    # What touches the border may go on outside.
    inside = (left > 0) & (top > 0) & (right < mask.shape[1]) & (bottom < mask.shape[0])
    filled = small & inside
    filled[0] = True  # the label of what is no background
    return np.asarray(filled[pieces]) if filled[1:count].any() else mask


def _thin(mask: Bool[np.ndarray, "h w"]) -> tuple[Bool[np.ndarray, "r c"], Float[np.ndarray, "r c"]]:
    """Gives the skeleton and half the width of the lines at each pixel, both with a margin of one pixel."""
    from skimage.morphology import skeletonize

    distance = cv2.distanceTransform(mask.view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    pad = int(min(float(distance.max()), _WIDEST / 2)) + _MARGIN + 2
    skeleton = np.asarray(skeletonize(np.pad(mask, pad, mode="symmetric"), method="lee")) > 0
    cut = pad - _MARGIN
    radii = np.pad(distance - 0.5, _MARGIN, mode="edge")
    return skeleton[cut:-cut, cut:-cut], radii.astype(np.float64)


def _trace(skeleton: Bool[np.ndarray, "r c"], radii: Float[np.ndarray, "r c"]) -> Branches:
    """Gives the graph of the skeleton."""
    rows, columns, links = _link_pixels(np.pad(skeleton, 1))
    rows, columns = rows - 1, columns - 1
    nodes, count = _number_nodes(rows, columns, links)
    pixels, offsets, ends = _walk(links, nodes)
    points = np.stack([columns, rows], axis=1) - _MARGIN + 0.5
    there = nodes >= 0
    sizes = np.bincount(nodes[there], minlength=count)
    places = [np.bincount(nodes[there], points[there, axis], count) / sizes for axis in (0, 1)]
    widths = np.zeros(count)
    np.maximum.at(widths, nodes[there], radii[rows[there], columns[there]])
    paths = [points[pixels[start:stop]] for start, stop in pairwise(offsets.tolist())]
    return Branches(paths, ends.tolist(), np.stack(places, axis=1), widths)


def _true_end(
    line: Float[np.ndarray, "p 2"], radii: Float[np.ndarray, "r c"]
) -> tuple[Float[np.ndarray, " 2"], int]:
    """Gives where a line ends, and how many points of the skeleton there are wrong.

    Thinning stops short of the end by up to 4 pixels: a line ends where a circle as wide as the line still
    lies inside and touches its edge in front. Where the line leaves the image, its mirror image bends it.

    Args:
        line: The skeleton from the end inwards.
        radii: Half the width of the line at each pixel, with the margin.
    """
    limit = np.array(radii.shape[::-1]) - 2.0 * _MARGIN
    columns, rows = np.clip(np.floor(line[:_BENT]) + _MARGIN, 0, limit + 1).astype(np.int64).T
    near = np.minimum(line[:_BENT], limit - line[:_BENT]).min(axis=1) < radii[rows, columns] + 1
    bent = int(near.argmin()) if near[0] and not near.all() else 0
    tail = line[bent:][: _TAIL + bent // 2]
    delta = tail[0] - tail[-1]
    unit = delta / max(float(np.hypot(*delta)), 1.0)
    if bent and unit.any():
        border = np.where(unit > 0, limit, 0.0)
        ahead = np.divide(border - tail[0], unit, out=np.full(2, np.inf), where=unit != 0)
        axis = int(ahead.argmin())
        place = np.clip(tail[0] + min(float(ahead[axis]), 1e6) * unit, 0.0, limit)
        place[axis] = border[axis]
        column, row = np.minimum(place, limit - 0.5).astype(np.int64) + _MARGIN
        # A line along the border meets it far away, where there is no mask.
        seen = radii[row, column] > 0 or np.hypot(*(place - line[0])) < _CLOSE
        return (place, bent - 1) if seen and ahead[axis] <= 2 * bent + 4 else (line[0], 0)
    steps = np.arange(1, 5)[:, None] * unit
    columns, rows = np.clip(np.floor(line[:1] + steps) + _MARGIN, 0, limit + 1).astype(np.int64).T
    least = radii[tuple(np.floor(line[0, ::-1] + _MARGIN).astype(np.int64))] - 0.5
    wide = radii[rows, columns] >= max(float(least), 0.5)
    count = int(np.argmin(np.append(wide, False)))
    return np.asarray(line[0] + count * unit), 0


def _finish(line: Float[np.ndarray, "v 2"], tolerance: float) -> Float[np.ndarray, "w 2"]:
    """Gives the line simplified, in its canonical direction."""
    from skimage.measure import approximate_polygon

    line = line[np.append(True, (np.diff(line, axis=0) != 0).any(axis=1))]
    if len(line) > 2:
        line = np.asarray(approximate_polygon(line, tolerance))
    there, back = line.tolist(), line[::-1].tolist()
    return line if there <= back else line[::-1]


@compiled
@no_type_check
def _link_pixels(skeleton):
    """Gives row and column of each pixel of the skeleton, and its neighbours, -1 where there are no more.

    A diagonal step is left out where two straight ones lead there too: so a corner is no junction. The
    border of `skeleton` must be empty.
    """
    height, width = skeleton.shape
    index = np.full((height, width), -1, np.int32)
    count = 0
    for y in range(height):
        for x in range(width):
            if skeleton[y, x]:
                index[y, x] = count
                count += 1
    rows, columns = np.empty(count, np.int64), np.empty(count, np.int64)
    links = np.full((count, 8), -1, np.int64)
    for y in range(1, height - 1):
        for x in range(1, width - 1):
            i = index[y, x]
            if i < 0:
                continue
            rows[i], columns[i] = y, x
            degree = 0
            for dy in range(-1, 2):
                for dx in range(-1, 2):
                    j = index[y + dy, x + dx]
                    around = dy != 0 and dx != 0 and (index[y + dy, x] >= 0 or index[y, x + dx] >= 0)
                    if j >= 0 and j != i and not around:
                        links[i, degree] = j
                        degree += 1
    return rows, columns, links


@compiled
@no_type_check
def _number_nodes(rows, columns, links):
    """Gives the node of each pixel (-1: none) and their number: free ends, and groups of junction pixels.

    Junction pixels that touch, be it at a corner, are one node.
    """
    nodes = np.full(len(rows), -1, np.int64)
    waiting = np.empty(len(rows), np.int64)
    count = 0
    for i in range(len(rows)):
        if links[i, 0] >= 0 and links[i, 1] < 0:
            nodes[i] = count
            count += 1
        if links[i, 2] < 0 or nodes[i] >= 0:
            continue
        nodes[i], waiting[0], left = count, i, 1
        while left > 0:
            left -= 1
            at = waiting[left]
            # Pixels are sorted by row and column: those that touch are linked, or linked over one pixel.
            for first in links[at]:
                if first < 0:
                    break
                for k in range(-1, 8):
                    j = first if k < 0 else links[first, k]
                    near = j >= 0 and abs(rows[j] - rows[at]) <= 1 and abs(columns[j] - columns[at]) <= 1
                    if near and links[j, 2] >= 0 and nodes[j] < 0:
                        nodes[j], waiting[left] = count, j
                        left += 1
        count += 1
    return nodes, count


@compiled
@no_type_check
def _walk(links, nodes):
    """Gives the pixels between the nodes, branch by branch, their offsets, and the nodes at both ends.

    Rings without a node have -1 at both ends.
    """
    pixels, filled = np.empty(len(nodes), np.int64), 0
    most = len(nodes) + (links >= 0).sum()
    offsets, ends, count = np.zeros(most + 1, np.int64), np.full((most, 2), -1, np.int64), 0
    seen = np.zeros(len(nodes), np.bool_)
    for ring in range(2):
        for i in range(len(nodes)):
            if (ring == 1) == (nodes[i] >= 0) or seen[i] or links[i, 0] < 0:
                continue
            for j in links[i]:
                if j < 0:
                    break
                inside = nodes[j] >= 0 and (nodes[j] == nodes[i] or j < i)
                if inside or seen[j]:
                    continue
                last, at = i, j
                while nodes[at] < 0 and not seen[at]:
                    seen[at] = True
                    pixels[filled] = at
                    filled += 1
                    following = links[at, 0] if links[at, 0] != last else links[at, 1]
                    last, at = at, following
                if ring == 0:
                    ends[count, 0], ends[count, 1] = nodes[i], nodes[at]
                count += 1
                offsets[count] = filled
    return pixels[:filled], offsets[: count + 1], ends[:count]


__all__ = ["mask_to_polylines"]
