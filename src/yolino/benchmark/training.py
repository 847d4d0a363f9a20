"""Sections `matching` and `training`: matching beside loops, and its share of a training step."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from time import perf_counter
from typing import Any

import numpy as np
import torch
from torch import Tensor

from yolino.benchmark.baselines.loop_matching import Pairs, match_cell_by_cell, match_pair_by_pair
from yolino.benchmark.clock import race
from yolino.benchmark.measure import (
    TRUE,
    Measure,
    Section,
    at_least,
    at_most,
    milliseconds,
    percent,
    ratio,
)
from yolino.benchmark.scenes import SIZE, STRIDE, converging_lanes
from yolino.benchmark.setup import Setup
from yolino.grid import Grid
from yolino.model.network import Network, Prediction
from yolino.model.representations import CartesianPoints
from yolino.training.losses import Criterion
from yolino.training.matching import Matches, match
from yolino.training.targets import Targets, cell_targets, collate

BATCH = 8
_LANES, _PREDICTORS = 5, 8
# The networks of configs/default.yaml and of the paper.
NETWORKS: dict[str, dict[str, Any]] = {
    "default": {
        "backbone": "residual",
        "backbone_args": {"widths": [32, 48, 96, 192], "blocks": [1, 2, 2, 3], "stem": 16},
        "upsample": 1,
        "neck_width": 96,
        "predictors": _PREDICTORS,
        "representation": "po",
    },
    "darknet19": {"backbone": "darknet19", "upsample": 1, "predictors": _PREDICTORS},
}
_TITLES = {"default": "default network", "darknet19": "Darknet-19"}
MATCHING = (
    f"One core: a batch of {BATCH} labels of {_LANES} lanes at {SIZE[0]}x{SIZE[1]}, {STRIDE} px, "
    f"{_PREDICTORS} predictors. Brute force is the paper's sentence: the distance of each pair of segment "
    "and predictor in a cell, then the closest again and again. The second loop computes all distances of "
    "a cell at once."
)
TRAINING = (
    f"One optimizer step (AdamW) on {BATCH} images of {SIZE[0]}x{SIZE[1]} on the processor with the bf16 "
    "mixed precision of configs/default.yaml. Matching, loss and the gradient of the loss with respect to "
    "the prediction are timed within the step."
)


def measure_matching(setup: Setup) -> Section:
    """Times the matching of one batch."""
    targets = _targets(setup.rng, 2 if setup.quick else BATCH, SIZE)
    representation = CartesianPoints()
    cells = (SIZE[0] // STRIDE) * (SIZE[1] // STRIDE)
    images = len(targets.ignored)
    generator = torch.Generator().manual_seed(0)
    raw = torch.randn(images, cells, _PREDICTORS, representation.num_params, generator=generator)
    arguments = (representation.activate(raw), targets, representation)
    with _torch_threads(1):
        times = race(
            {
                "ours": lambda: match(*arguments),
                "pairs": lambda: match_pair_by_pair(*arguments),
                "cells": lambda: match_cell_by_cell(*arguments),
            },
            **setup.pace,
        )
        ours = _pairs(match(*arguments))
        same = ours == match_pair_by_pair(*arguments) == match_cell_by_cell(*arguments)
    title = f"{len(targets.cells)} segments"
    measures = {
        "ours": milliseconds(f"{title}: yolino", times["ours"]),
        "pairs": milliseconds(f"{title}: brute force", times["pairs"]),
        "cells": milliseconds(f"{title}: loop over cells", times["cells"]),
        "speedup": ratio("yolino is faster than brute force", times["pairs"], times["ours"], at_least(60)),
        "speedup_cells": ratio("yolino is faster than the loop over cells", times["cells"], times["ours"]),
        "identical": Measure("same pairs", same, target=TRUE),
    }
    return Section("Matching beside loops", MATCHING, measures)


def measure_training(setup: Setup) -> Section:
    """Times training steps, and what matching and loss take of them."""
    measures: dict[str, Measure] = {}
    with _torch_threads(setup.threads):
        steps = {name: _Step(Network(**arguments), setup) for name, arguments in NETWORKS.items()}
        times = race(steps, **setup.pace, calls=1)
    for name, step in steps.items():
        rows = np.array(step.rows[-len(times[name].seconds) :])
        measures[f"{name}_step"] = milliseconds(f"{_TITLES[name]}: training step", times[name])
        measures[f"{name}_share"] = percent(
            f"{_TITLES[name]}: matching and loss, of the step", rows[:, 0] / rows[:, 1], at_most(5)
        )
    return Section("Matching and loss in training", TRAINING, measures)


class _Step:
    """One optimizer step; each call adds the seconds of matching and loss, and of all, to `rows`."""

    def __init__(self, network: Network, setup: Setup) -> None:
        size, batch = ((64, 64), 2) if setup.quick else (SIZE, BATCH)
        self.network = network.train().to(memory_format=torch.channels_last)
        self.criterion = Criterion(network.representation)
        self.optimizer = torch.optim.AdamW(network.parameters(), lr=1e-4)
        self.targets = _targets(setup.rng, batch, size)
        pixels = setup.rng.integers(0, 256, (batch, *size, 3), dtype=np.uint8)
        self.images = torch.from_numpy(pixels).permute(0, 3, 1, 2)
        self.rows: list[tuple[float, float]] = []

    def __call__(self) -> None:
        start = perf_counter()
        self.optimizer.zero_grad()
        with torch.autocast("cpu", torch.bfloat16):
            prediction = self.network(self.images.float())
            before = perf_counter()
            leaves = Prediction(*(output.detach().requires_grad_() for output in prediction))
            losses, _ = self.criterion(leaves, self.targets)
        losses.total.backward()
        after = perf_counter()
        outputs, gradients = _with_gradients(prediction, leaves)
        torch.autograd.backward(outputs, gradients)
        self.optimizer.step()
        self.rows.append((after - before, perf_counter() - start))


def _with_gradients(prediction: Prediction, leaves: Prediction) -> tuple[list[Tensor], list[Tensor]]:
    """Gives the outputs that the loss depends on, and its gradients there."""
    both = [(output, leaf.grad) for output, leaf in zip(prediction, leaves, strict=True)]
    used = [(output, gradient) for output, gradient in both if gradient is not None]
    return [output for output, _ in used], [gradient for _, gradient in used]


def _targets(rng: np.random.Generator, batch: int, size: tuple[int, int]) -> Targets:
    grid = Grid(size, STRIDE)
    lanes = [converging_lanes(rng, size, _LANES, nearest=0.08) for _ in range(batch)]
    return collate([cell_targets(lines, grid, border=False) for lines in lanes])


def _pairs(matches: Matches) -> Pairs:
    return set(
        zip(matches.targets.tolist(), matches.cells.tolist(), matches.predictors.tolist(), strict=True)
    )


@contextlib.contextmanager
def _torch_threads(count: int) -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


__all__ = ["BATCH", "NETWORKS", "measure_matching", "measure_training"]
