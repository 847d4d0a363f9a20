"""Section `paper`: the paper's network on every engine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from yolino.benchmark.contestants import Contestants, contestants
from yolino.benchmark.engines import EVERY, race_engines, say_absent
from yolino.benchmark.measure import Measure, Section, at_least
from yolino.benchmark.quantized import quantized_copies
from yolino.benchmark.setup import Setup
from yolino.export import onnx_bytes
from yolino.header import Header
from yolino.model.checkpoint import save_checkpoint
from yolino.model.network import Network

_SIZE, _PREDICTORS = (320, 640), 8
# Edge of a cell, blocks that double the resolution, and frames per second to reach on two cores.
CELLS = {32: (0, 28.0), 16: (1, 22.0)}
BACKBONE = "darknet19"
ABOUT = (
    "Darknet-19 as in the paper, with random weights; the post-processing gets 500 made-up candidates around "
    "lanes, after the network has run. "
)


def measure(setup: Setup) -> Section:
    """Times it with cells of 32 and of 16 px."""
    measures: dict[str, Measure] = {}
    entered = Contestants({}, [])
    for stride, (upsample, aim) in CELLS.items():
        files = write_network(stride, upsample, setup)
        files += quantized_copies(files[0], setup)
        entered = contestants(files, setup)
        found = race_engines(entered, files, setup, aims={"openvino int8": aim}, made_up=True)
        if setup.device == "cuda" and stride == 16:
            found |= gpu_aims(found, setup.batch)
        measures |= {
            f"{stride}px_{key}": replace(one, title=f"{stride} px, {one.title}") for key, one in found.items()
        }
    return Section("Darknet-19 on every engine", ABOUT + EVERY + say_absent(entered), measures)


def gpu_aims(found: Mapping[str, Measure], batch: int) -> dict[str, Measure]:
    """Gives what the fastest engine on a GPU reaches of the aims: one frame after the other, and in batches.

    Args:
        found: What `race_engines` gave.
        batch: Images in a batch.
    """
    frames = [float(one.value or 0) for name, one in found.items() if name.endswith("_fps")]
    per_image = [float(one.value or 0) for name, one in found.items() if name.endswith("_batch_whole")]
    rate = 1e3 / min(per_image)
    return {
        "best_fps": Measure("fastest engine, end to end", max(frames), "fps", target=at_least(1000)),
        "best_batches": Measure(
            f"fastest engine, batches of {batch}", rate, "images/s", target=at_least(8000)
        ),
    }


def write_network(stride: int, upsample: int, setup: Setup) -> list[Path]:
    """Gives Darknet-19 with random weights as an .onnx file and as a checkpoint."""
    size = (64, 64) if setup.quick else _SIZE
    header = Header("", f"darknet19-{stride}", size, stride, _PREDICTORS, "po")
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        arguments: dict[str, Any] = {"backbone": BACKBONE, "upsample": upsample, "predictors": _PREDICTORS}
        network = Network(**arguments)
    file = setup.folder / f"{header.name}.onnx"
    file.write_bytes(onnx_bytes(network, header))
    save_checkpoint(file.with_suffix(".safetensors"), network.state_dict(), header, arguments)
    return [file, file.with_suffix(".safetensors")]


__all__ = ["BACKBONE", "CELLS", "measure", "write_network"]
