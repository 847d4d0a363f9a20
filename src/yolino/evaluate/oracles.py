"""Oracles: a step of the pipeline replaced by the truth, to see what that step costs.

Each oracle gives what the model would have found with one step, or several, done perfectly. It is a plain
function of a `Case`; `ORACLES` names them in the order of the pipeline, `LADDER` puts some of them in a row
from the model up to the labels, each repairing one thing more.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from yolino.evaluate.oracles_case import Case
from yolino.evaluate.oracles_nearest import best_candidates, covered_share, nearest_line, places_along
from yolino.postprocess.mapping import map_polylines, map_segments
from yolino.types import Polylines, Segments

REACH_RADII = 3.0
"""How many radii from a label a segment may lie and still be a misplaced one of it, not a false one."""
_BESIDE, _BEYOND, _FALSE = 0, 1, 2  # what a candidate can be
_SAME_LINE = 0.5  # of its length that must lie within the radius
_SIDE_BY_SIDE = 0.5  # cells: segments of a line that are nearer along it are one place


class Found(NamedTuple):
    """What an oracle gives, in pixels of the image.

    Attributes:
        segments: What the NMS leaves.
        polylines: The lines.
    """

    segments: Segments
    polylines: Polylines


class Oracle(NamedTuple):
    """One row of a diagnosis.

    Attributes:
        title: What people read.
        apply: What it does.
    """

    title: str
    apply: Callable[[Case], Found]


class Step(NamedTuple):
    """One step of the ladder: what `above` has repaired that `below` has not.

    Attributes:
        stage: What is repaired.
        below: Name of the oracle without.
        above: Name of the oracle with.
    """

    stage: str
    below: str
    above: str


def model(case: Case) -> Found:
    """Replaces nothing."""
    return _in_image(case, case.stages.segments, case.stages.polylines)


def no_false_lines(case: Case) -> Found:
    """Drops the lines that are none: less than half of their length lies within the radius of a label."""
    lines = case.stages.polylines
    return _in_image(case, case.stages.segments, lines[covered_share(lines, case.truth, case) >= _SAME_LINE])


def no_missed_lines(case: Case) -> Found:
    """Adds the labels of which less than half lies within the radius of a line; false lines stay."""
    lines = case.stages.polylines
    missed = covered_share(case.truth, lines, case) < _SAME_LINE
    return _in_image(case, case.stages.segments, _joined(lines, case.truth[missed]))


def perfect_linking(case: Case) -> Found:
    """Replaces the linker for the segments near a label: each belongs to its nearest, in the order along it.

    Segments behind the end of a label, where it would go on, belong to it, too: that it goes on too far is
    not the linker's mistake. The other segments are false and go to the model's linker.
    """
    lines, rest = _link_along(case.stages.segments, case, beyond=True)
    return _in_image(case, case.stages.segments, _joined(lines, case.linker(case.stages.segments[rest])))


def perfect_linking_only(case: Case) -> Found:
    """Does what `perfect_linking` does, and drops the false segments, also those behind the ends."""
    lines, rest = _link_along(case.stages.segments, case, beyond=False)
    return _in_image(case, case.stages.segments[~rest], lines)


def no_false_candidates(case: Case) -> Found:
    """Drops the network's segments that lie on no label; the model's NMS and linker do the rest."""
    candidates = case.stages.candidates
    places = places_along(candidates, case, case.radius)
    return _after_network(case, candidates[(places.owners >= 0) & ~places.beyond])


def perfect_confidence(case: Case) -> Found:
    """Replaces the scores: of all segments of the network, the best one for each true segment has 1.

    All others are gone, whatever their score. Where a true segment has none that fits, it is missed.
    """
    every = _stacked([case.stages.candidates, case.unsure])
    best = best_candidates(case.chords, every, case)
    chosen = every[np.unique(best[best >= 0])]
    return _after_network(case, Segments(chosen.endpoints, labels=chosen.labels))


def perfect_places(case: Case) -> Found:
    """Replaces the places: each of the network's segments beside a label becomes a true segment of it.

    Beside is within three times the radius of the point metric. It keeps its score. Those behind the ends of
    labels, and those that are false, stay as they are.
    """
    moved, kinds = _moved(case)
    return _after_network(case, _stacked([moved, case.stages.candidates[kinds != _BESIDE]]))


def perfect_ends(case: Case) -> Found:
    """Does what `perfect_places` does, and drops the segments behind the ends of labels."""
    moved, kinds = _moved(case)
    return _after_network(case, _stacked([moved, case.stages.candidates[kinds == _FALSE]]))


def perfect_candidates(case: Case) -> Found:
    """Does what `perfect_ends` does, and drops the false segments, too."""
    return _after_network(case, _moved(case)[0])


def perfect_threshold(case: Case) -> Found:
    """Adds to `perfect_candidates` the true segments that the network saw with too low a score."""
    moved, _ = _moved(case)
    best = best_candidates(case.chords, case.unsure, case)
    return _after_network(case, _stacked([moved, _plain(case.chords[best >= 0])]))


def true_segments(case: Case) -> Found:
    """Replaces the network: all true segments, with score 1, through the model's NMS and linker."""
    return _after_network(case, _plain(case.chords))


