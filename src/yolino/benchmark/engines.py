"""Section `engines`: the model on every engine, bare and from image to polylines."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from yolino.benchmark.clock import Times, race
from yolino.benchmark.contestants import Contestants, contestants
from yolino.benchmark.cost import Cost, cost_of
from yolino.benchmark.frames import ROW, ClockedFrame, bare_network, made_up_output, whole_batch
from yolino.benchmark.measure import (
    Measure,
    Section,
    Target,
    at_least,
    at_most,
    lacking,
    milliseconds,
    percent,
)
from yolino.benchmark.quantized import model_files
from yolino.benchmark.roofline import peaks
from yolino.benchmark.setup import Setup
from yolino.inference import Predictor

AIM_CORES = 2  # the aims in frames per second are those of two cores
_AROUND = 10.0  # percent
EVERY = (
    "Each engine that is installed takes its turn: bare, then RGB array in, polylines out. A turn is "
    f"{ROW} frames in a row, as in a video. Batches are given per image. The part of the roofline: what the "
    "network would take at the speed of the fastest matrix product of that precision. More than 100 % is "
    "possible: Winograd's algorithm computes a 3x3 convolution with fewer operations than are counted. int8 "
    "is quantized with this one frame, for its speed, not for its accuracy."
)
# Frames per second from RGB array to polylines that this project promises on two cores.
AIMS = {"onnxruntime fp32": 70.0, "openvino bf16": 140.0, "openvino int8": 140.0}


def measure(setup: Setup) -> Section:
    """Times the model on every engine."""
    header, title = setup.predictor.header, f"{setup.predictor.header.name} on every engine"
    files = model_files(setup)
    entered = contestants(files, setup, threshold=setup.predictor.threshold)
    if not entered.predictors:
        return Section(title, "", not_measured=f"not measured: no engine here runs it.{say_absent(entered)}")
    aims = AIMS if (header.name, header.precision) == ("default", "fp32") else {}
    measures = race_engines(entered, files, setup, aims=aims)
    return Section(title, EVERY + say_absent(entered), measures)


def race_engines(
    entered: Contestants,
    files: Sequence[Path],
    setup: Setup,
    *,
    aims: Mapping[str, float],
    made_up: bool = False,
) -> dict[str, Measure]:
    """Gives what a network costs, and the times of all contestants.

    Args:
        entered: Who takes part.
        files: Files of the network.
        setup: The frame and the pace.
        aims: Frames per second to reach on two cores, by contestant.
        made_up: Whether the post-processing gets made-up candidates in place of the network's.
    """
    readable = [file for file in files if file.suffix in (".onnx", ".xml")]
    known = bool(readable) and not lacking("openvino")
    cost = cost_of(readable[0]) if known else None
    top = peaks(setup) if known and setup.device != "cuda" else {}  # they are the processor's
    size = setup.batch
    aims = aims if setup.threads == AIM_CORES and setup.device != "cuda" else {}
    times = race(_calls(entered.predictors, setup, made_up=made_up), **setup.pace, calls=1)
    measures = {} if cost is None else _cost_measures(cost)
    for name, predictor in entered.predictors.items():
        title, key = predictor.engine.name, name.replace(" ", "_")
        bare, whole = (Times(times[f"{name} {what}"].seconds / ROW) for what in ("bare", "whole"))
        measures[f"{key}_network"] = milliseconds(f"{title}: bare network", bare)
        measures[f"{key}_total"] = milliseconds(f"{title}: end to end", whole)
        measures[f"{key}_fps"] = _frames_per_second(title, whole, aims.get(name))
        limit = at_most(_AROUND) if name in aims and made_up else None
        around = whole.seconds / bare.seconds - 1
        measures[f"{key}_around"] = percent(
            f"{title}: around the network, of the bare network", around, limit
        )
        if cost is not None and predictor.engine.precision in top:
            share = cost.operations / top[predictor.engine.precision] / bare.seconds
            measures[f"{key}_roofline"] = percent(f"{title}: part of the roofline", share)
        for what, label in (("batch", "bare network"), ("batch_whole", "end to end")):
            per_image = Times(times[f"{name} {what}"].seconds / size)
            measures[f"{key}_{what}"] = milliseconds(
                f"{title}: {label}, batches of {size}, per image", per_image
            )
    return measures


def _calls(
    predictors: Mapping[str, Predictor], setup: Setup, *, made_up: bool
) -> dict[str, Callable[[], object]]:
    calls: dict[str, Callable[[], object]] = {}
    for name, predictor in predictors.items():
        output = made_up_output(predictor, setup.rng) if made_up else None
        calls[f"{name} bare"] = _in_a_row(bare_network(predictor, setup.frame))
        calls[f"{name} whole"] = _in_a_row(ClockedFrame(predictor, setup.frame, output))
        calls[f"{name} batch"] = bare_network(predictor, setup.frame, count=setup.batch)
        calls[f"{name} batch_whole"] = whole_batch(predictor, setup.frame, setup.batch, output)
    return calls


def _in_a_row(call: Callable[[], object]) -> Callable[[], object]:
    """Gives a turn of several frames: the first one brings the weights back into the processor's cache."""

    def turn() -> None:
        for _ in range(ROW):
            call()

    return turn


def _cost_measures(cost: Cost) -> dict[str, Measure]:
    return {
        "parameters": Measure("parameters", cost.parameters / 1e6, "million"),
        "operations": Measure("operations for one image", cost.operations / 1e9, "GFLOP"),
    }


def _frames_per_second(title: str, times: Times, aim: float | None) -> Measure:
    low, middle, high = (float(q) for q in np.quantile(1 / times.seconds, (0.25, 0.5, 0.75)))
    target: Target | None = None if aim is None else at_least(aim)
    return Measure(f"{title}: frames per second, end to end", middle, "fps", low, high, target)


def say_absent(entered: Contestants) -> str:
    """Gives the end of a section's text: who does not take part, and why."""
    return "".join(f" {why}." for why in entered.absent)


__all__ = ["AIMS", "AIM_CORES", "EVERY", "measure", "race_engines", "say_absent"]
