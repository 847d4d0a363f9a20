"""The part of section `growth` that needs torch: one network, exported for larger and larger inputs."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import torch
from jaxtyping import UInt8

from yolino.benchmark.curves import Curve
from yolino.benchmark.growing import Case, grow
from yolino.benchmark.setup import Setup
from yolino.benchmark.training import NETWORKS
from yolino.export import onnx_bytes
from yolino.header import Header
from yolino.inference import Engine, open_engine
from yolino.model.network import Network

INPUTS = ((96, 192), (160, 320), (320, 640), (640, 1280), (1280, 2560))
_STRIDE = 16


def measure_inputs(setup: Setup) -> Curve:
    """Times the default network with random weights, for each size of its input."""
    cases = []
    for height, width in INPUTS[:2] if setup.quick else INPUTS:
        file = _write(setup, (height, width))
        batch = np.zeros((1, height, width, 3), np.uint8)
        run = partial(_open(setup, file), batch)
        cases.append(Case(height * width, run, f"{width}x{height}", _fresh(setup, file, batch)))
    return grow(setup, "input", "network", "pixels of the network's input", cases)


def _open(setup: Setup, file: Path) -> Engine:
    return open_engine(file, device=setup.device, threads=setup.threads)


def _fresh(setup: Setup, file: Path, batch: UInt8[np.ndarray, "b h w 3"]) -> Callable[[], object]:
    return lambda: _open(setup, file)(batch)


def _write(setup: Setup, size: tuple[int, int]) -> Path:
    """Writes the network for one size of input."""
    arguments, name = NETWORKS["default"], f"input{size[0]}x{size[1]}"
    classes = tuple(map(str, range(arguments["num_classes"])))
    header = Header("", name, size, _STRIDE, arguments["predictors"], arguments["representation"], classes)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        network = Network(**arguments)
    file = setup.folder / f"{name}.onnx"
    file.write_bytes(onnx_bytes(network, header))
    return file


__all__ = ["INPUTS", "measure_inputs"]
