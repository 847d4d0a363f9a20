"""Identities of polylines from frame to frame, and lines that do not tremble."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import linear_sum_assignment

from yolino.inference.tracking_distance import compare_polylines
from yolino.inference.tracking_smoothing import offsets_to
from yolino.types import Polylines


class Tracked(NamedTuple):
    """The polylines of a frame with their identities, sorted by these.

    Attributes:
        polylines: In pixels of the frame.
        ids: Identity of each polyline, from 1 on: the same number is the same line.
        seen: Whether the line was found in this frame; else it is where it is expected.
    """

    polylines: Polylines
    ids: Int[np.ndarray, " n"]
    seen: Bool[np.ndarray, " n"]


@dataclass(eq=False)
class _Track:
    """A line that is followed.

    Attributes:
        vertices: Where it is, or is expected in the next frame; in pixels.
        velocity: Sideways motion in pixels per frame.
        found: The polyline as it was found last.
        votes: How much speaks for each label.
        number: Its identity; 0 until it was found often enough.
    """

    vertices: Float[np.ndarray, "v 2"]
    found: Float[np.ndarray, "w 2"]
    score: float
    found_score: float
    found_label: int
    velocity: Float[np.ndarray, "xy=2"] = field(default_factory=lambda: np.zeros(2))
    votes: dict[int, float] = field(default_factory=dict)
    hits: int = 1
    misses: int = 0
    number: int = 0

    @property
    def label(self) -> int:
        """The label with the most votes, the smaller one of equals."""
        return max(self.votes, key=lambda label: (self.votes[label], -label))


class Tracker:
    """Gives the polylines of one frame after another their identities.

    Each known line is expected where its sideways motion takes it. Which polyline of the frame is which known
    line is one choice over all pairs, with the smallest sum of costs: the distance (`compare_polylines`), up
    to doubled where directions differ, and `reach` for a line that stays alone. Place and motion are filtered
    by the alpha-beta filter; its gain for the motion is that of Benedict and Bordner (1962),
    `alpha^2 / (2 - alpha)`.

    Args:
        smooth: Whether lines are steadied: places and scores are averaged over time, labels are voted on, and
            lines that are missed for a short while are shown where they are expected. Else the polylines stay
            as they were found.
        reach: How far a line can be from where it is expected, as a share of the image's width.
        births: In how many frames in a row a line must be found to be one; those of the first frame are at
            once.
        deaths: In how many frames in a row a line may be missed before it is forgotten.
        weight: Share of the frame in the average over time, 0 to 1 (the filter's alpha).
        label_cost: What another label adds to a distance, as a share of `reach`.
        directed: False takes a line and its reverse for the same.

    Raises:
        ValueError: If an argument is out of range.
    """

    def __init__(
        self,
        *,
        smooth: bool = False,
        reach: float = 0.05,
        births: int = 1,
        deaths: int = 5,
        weight: float = 0.5,
        label_cost: float = 0.5,
        directed: bool = True,
    ) -> None:
        if not (reach > 0 and births >= 1 and deaths >= 0 and 0 < weight <= 1 and label_cost >= 0):
            raise ValueError(
                "A tracker needs reach > 0, births >= 1, deaths >= 0, 0 < weight <= 1 and label_cost >= 0, "
                f"got {reach}, {births}, {deaths}, {weight} and {label_cost}."
            )
        self.smooth, self.reach, self.births, self.deaths = smooth, float(reach), births, deaths
        self.weight, self.label_cost, self.directed = float(weight), float(label_cost), directed
        self._tracks: list[_Track] = []
        self._first = True
        self.born = 0

    @property
    def alive(self) -> int:
        """How many lines are followed, with those that are not shown yet."""
        return len(self._tracks)

    def __call__(self, polylines: Polylines, size: tuple[int, int]) -> Tracked:
        """Gives the polylines of the next frame with their identities.

        The order of the polylines does not matter. Those without length are left out.

        Args:
            polylines: What was found, in pixels of the frame.
            size: `(height, width)` of the frame.
        """
        polylines = _sorted(polylines[polylines.lengths > 0])
        for track in self._tracks:
            track.vertices = track.vertices + track.velocity
        pairs = self._match(polylines, size[1])
        lines = list(polylines)
        for row, column, turned in pairs:
            self._tracks[row].found = lines[column]
            line = lines[column][::-1] if turned else lines[column]
            self._update(self._tracks[row], line, polylines, column)
        self._miss({row for row, _, _ in pairs})
        for column in sorted(set(range(len(lines))) - {column for _, column, _ in pairs}):
            self._tracks.append(self._begin(lines[column], polylines, column))
        self._baptize()
        self._first = False
        return self._shown()

    def _match(self, polylines: Polylines, width: int) -> list[tuple[int, int, bool]]:
        """Gives the pairs of track and polyline, and whether the polyline runs the opposite way."""
        reach = self.reach * width
        known = Polylines.from_list([track.vertices for track in self._tracks])
        distances, agreements = compare_polylines(known, polylines, reach)
        labels = np.array([track.label for track in self._tracks], np.int64)
        same_way = agreements if self.directed else np.abs(agreements)
        costs = distances * (2 - same_way)
        costs += self.label_cost * reach * (labels[:, None] != polylines.labels)
        costs = np.where(same_way > 0, np.minimum(costs, reach), reach)
        rows, columns = linear_sum_assignment(costs)
        return [
            (int(i), int(j), bool(agreements[i, j] < 0))
            for i, j in zip(rows, columns, strict=True)
            if costs[i, j] < reach
        ]

    def _begin(self, line: Float[np.ndarray, "v 2"], polylines: Polylines, index: int) -> _Track:
        score, label = float(polylines.scores[index]), int(polylines.labels[index])
        hits = self.births if self._first else 1
        return _Track(line, line, score, score, label, votes={label: self.weight * score}, hits=hits)

    def _update(
        self, track: _Track, line: Float[np.ndarray, "v 2"], polylines: Polylines, index: int
    ) -> None:
        """Moves a track towards the polyline that was found."""
        alpha = self.weight
        offsets = offsets_to(line, track.vertices)
        track.vertices = line + (1 - alpha) * offsets.vertices
        track.velocity = track.velocity - alpha**2 / (2 - alpha) * offsets.mean
        track.found_score, track.found_label = float(polylines.scores[index]), int(polylines.labels[index])
        track.score += alpha * (track.found_score - track.score)
        track.votes = {label: (1 - alpha) * votes for label, votes in track.votes.items()}
        track.votes[track.found_label] = track.votes.get(track.found_label, 0.0) + alpha * track.found_score
        track.hits, track.misses = track.hits + 1, 0

    def _miss(self, matched: set[int]) -> None:
        """Counts the misses of the tracks that were not found, and forgets those with too many."""
        kept = []
        for row, track in enumerate(self._tracks):
            if row not in matched:
                track.misses += 1
                track.score *= 1 - self.weight
                if track.number == 0 or track.misses > self.deaths:
                    continue
            kept.append(track)
        self._tracks = kept

    def _baptize(self) -> None:
        for track in self._tracks:
            if track.number == 0 and track.hits >= self.births:
                self.born += 1
                track.number = self.born

    def _shown(self) -> Tracked:
        tracks = [t for t in self._tracks if t.number and (self.smooth or t.misses == 0)]
        tracks.sort(key=lambda track: track.number)
        if self.smooth:
            items = [(track.vertices, track.score, track.label) for track in tracks]
        else:
            items = [(track.found, track.found_score, track.found_label) for track in tracks]
        polylines = Polylines.from_list(
            [line for line, _, _ in items], [score for _, score, _ in items], [label for *_, label in items]
        )
        ids = np.array([track.number for track in tracks], np.int64)
        return Tracked(polylines, ids, np.array([track.misses == 0 for track in tracks], np.bool_))


def warm_up() -> None:
    """Runs every step once, so that the first frames take no longer than the others."""
    tracker, line = Tracker(), Polylines.from_list([[(0, 0), (9, 9)]])
    for _ in range(2):
        tracker(line, (10, 10))


def _sorted(polylines: Polylines) -> Polylines:
    """Gives the polylines in an order that depends on nothing but themselves."""
    keys = [
        (*line[0], *line[-1], len(line), score, label)
        for line, score, label in zip(polylines, polylines.scores, polylines.labels, strict=True)
    ]
    return polylines[np.array(sorted(range(len(keys)), key=keys.__getitem__), np.int64)]


__all__ = ["Tracked", "Tracker", "warm_up"]
