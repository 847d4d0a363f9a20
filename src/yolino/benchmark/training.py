"""Sections `matching` and `training`: matching beside loops, and its share of a training step."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator
from time import perf_counter
from typing import Any

import numpy as np
import torch
from torch import Tensor

from yolino.benchmark.baselines.loop_matching import Pairs, match_cell_by_cell, match_pair_by_pair
from yolino.benchmark.clock import race
from yolino.benchmark.loading import jpeg_batches, jpeg_files
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
from yolino.training.data import to_device
from yolino.training.losses import Criterion
from yolino.training.matching import Matches, match
from yolino.training.module import fuses
from yolino.training.targets import Targets, cell_targets, collate

BATCH, CUDA_BATCH = 8, 64
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
        "num_classes": 4,
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
PARTS = ("data", "forward", "matching", "loss", "backward", "optimizer")
_PART_TITLES = {
    "data": "waiting for data",
    "forward": "network, forward",
    "matching": "matching",
    "loss": "loss and its gradient",
    "backward": "network, backward",
    "optimizer": "optimizer",
}
TRAINING = (
    f"One optimizer step (AdamW, the bf16 mixed precision of configs/default.yaml) on images of "
    f"{SIZE[0]}x{SIZE[1]}, cells of {STRIDE} px: {BATCH} images on a processor, {CUDA_BATCH} on CUDA. "
    "Batches come from the loader of `yolino train` (JPEG files, the default augmentation; one process loads "
    "beside a processor, one per core beside CUDA). The loss includes its gradient with respect to the "
    "prediction. Parts are timed within the step; on CUDA each waits for the one before, so the images per "
    "second there are those of steps without clocks."
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
    """Times training steps and their parts."""
    device = torch.device("cuda" if setup.device == "cuda" else "cpu")
    if device.type == "cuda" and not torch.cuda.is_available():
        title, why = "Matching and loss in training", "not measured: no GPU that torch can use"
        return Section(title, TRAINING, not_measured=why)
    measures: dict[str, Measure] = {}
    with _torch_threads(setup.threads):
        steps = {name: _Step(Network(**arguments), setup, device) for name, arguments in NETWORKS.items()}
        times = race(steps, **setup.pace, calls=1)
        rates = {name: _rate(step) for name, step in steps.items()} if device.type == "cuda" else {}
    for name, step in steps.items():
        rows, title = np.array(step.rows[-len(times[name].seconds) :]), _TITLES[name]
        measures[f"{name}_step"] = milliseconds(f"{title}: training step", times[name])
        for part, seconds in zip(PARTS, rows.T, strict=True):
            shares = seconds / rows.sum(axis=1)
            measures[f"{name}_{part}"] = percent(f"{title}: {_PART_TITLES[part]}, of the step", shares)
        shares = rows[:, 2:4].sum(axis=1) / rows[:, 1:].sum(axis=1)
        measures[f"{name}_share"] = percent(
            f"{title}: matching and loss, of the step without waiting", shares, at_most(5)
        )
        rate = rates.get(name, step.batch / times[name].median)
        target = at_least(1500) if device.type == "cuda" else None
        measures[f"{name}_rate"] = Measure(f"{title}: training", rate, "images/s", target=target)
    return Section("Matching and loss in training", TRAINING, measures)


class _Step:
    """One optimizer step; each call adds the seconds of its parts to `rows`."""

    def __init__(self, network: Network, setup: Setup, device: torch.device) -> None:
        self.device, cuda = device, device.type == "cuda"
        self.batch = 2 if setup.quick else CUDA_BATCH if cuda else BATCH
        self.network = network.train().to(device).to(memory_format=torch.channels_last)
        self.criterion = Criterion(network.representation)
        fused = True if fuses(device, "bf16-mixed") else None
        self.optimizer = torch.optim.AdamW(network.parameters(), lr=1e-4, fused=fused)
        workers = setup.threads if cuda else 1
        self.batches = jpeg_batches(
            setup, jpeg_files(setup), "gentle", batch=self.batch, workers=workers, cuda=cuda
        )
        self.endless = itertools.chain.from_iterable(itertools.repeat(self.batches))
        self.rows: list[list[float]] = []

    def __call__(self) -> None:
        """Takes the time of each part, on CUDA with a wait for the GPU between them."""
        seconds = [self._now()]
        images, targets = self.data()
        seconds.append(self._now())
        with self._autocast():
            prediction = self.network(images.float())
            seconds.append(self._now())
            leaves = Prediction(*(output.detach().requires_grad_() for output in prediction))
            matches = self.criterion.match(leaves, targets)
            seconds.append(self._now())
            losses = self.criterion.losses(leaves, targets, matches)
        torch.autograd.backward(losses.total)
        seconds.append(self._now())
        outputs, gradients = _with_gradients(prediction, leaves)
        torch.autograd.backward(outputs, gradients)
        seconds.append(self._now())
        self.update()
        seconds.append(self._now())
        self.rows.append(np.diff(seconds).tolist())

    def data(self) -> tuple[Tensor, Targets]:
        """Gives the next batch on the device."""
        batch = to_device(next(self.endless), self.device)
        return batch.images, batch.targets

    def update(self) -> None:
        """Changes the weights."""
        self.optimizer.step()
        self.optimizer.zero_grad()

    def plain(self) -> None:
        """Does the same without clocks."""
        images, targets = self.data()
        with self._autocast():
            losses, _ = self.criterion(self.network(images.float()), targets)
        torch.autograd.backward(losses.total)
        self.update()

    def _autocast(self) -> torch.autocast:
        return torch.autocast(self.device.type, torch.bfloat16)

    def _now(self) -> float:
        if self.device.type == "cuda":
            torch.cuda.synchronize()
        return perf_counter()


def _rate(step: _Step, steps: int = 30) -> float:
    """Gives the images per second of steps without clocks."""
    step.plain()
    start = step._now()
    for _ in range(steps):
        step.plain()
    return steps * step.batch / (step._now() - start)


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


__all__ = ["BATCH", "NETWORKS", "PARTS", "measure_matching", "measure_training"]