def true_segments_linked(case: Case) -> Found:
    """Replaces the network, the NMS and the linker: the true segments of each label in their order."""
    lines = [
        _curve(case.chords.endpoints[case.owners == owner], case)
        for owner in range(len(case.truth))
        if (case.owners == owner).any()
    ]
    labels = [case.truth.labels[o] for o in range(len(case.truth)) if (case.owners == o).any()]
    return _in_image(case, _plain(case.chords), Polylines.from_list(lines, labels=labels))


def labels(case: Case) -> Found:
    """Replaces everything: the labels themselves. What is missing to 1 is lost in the metric."""
    return Found(map_segments(_plain(case.chords), case.matrix), case.labels)


ORACLES: dict[str, Oracle] = {
    "model": Oracle("the model", model),
    "no_false_lines": Oracle("no false lines", no_false_lines),
    "no_missed_lines": Oracle("no missed lines", no_missed_lines),
    "perfect_linking": Oracle("perfect linking", perfect_linking),
    "perfect_linking_only": Oracle("... and no false segments", perfect_linking_only),
    "no_false_candidates": Oracle("no false candidates", no_false_candidates),
    "perfect_confidence": Oracle("perfect confidence", perfect_confidence),
    "perfect_places": Oracle("perfect places", perfect_places),
    "perfect_ends": Oracle("... and ends", perfect_ends),
    "perfect_candidates": Oracle("... and no false ones", perfect_candidates),
    "perfect_threshold": Oracle("... and threshold", perfect_threshold),
    "true_segments": Oracle("true segments", true_segments),
    "true_segments_linked": Oracle("... perfectly linked", true_segments_linked),
    "labels": Oracle("the labels", labels),
}
"""What can be replaced, in the order of the rows of a diagnosis."""

LADDER = (
    Step("misplaced segments", "model", "perfect_places"),
    Step("lines that go on too far", "perfect_places", "perfect_ends"),
    Step("false segments", "perfect_ends", "perfect_candidates"),
    Step("scores below the threshold", "perfect_candidates", "perfect_threshold"),
    Step("unseen segments", "perfect_threshold", "true_segments"),
    Step("NMS and linking", "true_segments", "true_segments_linked"),
    Step("grid and curves", "true_segments_linked", "labels"),
)
"""From the model to the labels: each step repairs one thing more, so the losses add up."""


def _in_image(case: Case, segments: Segments, polylines: Polylines) -> Found:
    return Found(map_segments(segments, case.matrix), map_polylines(polylines, case.matrix))


def _after_network(case: Case, candidates: Segments) -> Found:
    """Gives what the model's NMS and linker make of segments."""
    merged = case.nms(_plain(candidates))
    return _in_image(case, merged, case.linker(merged))


