"""Which of the model's segments belong to which label: distances and directions, no opinions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from yolino.evaluate.oracles_case import ANGLE_RADIUS, Case
from yolino.geometry import resample
from yolino.metrics.metric import Lines
from yolino.metrics.nearest import nearest_samples
from yolino.metrics.samples import Samples, sample_lines
from yolino.types import Polylines, Segments

_CONTINUED_CELLS = 6.0
_LOOK_BACK = 2  # cells at the end of a label that tell where it would go on


def midpoint_samples(segments: Segments) -> Samples:
    """Gives the midpoint of each segment with its direction; without length it has none."""
    delta = segments.ends - segments.starts
    lengths = np.hypot(delta[:, 0], delta[:, 1])
    directions = delta / np.where(lengths > 0, lengths, 1.0)[:, None]
    return Samples(segments.midpoints, directions, segments.labels, np.arange(len(segments)))


class Places(NamedTuple):
    """Where segments lie along the labels, a row for each segment.

    Attributes:
        owners: The label that its midpoint is nearest to, -1 for none within the radius.
        at: How far along that label, in pixels; negative before its start.
        beyond: Whether it lies before the start or behind the end of the label, where it would go on.
        directions: Unit vector along the label there.
    """

    owners: Int[np.ndarray, " n"]
    at: Int[np.ndarray, " n"]
    beyond: Bool[np.ndarray, " n"]
    directions: Float[np.ndarray, "n 2"]


def places_along(segments: Segments, case: Case, radius: float) -> Places:
    """Gives where the segments lie along the labels, or along their straight continuations of 6 cells.

    Args:
        segments: Segments.
        case: The image.
        radius: Largest distance in pixels; directions may differ by 45 degrees.
    """
    count = len(case.truth)
    lines = Polylines.from_list([*case.truth, *_continued(case.truth, case.grid.stride)])
    samples = sample_lines(lines, case.grid.size)
    nearest, _ = nearest_samples(
        midpoint_samples(segments), samples, radius, ANGLE_RADIUS, directed=case.directed
    )
    found = nearest >= 0
    if not found.any():
        none = np.full(len(segments), -1)
        return Places(none, np.zeros_like(none), np.zeros(len(none), np.bool_), np.zeros((len(none), 2)))
    lengths = np.bincount(samples.owners, minlength=3 * count)
    begins = np.cumsum(lengths) - lengths
    line = samples.owners[nearest]
    label, part = line % count, line // count  # part 0: the label, 1: before it, 2: behind it
    shift = np.where(part == 1, -lengths[line], np.where(part == 2, lengths[label], 0))
    at = nearest - begins[line] + shift
    directions = np.where(found[:, None], samples.directions[nearest], 0.0)
    return Places(np.where(found, label, -1), np.where(found, at, 0), found & (part > 0), directions)


def _continued(lines: Polylines, stride: int) -> list[Float[np.ndarray, "p 2"]]:
    """Gives a straight piece that leads to the start of each line, then one that leads on from each end.

    Where a line has no length, they have none.
    """
    before: list[Float[np.ndarray, "p 2"]] = []
    behind: list[Float[np.ndarray, "p 2"]] = []
    for vertices in lines:
        for pieces, way in ((before, vertices[::-1]), (behind, vertices)):
            if len(way) == 0:
                pieces.append(way)
                continue
            back = resample(way[::-1], float(stride))[: _LOOK_BACK + 1][-1]
            out = way[-1] - back
            length = float(np.hypot(out[0], out[1])) or 1.0
            ends = np.stack([way[-1], way[-1] + out * (_CONTINUED_CELLS * stride / length)])
            pieces.append(ends[::-1] if pieces is before else ends)
    return before + behind


def nearest_line(segments: Segments, lines: Lines, case: Case, radius: float) -> Int[np.ndarray, " n"]:
    """Gives the index of the line that the midpoint of each segment is nearest to, -1 where none is near.

    Args:
        segments: Segments.
        lines: Labels, or true segments.
        case: The image.
        radius: Largest distance in pixels; directions may differ by 45 degrees.
    """
    samples = sample_lines(lines, case.grid.size)
    queries = midpoint_samples(segments)
    nearest, _ = nearest_samples(queries, samples, radius, ANGLE_RADIUS, directed=case.directed)
    return np.where(nearest < 0, -1, np.append(samples.owners, -1)[nearest])


def best_candidates(chords: Segments, candidates: Segments, case: Case) -> Int[np.ndarray, " n"]:
    """Gives the candidate that fits each true segment best, -1 where none fits.

    The best has the least mean squared distance of its end points from those of the true segment. It fits if
    the root of that is within the radius, and the directions differ by at most 45 degrees.

    Args:
        chords: True segments.
        candidates: Segments of the network.
        case: The image.
    """
    from scipy.spatial import cKDTree

    if len(candidates) == 0 or len(chords) == 0:
        return np.full(len(chords), -1)
    tree = cKDTree(candidates.endpoints.reshape(-1, 4))
    ways = [chords.endpoints] if case.directed else [chords.endpoints, chords.endpoints[:, ::-1]]
    found = [tree.query(points.reshape(-1, 4)) for points in ways]
    distances = np.stack([each[0] for each in found]) / np.sqrt(2.0)
    way = distances.argmin(axis=0)
    best = np.stack([each[1] for each in found])[way, np.arange(len(chords))]
    wanted, given = midpoint_samples(chords).directions, midpoint_samples(candidates).directions[best]
    cosines = (wanted * given).sum(axis=1)
    alike = (cosines if case.directed else np.abs(cosines)) >= np.cos(ANGLE_RADIUS)
    return np.where(alike & (distances.min(axis=0) <= case.radius), best, -1)


def covered_share(
    lines: Polylines, others: Lines, case: Case, radius: float | None = None
) -> Float[np.ndarray, " n"]:
    """Gives the part of each polyline, by length, that lies within the radius of others; 0 if it has none.

    Args:
        lines: Polylines.
        others: What they are compared with.
        case: The image.
        radius: In pixels; that of the point metric by default.
    """
    samples = sample_lines(lines, case.grid.size)
    reach = case.radius if radius is None else radius
    targets = sample_lines(others, case.grid.size)
    nearest, _ = nearest_samples(samples, targets, reach, ANGLE_RADIUS, directed=case.directed)
    near: Bool[np.ndarray, " s"] = nearest >= 0
    counts = np.bincount(samples.owners, minlength=len(lines))
    hits = np.bincount(samples.owners[near], minlength=len(lines))
    return np.asarray(hits / np.maximum(counts, 1))


__all__ = [
    "Places",
    "best_candidates",
    "covered_share",
    "midpoint_samples",
    "nearest_line",
    "places_along",
]
