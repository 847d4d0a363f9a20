"""Section `darknet19`: the default model beside the paper's network, on the same engine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import torch

from yolino.benchmark.clock import race
from yolino.benchmark.frames import ClockedFrame, bare_network, made_up_output
from yolino.benchmark.measure import Measure, Section, at_least, milliseconds, ratio
from yolino.benchmark.setup import Setup
from yolino.benchmark.training import NETWORKS
from yolino.export import onnx_bytes
from yolino.inference import OnnxEngine, Predictor
from yolino.model.network import Network

_STRIDE = 16
_FRAMES = 8
NETWORK = NETWORKS["darknet19"]
ABOUT = (
    "Darknet-19 with cells of 16 px and the neck of the paper's configuration, random weights, exported "
    "like any model and run by the same engine on the same input size; both are followed by the same "
    "post-processing of the same made-up candidates. A turn is eight frames in a row, as in a video: between "
    "single frames of the other network, the weights of a small one are pushed out of the processor's cache."
)


def measure(setup: Setup) -> Section:
    """Times both networks, bare and end to end."""
    ours = setup.predictor
    if not isinstance(ours.engine, OnnxEngine):
        return Section(_TITLE, ABOUT, not_measured="the model runs in torch; export it as .onnx first")
    theirs = _darknet(setup)
    output = made_up_output(theirs, setup.rng)
    contestants: dict[str, Callable[[], object]] = {
        "model": ClockedFrame(ours, setup.frame, output),
        "darknet19": ClockedFrame(theirs, setup.frame, output),
        "model_network": bare_network(ours, setup.frame),
        "darknet19_network": bare_network(theirs, setup.frame),
    }
    times = race(contestants, **setup.pace, calls=_FRAMES)
    titles = {"model": ours.header.name, "darknet19": "Darknet-19, 16 px"}
    measures: dict[str, Measure] = {}
    for name, title in titles.items():
        measures[f"{name}_network"] = milliseconds(f"{title}: bare network", times[f"{name}_network"])
        measures[f"{name}_total"] = milliseconds(f"{title}: end to end", times[name])
    measures["speedup"] = ratio(
        f"{ours.header.name} is faster, end to end", times["darknet19"], times["model"], at_least(10)
    )
    return Section(_TITLE, ABOUT, measures)


_TITLE = "The model beside Darknet-19"


def _darknet(setup: Setup) -> Predictor:
    """Gives a predictor with Darknet-19 and the post-processing of the model."""
    header = replace(
        setup.predictor.header,
        name="darknet19",
        stride=_STRIDE,
        predictors=NETWORK["predictors"],
        representation="po",
    )
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        network = Network(**NETWORK | {"num_classes": len(header.classes)})
    file = setup.folder / "darknet19.onnx"
    file.write_bytes(onnx_bytes(network, header))
    engine = OnnxEngine(file, device=setup.device, threads=setup.threads)
    return Predictor(engine, threshold=setup.predictor.threshold)


__all__ = ["measure"]
