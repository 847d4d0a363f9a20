"""What is wrong with polylines, each for itself and beside the others of its image."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import count
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from yolino.datasets.batch import Batch
from yolino.datasets.crossings import overlap_themselves
from yolino.datasets.report import Finding
from yolino.geometry import clip_polylines, cumulative_length, distance_to_segments, resample
from yolino.types import Polylines

NEAR = 1.0
"""Polylines that are everywhere nearer than this, in pixels, are nearly the same."""
# Shorter ones, in pixels, are near to whatever lies beside them.
_SHORT = 4.0
# Of points along them that are compared: distance in pixels, and how many at most.
_SPACING, _MOST = 1.0, 10_000

Line = Float[np.ndarray, "_ 2"]


def polyline_findings(batch: Batch, classes: int, *, directed: bool) -> Iterator[tuple[int, Finding]]:
    """Yields what is wrong with polylines and the index of their sample, in the order of the polylines.

    Args:
        batch: The samples.
        classes: Number of classes.
        directed: Whether a polyline that runs against another is different from it.
    """
    marks = _mark(batch, classes, directed)
    first = np.searchsorted(batch.samples, np.arange(len(batch.names)))
    for i in np.flatnonzero(marks.odd).tolist():
        sample = int(batch.samples[i])
        for kind, detail in _describe(batch, marks, i, int(first[sample])):
            yield sample, Finding(kind, batch.names[sample], f"polyline {i - first[sample]}{detail}")


class _Marks(NamedTuple):
    """What is known of each polyline: a mark, a number, or which polyline it is again."""

    finite: Bool[np.ndarray, " n"]
    unknown: Bool[np.ndarray, " n"]
    overlaps: Bool[np.ndarray, " n"]
    repeats: Int[np.ndarray, " n"]
    beyond: Int[np.ndarray, " n"]
    twins: Mapping[int, tuple[int, str, str]]
    odd: Bool[np.ndarray, " n"]
    classes: int


def _mark(batch: Batch, classes: int, directed: bool) -> _Marks:
    lines, finite = batch.lines, batch.finite
    unknown = (lines.labels < 0) | (lines.labels >= max(classes, 1))
    overlaps = np.zeros(len(lines), np.bool_)
    overlaps[finite] = overlap_themselves(lines[finite])
    pieces = lines.endpoints
    repeated = (pieces[:, 0] == pieces[:, 1]).all(axis=1)
    repeats = np.bincount(lines.owners[repeated], minlength=len(lines))
    outside = (lines.vertices < 0) | (lines.vertices > batch.limits[batch.owners])
    beyond = np.where(finite, batch.count(outside.any(axis=1)), 0)
    twins = dict(_twins(batch, directed))
    odd = unknown | overlaps | ~finite | (repeats > 0) | (beyond > 0) | (np.diff(lines.offsets) < 2)
    odd[list(twins)] = True
    return _Marks(finite, unknown, overlaps, repeats, beyond, twins, odd, classes)


def _describe(batch: Batch, marks: _Marks, i: int, first: int) -> Iterator[tuple[str, str]]:
    """Yields kind and detail of what is wrong with one polyline; `first` is the first one of its sample."""
    line = batch.lines.vertices[batch.lines.offsets[i] : batch.lines.offsets[i + 1]]
    if marks.unknown[i]:
        yield "unknown label", f" has label {batch.lines.labels[i]} of {marks.classes} classes"
    if len(line) < 2:
        yield "one vertex", f" has {len(line)}"
    if not marks.finite[i]:
        yield "not finite", ""
    elif marks.repeats[i] and marks.repeats[i] == len(line) - 1:
        yield "zero length", f" at {line[0].tolist()}"
    elif marks.repeats[i]:
        yield "repeated vertex", f": {marks.repeats[i]} of {len(line)} vertices repeat the one before"
    if i in marks.twins:
        other, kind, how = marks.twins[i]
        of_class = "" if batch.lines.labels[i] == batch.lines.labels[other] else ", of another class"
        yield kind, f" {how} polyline {other - first}{of_class}"
    if marks.overlaps[i]:
        yield "self-overlap", ""
    size = batch.sizes[batch.samples[i]]
    if marks.beyond[i] and size is not None:
        all_beyond = marks.beyond[i] == len(line)
        if all_beyond and len(clip_polylines(Polylines.from_list([line]), size)) == 0:
            yield "outside", ""
        else:
            yield "partly outside", f": {marks.beyond[i]} of {len(line)} vertices"


def _twins(batch: Batch, directed: bool) -> Iterator[tuple[int, tuple[int, str, str]]]:
    """Yields each polyline that is an earlier one of its image again: that one, the kind, and how."""
    seen: set[int] = set()
    for later, earlier in _alike(batch).tolist():
        if later in seen:
            continue
        a, b = (
            batch.lines.vertices[batch.lines.offsets[i] : batch.lines.offsets[i + 1]]
            for i in (later, earlier)
        )
        same_way = _run_alike(a, b)
        if np.array_equal(a, b):
            found = earlier, "duplicate polyline", "is"
        elif (same_way or not directed) and _are_near(a, b):
            found = earlier, "near duplicate", "follows" if same_way else "runs against"
        else:
            continue
        seen.add(later)
        yield later, found


def _alike(batch: Batch) -> Int[np.ndarray, "p 2"]:
    """Gives the pairs of polylines of an image whose bounding boxes are near: the later and the earlier."""
    offsets = batch.lines.offsets
    usable = np.flatnonzero(batch.finite & (np.diff(offsets) > 0))
    if len(usable) == 0:
        return np.zeros((0, 2), np.int64)
    lines, samples = batch.lines[usable], batch.samples[usable]
    low, high = (
        reduce.reduceat(lines.vertices, lines.offsets[:-1], axis=0) for reduce in (np.minimum, np.maximum)
    )
    boxes = np.concatenate([low, high], axis=1)
    order = np.lexsort((boxes[:, 0], samples))
    pairs = []
    for shift in count(1):
        a, b = order[:-shift], order[shift:]
        together = (samples[a] == samples[b]) & (boxes[b, 0] - boxes[a, 0] <= NEAR)
        if not together.any():
            break
        near = together & (np.abs(boxes[a] - boxes[b]) <= NEAR).all(axis=1)
        pairs.append(np.sort(usable[np.stack([a[near], b[near]], axis=1)], axis=1)[:, ::-1])
    return np.unique(np.concatenate(pairs), axis=0) if pairs else np.zeros((0, 2), np.int64)


def _run_alike(a: Line, b: Line) -> bool:
    """Tells whether `a` is nearer to `b` than to `b` turned around."""
    quarters_a, quarters_b = (_spread(line, 4) for line in (a, b))
    return bool(np.abs(quarters_a - quarters_b).sum() <= np.abs(quarters_a - quarters_b[::-1]).sum())


def _spread(line: Line, parts: int) -> Line:
    """Gives the ends of equally long parts of a polyline."""
    at = cumulative_length(line)
    places = np.linspace(0.0, at[-1], parts + 1)
    return np.stack([np.interp(places, at, line[:, axis]) for axis in (0, 1)], axis=1)


def _are_near(a: Line, b: Line) -> bool:
    """Tells whether every point of each is near to the other."""
    lengths = [float(cumulative_length(line)[-1]) for line in (a, b)]
    if min(lengths) < _SHORT:
        return False
    spacing = max(_SPACING, max(lengths) / _MOST)
    return all(
        bool((distance_to_segments(resample(one, spacing), _pieces(other)) < NEAR).all())
        for one, other in ((a, b), (b, a))
    )


def _pieces(line: Line) -> Float[np.ndarray, "_ 2 2"]:
    return np.stack([line[:-1], line[1:]], axis=1)


__all__ = ["NEAR", "polyline_findings"]
