"""Section `linking`: linking and spline beside a linker in plain Python, and the length that is recovered."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from yolino.benchmark.baselines.loop_linker import link_in_loops
from yolino.benchmark.clock import race
from yolino.benchmark.measure import Measure, Section, Target, at_least, at_most, milliseconds, percent, ratio
from yolino.benchmark.scenes import SIZE, STRIDE, converging_lanes, noisy_candidates, true_segments
from yolino.benchmark.setup import Setup
from yolino.geometry import clip_polylines, distance_to_segments, sample_segments
from yolino.postprocess import LINKERS
from yolino.postprocess.nms import NMS
from yolino.types import Floats, Polylines, Segments

_CANDIDATES = 500
_SCENES = 50
_TOLERANCE_CELLS = 0.25
_FRONT_VIEW = "chain"  # the linker of the packaged model, for which the targets are
ABOUT = (
    f"Linking and spline of what the NMS leaves of {_CANDIDATES} candidates. The other linker is plain "
    "Python: for each segment a loop over all others for the nearest start ahead, chains, scipy's "
    "smoothing spline. Recovered length: the segments of 3 to 6 lanes that meet in one point, cut at "
    f"{STRIDE} px without error, are linked again ({_SCENES} scenes); a piece of a lane is recovered if it "
    "lies within a quarter of a cell of a polyline that belongs to that lane (the lane nearest to it on "
    "average)."
)


def measure(setup: Setup) -> Section:
    """Times all linkers on one frame, and measures what they recover of perfect segments."""
    segments = NMS(float(STRIDE))(noisy_candidates(setup.rng, 60 if setup.quick else _CANDIDATES))
    linkers: dict[str, Callable[[Segments], Polylines]] = {
        name: linker(float(STRIDE)) for name, linker in LINKERS.items()
    }
    linkers["loops"] = lambda found: link_in_loops(found, float(STRIDE))
    times = race({name: _bind(linker, segments) for name, linker in linkers.items()}, **setup.pace)
    measures: dict[str, Measure] = {}
    for name in linkers:
        title = "plain Python" if name == "loops" else f"linker {name}"
        measures[name] = milliseconds(
            f"{title}: linking and spline of {len(segments)} segments",
            times[name],
            _target(name, at_most(0.6)),
        )
    for name in LINKERS:
        measures[f"speedup_{name}"] = ratio(
            f"linker {name} is faster than plain Python", times["loops"], times[name]
        )
    for name, shares in _recovery(setup, linkers).items():
        title = "plain Python" if name == "loops" else f"linker {name}"
        measures[f"recovered_{name}"] = percent(
            f"{title}: recovered length of perfect converging segments",
            [float(shares.mean())],
            _target(name, at_least(97)),
            note=f"mean; worst scene {100 * shares.min():.1f} %",
        )
    return Section("Linking and spline", ABOUT, measures)


def _target(name: str, target: Target) -> Target | None:
    """Gives the target, for the linker of the packaged model."""
    return target if name == _FRONT_VIEW else None


def _bind(linker: Callable[[Segments], Polylines], segments: Segments) -> Callable[[], Polylines]:
    return lambda: linker(segments)


def _recovery(setup: Setup, linkers: dict[str, Callable[[Segments], Polylines]]) -> dict[str, Floats]:
    """Gives for each linker the recovered share of the length in each scene."""
    rng, shares = setup.rng, {name: list[float]() for name in linkers}
    for number in range(2 if setup.quick else _SCENES):
        lanes = converging_lanes(rng, SIZE, 3 + number % 4)
        segments = true_segments(lanes, SIZE, STRIDE)
        order = rng.permutation(len(segments))
        for name, linker in linkers.items():
            shares[name].append(recovered(lanes, linker(segments[order]), SIZE))
    return {name: np.array(values) for name, values in shares.items()}


def recovered(lanes: Polylines, found: Polylines, size: tuple[int, int]) -> float:
    """Gives the share of the lanes' length, inside the image, that was found.

    Args:
        lanes: The truth in pixels.
        found: What a linker made of its segments.
        size: `(height, width)` of the image in pixels.
    """
    truth = clip_polylines(lanes, size)
    owners = _owners(truth, found)
    within = whole = 0.0
    for index, lane in enumerate(truth):
        points, weights = sample_segments(np.stack([lane[:-1], lane[1:]], axis=1), 1.0)
        near = distance_to_segments(points, found[owners == index].endpoints) <= _TOLERANCE_CELLS * STRIDE
        within += float(weights[near].sum())
        whole += float(weights.sum())
    return within / whole


def _owners(truth: Polylines, found: Polylines) -> np.ndarray:
    """Gives for each polyline the lane that is nearest to it on average, -1 for one without length."""
    owners = np.full(len(found), -1)
    for index, line in enumerate(found):
        points, _ = sample_segments(np.stack([line[:-1], line[1:]], axis=1), 1.0)
        if len(points):
            means = [distance_to_segments(points, lane.endpoints).mean() for lane in _each(truth)]
            owners[index] = int(np.argmin(means))
    return owners


def _each(lines: Polylines) -> list[Polylines]:
    return [lines[i : i + 1] for i in range(len(lines))]


__all__ = ["measure", "recovered"]
