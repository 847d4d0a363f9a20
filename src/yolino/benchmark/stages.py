"""Section `stages`: where the time of one frame goes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from yolino.benchmark.clock import Times, race
from yolino.benchmark.frames import CANDIDATES, ROW, STEPS, ClockedFrame, bare_network, made_up_output
from yolino.benchmark.measure import Measure, Section, at_most, milliseconds, percent
from yolino.benchmark.setup import Setup
from yolino.inference import Predictor
from yolino.inference.postprocessing import build_linker
from yolino.io import read_image
from yolino.viz import draw_polylines

# What a program does around the predictor.
OUTSIDE = {
    "read": "decode the JPEG file",
    "read_half": "decode the JPEG file at half its size",
    "drawing": "draw the polylines",
}
_POSTPROCESSING = ("threshold", "nms", "linking", "mapping")
ABOUT = (
    "Each frame is an RGB array in, polylines out, through the same `Predictor` that users call, with a "
    "clock between its steps. The bare network runs on the prepared input in the same rounds. The second and "
    f"the third block hand {CANDIDATES} made-up candidates around lanes to the post-processing, after the "
    "network has run; the third links with the linker of new models. A turn is "
    f"{ROW} frames in a row, as in a video."
)


def measure(setup: Setup) -> Section:
    """Times the steps of the frame as the model sees it, and of one full of candidates."""
    predictor, image = setup.predictor, setup.frame
    made_up = made_up_output(predictor, setup.rng)
    frames = {
        "image": ClockedFrame(predictor, image),
        "candidates": ClockedFrame(predictor, image, made_up),
        "graph": ClockedFrame(_with_graph(predictor), image, made_up),
    }
    bare = bare_network(predictor, image)
    found = predictor.stages(image)
    outside = {
        "read": lambda: read_image(setup.jpeg),
        "read_half": lambda: read_image(setup.jpeg, reduce=2),
        "drawing": lambda: draw_polylines(image, found.polylines),
    }
    times = race({**frames, "network": bare, **outside}, **setup.pace, calls=ROW)
    titles = {
        "image": f"this image, {len(found.candidates)} candidates",
        "candidates": f"{CANDIDATES} candidates",
        "graph": f"{CANDIDATES} candidates, linker graph",
    }
    measures = {"network": milliseconds("bare network", times["network"])}
    for name, frame in frames.items():
        rows = np.array(frame.rows[-ROW * len(times[name].seconds) :])
        for step, measured in _steps(rows, times[name], times["network"]).items():
            measures[f"{name}_{step}"] = _titled(measured, titles[name])
    measures |= {name: milliseconds(title, times[name]) for name, title in OUTSIDE.items()}
    height, width = image.shape[:2]
    return Section(f"One frame of {height}x{width}, step by step", ABOUT, measures)


def _steps(rows: np.ndarray, total: Times, network: Times) -> dict[str, Measure]:
    """Gives the measures of one kind of frame from the seconds of its steps."""
    aims = {"preprocess": at_most(1.0)}
    measures = {
        name: milliseconds(title, Times(rows[:, column]), aims.get(name))
        for column, (name, title) in enumerate(STEPS.items())
    }
    after = rows[:, [list(STEPS).index(name) for name in _POSTPROCESSING]].sum(axis=1)
    inside = rows[:, list(STEPS).index("network")]
    low, middle, high = (float(q) for q in np.quantile(1 / total.seconds, (0.25, 0.5, 0.75)))
    return measures | {
        "after": milliseconds("post-processing, its four steps", Times(after), at_most(0.5)),
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


def _with_graph(predictor: Predictor) -> Predictor:
    """Gives the predictor with the linker of new models."""
    header = predictor.header
    graph = {"linker": "graph", "linker_options": {}}
    linker = build_linker(replace(header, postprocess={**header.postprocess, **graph}))
    return Predictor(
        predictor.engine, header, threshold=predictor.threshold, nms=predictor.nms, linker=linker
    )


def _titled(measure: Measure, prefix: str) -> Measure:
    return Measure(**{**vars(measure), "title": f"{prefix}: {measure.title}"})


__all__ = ["measure"]
