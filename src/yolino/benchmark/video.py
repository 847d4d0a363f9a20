"""Section `video`: a video to polylines with identities, the steps of several frames at a time."""

from __future__ import annotations

from time import perf_counter

import numpy as np

from yolino.benchmark.measure import Measure, Section, at_least, percent
from yolino.benchmark.setup import Setup
from yolino.inference.frames import Frame, open_frames
from yolino.inference.tracking import Tracker
from yolino.inference.video import VideoPrediction, draw_frame
from yolino.inference.video_pipeline import Step
from yolino.inference.video_writer import VideoWriter

_FRAMES = 150
_RUNS = 3
_RATE = 30.0
ABOUT = (
    f"The frame {_FRAMES} times as a video file in, drawn frames out. Reading, network, linking, tracking "
    "and drawing have a thread each. The share is how long the slowest of them worked, of the whole time: "
    "what is missing from 100 % was spent waiting."
)


def measure(setup: Setup) -> Section:
    """Times the pipeline."""
    count = 4 if setup.quick else _FRAMES
    path = setup.folder / "frame.mp4"
    with VideoWriter(path, _RATE) as writer:
        for number in range(count):
            writer.add(Frame(number, number / _RATE, setup.frame))
    runs = [_run(setup, count) for _ in range(1 if setup.quick else _RUNS + 1)]
    rates, shares = np.array(runs[-_RUNS:]).T
    low, middle, high = (float(q) for q in np.quantile(rates, (0.25, 0.5, 0.75)))
    measures = {
        "rate": Measure("video to drawn frames", middle, "fps", low, high),
        "slowest": percent("time that the slowest step worked", shares, at_least(90)),
    }
    return Section("Video to polylines", ABOUT, measures)


def _run(setup: Setup, count: int) -> tuple[float, float]:
    """Gives frames per second, and the share of the time that the slowest step worked."""
    header = setup.predictor.header
    drawing = Step("drawing", lambda result: draw_frame(result, directed=header.directed))
    video = VideoPrediction(
        setup.predictor,
        open_frames(str(setup.folder / "frame.mp4")),
        tracker=Tracker(directed=header.directed),
        finish=[drawing],
    )
    start = perf_counter()
    found = sum(1 for _ in video)
    seconds = perf_counter() - start
    assert found == count
    return found / seconds, max(video.seconds.values()) / seconds


__all__ = ["measure"]
