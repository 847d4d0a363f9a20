"""Section `loading`: JPEG file to augmented training tensor with targets, beside PIL and torchvision."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import UInt8
from torch import Tensor

from yolino.benchmark.baselines.torchvision_loading import TorchvisionLoader
from yolino.benchmark.clock import opencv_threads, race
from yolino.benchmark.measure import Section, at_least, milliseconds, ratio
from yolino.benchmark.scenes import SIZE, STRIDE, converging_lanes
from yolino.benchmark.setup import Setup
from yolino.grid import Grid
from yolino.training.augment import PRESETS, Augment
from yolino.training.targets import CellTargets, cell_targets
from yolino.types import Sample

_LANES = 5
ABOUT = (
    "One core: the frame as a JPEG file (quality 95) and five lanes in, a uint8 tensor of "
    f"{SIZE[0]}x{SIZE[1]} and its targets out. The other decodes with PIL, crops and shrinks to that size, "
    "then jitters the color, rotates, crops and erases with torchvision v2 on the PIL image (faster "
    "there than on tensors), moves the vertices as KeyPoints and cuts them with our targets. Both augment "
    "as the paper does."
)


def measure(setup: Setup) -> Section:
    """Times both, and our own default augmentation."""
    lanes = converging_lanes(setup.rng, (setup.frame.shape[0], setup.frame.shape[1]), _LANES, nearest=0.08)
    sample, grid = Sample("frame", setup.jpeg, lanes), Grid(SIZE, STRIDE)
    plain = TorchvisionLoader(SIZE, grid, draft=False)
    drafted = TorchvisionLoader(SIZE, grid, draft=True)
    paper, gentle = _Loader("paper", sample, grid), _Loader("gentle", sample, grid)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with opencv_threads(1):
            times = race(
                {
                    "ours": paper,
                    "torchvision": lambda: plain(setup.jpeg, lanes),
                    "torchvision_draft": lambda: drafted(setup.jpeg, lanes),
                    "gentle": gentle,
                },
                **setup.pace,
                calls=1,
            )
    finally:
        torch.set_num_threads(threads)
    measures = {
        "ours": milliseconds("yolino, the paper's augmentation", times["ours"]),
        "torchvision": milliseconds("PIL and torchvision v2", times["torchvision"]),
        "torchvision_draft": milliseconds(
            "PIL and torchvision v2, JPEG decoded at half its size", times["torchvision_draft"]
        ),
        "speedup": ratio("yolino is faster", times["torchvision"], times["ours"], at_least(4)),
        "speedup_draft": ratio(
            "yolino is faster than with half-size decoding", times["torchvision_draft"], times["ours"]
        ),
        "gentle": milliseconds("yolino, the default augmentation", times["gentle"]),
    }
    return Section("JPEG file to training tensor", ABOUT, measures)


class _Loader:
    """What `yolino train` does with one sample."""

    def __init__(self, preset: str, sample: Sample, grid: Grid) -> None:
        self._augment = Augment(SIZE, **PRESETS[preset])
        self._sample, self._grid, self._rng = sample, grid, np.random.default_rng(0)

    def __call__(self) -> tuple[UInt8[Tensor, "3 h w"], CellTargets]:
        image, polylines, ignore = self._augment(self._sample, self._rng)
        targets = cell_targets(polylines, self._grid, border=False, ignore=ignore)
        return torch.from_numpy(image).permute(2, 0, 1), targets


__all__ = ["measure"]
