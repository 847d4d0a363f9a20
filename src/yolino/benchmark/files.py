"""Section `files`: images per second from JPEG files, with the steps of several images at a time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from yolino.benchmark.clock import Times, race
from yolino.benchmark.contestants import contestants
from yolino.benchmark.engines import AIM_CORES, say_absent
from yolino.benchmark.measure import Measure, Section, at_least
from yolino.benchmark.quantized import model_files
from yolino.benchmark.setup import Setup
from yolino.inference import Predictor

_TITLE = "JPEG files to polylines"
_FILES = 48
# Images per second that this project promises on two cores, decoding at half the size.
AIMS = {"openvino bf16": 100.0, "openvino int8": 140.0}
ABOUT = (
    f"{_FILES} times the frame as a JPEG file (in the memory of the system) in, polylines out, through "
    "`Predictor.stream`: worker threads that each do whole images. Decoded whole, and at half its size: the "
    "network sees no more."
)


def measure(setup: Setup) -> Section:
    """Times the model on every engine."""
    shared = replace(setup, streams=setup.threads)
    entered = contestants(model_files(setup), shared, threshold=setup.predictor.threshold)
    if not entered.predictors:
        return Section(_TITLE, "", not_measured=f"not measured: no engine here runs it.{say_absent(entered)}")
    paths = [setup.jpeg] * (4 if setup.quick else _FILES)
    calls: dict[str, Callable[[], object]] = {}
    for name, predictor in entered.predictors.items():
        calls[f"{name} whole"] = _stream(predictor, paths, reduced=False)
        calls[f"{name} half"] = _stream(predictor, paths, reduced=True)
    times = race(calls, **setup.pace, calls=1)
    header = setup.predictor.header
    aimed = setup.threads == AIM_CORES and (header.name, header.precision) == ("default", "fp32")
    measures: dict[str, Measure] = {}
    for name, predictor in entered.predictors.items():
        title, key = predictor.engine.name, name.replace(" ", "_")
        aim = AIMS.get(name) if aimed else None
        measures[f"{key}_whole"] = _rate(f"{title}: decoded whole", times[f"{name} whole"], len(paths), None)
        half = f"{title}: decoded at half the size"
        measures[f"{key}_half"] = _rate(half, times[f"{name} half"], len(paths), aim)
    return Section(_TITLE, ABOUT, measures)


def _stream(predictor: Predictor, paths: Sequence[Path], *, reduced: bool) -> Callable[[], object]:
    return lambda: list(predictor.stream(paths, reduced=reduced))


def _rate(title: str, times: Times, count: int, aim: float | None) -> Measure:
    low, middle, high = (float(q) for q in np.quantile(count / times.seconds, (0.25, 0.5, 0.75)))
    return Measure(title, middle, "images/s", low, high, None if aim is None else at_least(aim))


__all__ = ["AIMS", "measure"]
