"""Section `stages`: where the time of one frame goes."""

from __future__ import annotations

import numpy as np

from yolino.benchmark.clock import Times, race
from yolino.benchmark.frames import CANDIDATES, STEPS, ClockedFrame, bare_network, made_up_output
from yolino.benchmark.measure import Measure, Section, at_most, milliseconds, percent
from yolino.benchmark.setup import Setup

_POSTPROCESSING = ("threshold", "nms", "linking", "mapping")
ABOUT = (
    "Each frame is an RGB array in, polylines out, through the same `Predictor` that users call, with a "
    "clock between its steps. The bare network runs on the prepared input in the same rounds. The second "
    f"block hands {CANDIDATES} made-up candidates around lanes to the post-processing, after the network "
    "has run."
)


def measure(setup: Setup) -> Section:
    """Times the steps of the frame as the model sees it, and of one full of candidates."""
    predictor, image = setup.predictor, setup.frame
    frames = {
        "image": ClockedFrame(predictor, image),
        "candidates": ClockedFrame(predictor, image, made_up_output(predictor, setup.rng)),
    }
    bare = bare_network(predictor, image)
    times = race({**frames, "network": bare}, **setup.pace, calls=1)
    found = predictor.stages(image)
    titles = {
        "image": f"this image, {len(found.candidates)} candidates",
        "candidates": f"{CANDIDATES} candidates",
    }
    measures = {"network": milliseconds("bare network", times["network"])}
    for name, frame in frames.items():
        rows = np.array(frame.rows[-len(times[name].seconds) :])
        for step, measured in _steps(rows, times[name], times["network"]).items():
            measures[f"{name}_{step}"] = _titled(measured, titles[name])
    height, width = image.shape[:2]
    return Section(f"One frame of {height}x{width}, step by step", ABOUT, measures)


def _steps(rows: np.ndarray, total: Times, network: Times) -> dict[str, Measure]:
    """Gives the measures of one kind of frame from the seconds of its steps."""
    measures = {
        name: milliseconds(title, Times(rows[:, column]))
        for column, (name, title) in enumerate(STEPS.items())
    }
    after = rows[:, [list(STEPS).index(name) for name in _POSTPROCESSING]].sum(axis=1)
    inside = rows[:, list(STEPS).index("network")]
    low, middle, high = (float(q) for q in np.quantile(1 / total.seconds, (0.25, 0.5, 0.75)))
    return measures | {
        "total": milliseconds("end to end", total),
        "fps": Measure("frames per second", middle, "fps", low, high),
        "around": percent(
            "everything around the network, of the bare network's time",
            total.seconds / network.seconds - 1,
            at_most(12),
        ),
        "other_steps": percent(
            "the other steps, of the network's time within the frame", rows.sum(axis=1) / inside - 1
        ),
        "postprocessing": percent("post-processing, of the frame", after / rows.sum(axis=1), at_most(5)),
    }


def _titled(measure: Measure, prefix: str) -> Measure:
    return Measure(**{**vars(measure), "title": f"{prefix}: {measure.title}"})


__all__ = ["measure"]