def _moved(case: Case) -> tuple[Segments, Int[np.ndarray, " n"]]:
    """Gives the true segments that candidates lie beside, with their scores, and each candidate's kind."""
    candidates, reach = case.stages.candidates, REACH_RADII * case.radius
    places = places_along(candidates, case, reach)
    chords = nearest_line(candidates, case.chords, case, 2 * reach)
    beside = (places.owners >= 0) & ~places.beyond & (chords >= 0)
    kinds = np.where(beside, _BESIDE, np.where(places.beyond, _BEYOND, _FALSE))
    true = case.chords[chords[beside]]
    return Segments(true.endpoints, candidates.scores[beside], true.labels), kinds


def _link_along(segments: Segments, case: Case, *, beyond: bool) -> tuple[Polylines, Bool[np.ndarray, " n"]]:
    """Gives a line for each label that has segments, and which segments belong to none."""
    places = places_along(segments, case, case.radius)
    rest = (places.owners < 0) | (places.beyond & (not beyond))
    lines, scores, kinds = [], [], []
    for owner in np.unique(places.owners[~rest]):
        mine = np.flatnonzero((places.owners == owner) & ~rest)
        mine = mine[_one_each(places.at[mine], segments.scores[mine], _SIDE_BY_SIDE * case.grid.stride)]
        lines.append(_curve(_along(segments.endpoints[mine], places.directions[mine]), case))
        scores.append(segments.scores[mine].mean())
        kinds.append(case.truth.labels[owner])
    return Polylines.from_list(lines, scores, kinds), rest


def _one_each(
    at: Int[np.ndarray, " n"], scores: Float[np.ndarray, " n"], apart: float
) -> Int[np.ndarray, " m"]:
    """Gives the segments in the order along their line, of those side by side the one with the best score."""
    kept: list[int] = []
    for i in np.argsort(-scores, kind="stable"):
        if all(abs(int(at[i]) - int(at[k])) >= apart for k in kept):
            kept.append(int(i))
    chosen = np.array(kept, np.int64)
    return np.asarray(chosen[np.argsort(at[chosen], kind="stable")])


def _along(
    endpoints: Float[np.ndarray, "n 2 2"], directions: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, "n 2 2"]:
    """Gives the segments, each turned so that it points along its direction."""
    against = ((endpoints[:, 1] - endpoints[:, 0]) * directions).sum(axis=1) < 0
    return np.where(against[:, None, None], endpoints[:, ::-1], endpoints)


def _curve(endpoints: Float[np.ndarray, "n 2 2"], case: Case) -> Float[np.ndarray, "v 2"]:
    """Gives the curve through the midpoints and the outer end points, as the model's linker draws it."""
    every = [endpoints[:1, 0], endpoints.mean(axis=1), endpoints[-1:, 1]]
    points: Float[np.ndarray, "v 2"] = np.concatenate(every)
    points = points[np.append(True, (np.diff(points, axis=0) != 0).any(axis=1))]
    if len(points) < 2:
        return points
    return np.asarray(case.smooth(points / case.grid.stride) * case.grid.stride)


def _plain(segments: Segments) -> Segments:
    """Gives the segments without class probabilities, which true segments do not have."""
    return Segments(segments.endpoints, segments.scores, segments.labels)


def _stacked(parts: list[Segments]) -> Segments:
    return Segments(
        np.concatenate([part.endpoints for part in parts]),
        np.concatenate([part.scores for part in parts]),
        np.concatenate([part.labels for part in parts]),
    )


def _joined(first: Polylines, second: Polylines) -> Polylines:
    return Polylines.from_list(
        [*first, *second],
        np.concatenate([first.scores, second.scores]),
        np.concatenate([first.labels, second.labels]),
    )


__all__ = ["LADDER", "ORACLES", "REACH_RADII", "Found", "Oracle", "Step"]
