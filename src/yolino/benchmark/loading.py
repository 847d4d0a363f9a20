"""Section `loading`: JPEG file to augmented training tensor with targets, alone and in batches."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from time import perf_counter

import numpy as np
import torch
from jaxtyping import UInt8
from torch import Tensor

from yolino.benchmark.baselines.torchvision_loading import TorchvisionLoader
from yolino.benchmark.clock import opencv_threads, race
from yolino.benchmark.measure import Measure, Section, at_least, milliseconds, ratio
from yolino.benchmark.scenes import SIZE, STRIDE, converging_lanes
from yolino.benchmark.setup import Setup
from yolino.grid import Grid
from yolino.training.augment import PRESETS, Augment
from yolino.training.cache import PixelCache
from yolino.training.data import EndlessSampler, Examples
from yolino.training.frames import CachedFrames, Frames
from yolino.training.loaders import Batches, loader_options
from yolino.training.targets import CellTargets, cell_targets
from yolino.types import Sample

BATCH = 16
_LANES, _FILES = 5, 32
_BATCHES = 12  # per worker and turn
_TITLES = {"paper": "the paper's augmentation", "gentle": "the default augmentation"}
ABOUT = (
    "One core: the frame as a JPEG file (quality 95) and five lanes in, a uint8 tensor of "
    f"{SIZE[0]}x{SIZE[1]} and its targets out. The other decodes with PIL, crops and shrinks to that size, "
    "then jitters the color, rotates, crops and erases with torchvision v2 on the PIL image (faster "
    "there than on tensors), moves the vertices as KeyPoints and cuts them with our targets. Both augment "
    f"as the paper does. Batches: the loader of `yolino train` with batches of {BATCH} and a process per "
    f"core over {_FILES} such files, which the system holds in memory; then with `data.cache`, filled. "
    "Nothing is trained meanwhile."
)


def measure(setup: Setup) -> Section:
    """Times both, our own default augmentation, and whole batches."""
    return Section("JPEG file to training tensor", ABOUT, {**_single(setup), **_batches(setup)})


def _single(setup: Setup) -> dict[str, Measure]:
    """Times one image at a time, on one core."""
    sample, grid = _sample(setup, setup.jpeg), Grid(SIZE, STRIDE)
    lanes = sample.polylines
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
    return {
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


def _batches(setup: Setup) -> dict[str, Measure]:
    """Counts the images per second of the loader that trains, without and with the cache."""
    files = jpeg_files(setup)
    turns = {
        (preset, cached): partial(
            _rate, jpeg_batches(setup, files, preset, batch=2 if setup.quick else BATCH, cached=cached)
        )
        for cached in (False, True)
        for preset in _TITLES
    }
    rounds = 1 if setup.quick else 3
    epochs = [{key: turn() for key, turn in turns.items()} for _ in range(1 + rounds)]
    rates = {key: [epoch[key] for epoch in epochs[1:]] for key in turns}  # the first one starts processes
    return {
        f"{preset}{'_cached' if cached else ''}_rate": _images_per_second(
            f"batches, {_TITLES[preset]}{', data.cache' if cached else ''}", values
        )
        for (preset, cached), values in rates.items()
    }


def jpeg_files(setup: Setup) -> list[Path]:
    """Gives copies of the frame as JPEG files."""
    files = [setup.folder / f"frame_{number}.jpg" for number in range(4 if setup.quick else _FILES)]
    for file in files:
        shutil.copyfile(setup.jpeg, file)
    return files


def jpeg_batches(
    setup: Setup,
    files: list[Path],
    preset: str,
    *,
    batch: int,
    cached: bool = False,
    workers: int | None = None,
    cuda: bool = False,
) -> Batches:
    """Gives the loader that `yolino train` has, over files with five lanes each.

    Args:
        setup: How to measure.
        files: The images.
        preset: Name of the augmentation.
        batch: Images per batch.
        cached: Whether decoded pixels are kept.
        workers: Processes that load; one per thread by default.
        cuda: Whether they go to a GPU.
    """
    workers = setup.threads if workers is None else workers
    frames = CachedFrames(PixelCache(setup.folder / "decoded"), SIZE, "bottom") if cached else Frames()
    examples = Examples(
        [_Listed([_sample(setup, file) for file in files])],
        [1.0],
        Augment(SIZE, frames=frames, **PRESETS[preset]),
        Grid(SIZE, STRIDE),
        border=False,
    )
    count = (1 + (2 if setup.quick else _BATCHES)) * max(workers, 1) * batch
    options = loader_options(workers, cuda=cuda)
    return Batches(examples, batch_size=batch, sampler=EndlessSampler(count, lambda: (0, 0, 1)), **options)


class _Listed(list[Sample]):
    """A dataset of given samples."""

    classes: tuple[str, ...] = ("line",)
    directed = True


def _sample(setup: Setup, file: Path) -> Sample:
    size = (setup.frame.shape[0], setup.frame.shape[1])
    return Sample("frame", file, converging_lanes(setup.rng, size, _LANES, nearest=0.08))


def _rate(batches: Batches) -> float:
    """Gives the images per second of an epoch, from when each process has delivered its first batch."""
    first = max(batches.num_workers, 1)
    done: Iterator[float] = (perf_counter() for _ in batches)
    times = list(done)
    return (len(times) - first) * int(batches.batch_size or 1) / (times[-1] - times[first - 1])


def _images_per_second(title: str, rates: list[float]) -> Measure:
    low, middle, high = (float(q) for q in np.quantile(rates, (0.25, 0.5, 0.75)))
    return Measure(title, middle, "images/s", low, high, at_least(250))


class _Loader:
    """What `yolino train` does with one sample."""

    def __init__(self, preset: str, sample: Sample, grid: Grid) -> None:
        self._augment = Augment(SIZE, **PRESETS[preset])
        self._sample, self._grid, self._rng = sample, grid, np.random.default_rng(0)

    def __call__(self) -> tuple[UInt8[Tensor, "3 h w"], CellTargets]:
        image, polylines, ignore = self._augment(self._sample, self._rng)
        targets = cell_targets(polylines, self._grid, border=False, ignore=ignore)
        return torch.from_numpy(image).permute(2, 0, 1), targets


__all__ = ["BATCH", "jpeg_batches", "jpeg_files", "measure"]
