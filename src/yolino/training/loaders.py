"""From an experiment file to the loaders of its training and validation batches."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from time import perf_counter
from typing import Any

import cv2
import torch
from torch.utils.data import DataLoader

from yolino.config import Experiment, Source
from yolino.datasets import Dataset, Synthetic
from yolino.grid import Grid
from yolino.training.augment import Augment
from yolino.training.cache import PixelCache, expected
from yolino.training.data import (
    Batch,
    EndlessSampler,
    Examples,
    build_augment,
    build_dataset,
    collate_examples,
)
from yolino.training.frames import CachedFrames, Frames
from yolino.training.scenes import KeptScenes
from yolino.training.windows import Windows

CACHE = "decoded"  # folder of the decoded images and drawn scenes, which all experiments share


class Batches(DataLoader[Any]):
    """Loads batches, and takes the time that whoever asks for them waits.

    Attributes:
        waited: Seconds so far.
    """

    waited = 0.0

    def __iter__(self) -> Iterator[Batch]:  # type: ignore[override]
        """Gives the batches of an epoch."""
        batches = super().__iter__()
        while True:
            start = perf_counter()
            try:
                batch: Batch = next(batches)
            except StopIteration:
                return
            finally:
                self.waited += perf_counter() - start
            yield batch


def loader_options(workers: int, *, cuda: bool) -> dict[str, Any]:
    """Gives how a `DataLoader` loads examples for training.

    Args:
        workers: Processes that load; 0 loads in this one.
        cuda: Whether batches go to a GPU: from pinned memory they are copied while it computes.
    """
    return {
        "collate_fn": collate_examples,
        "num_workers": workers,
        "persistent_workers": workers > 0,
        "worker_init_fn": _single_thread,
        "pin_memory": cuda,
    }


def trains_on_cuda(experiment: Experiment) -> bool:
    """Tells whether Lightning will choose a CUDA device."""
    return experiment.training.accelerator in ("auto", "gpu", "cuda") and torch.cuda.is_available()


def build_examples(
    experiment: Experiment,
    sources: Sequence[Source],
    augment: Augment,
    *,
    border: bool,
    mixed: bool,
    skip_broken: bool = False,
) -> Examples:
    """Gives the examples of the sources: mixed by weight for training, one after the other for validation."""
    data, split = experiment.data, "train" if mixed else "val"
    datasets: list[Dataset] = [
        build_dataset(source, data.root, data.classes, split=split, skip_broken=skip_broken)
        for source in sources
    ]
    if data.cache or data.fit == "window":
        folder = experiment.out / CACHE
        datasets = [KeptScenes(one, folder) if isinstance(one, Synthetic) else one for one in datasets]
    if data.fit == "window":
        cache = PixelCache(experiment.out / CACHE)
        datasets = [Windows(dataset, data.size, scale=data.scale, cache=cache) for dataset in datasets]
    return Examples(
        datasets,
        [source.weight for source in sources] if mixed else None,
        augment,
        Grid(data.size, 32 >> experiment.model.upsample),
        border=border,
        classes=data.classes,
        seed=experiment.training.seed,
    )


def build_loaders(
    experiment: Experiment,
    *,
    border: bool,
    place: Callable[[], tuple[int, int, int]] = lambda: (0, 0, 1),
    skip_broken: bool = False,
) -> tuple[Batches, DataLoader[Batch]]:
    """Gives the training and the validation loader.

    Args:
        experiment: The experiment file.
        border: Whether segments must end on the borders of the cells.
        place: Tells the steps done when an epoch begins, the number of this process and of all processes.
        skip_broken: Whether to leave out labels that cannot be read.
    """

    def examples_done() -> tuple[int, int, int]:
        steps, rank, processes = place()
        return steps * experiment.training.batch_size, rank, processes

    data, training = experiment.data, experiment.training
    frames = _frames(experiment)
    augment = build_augment(experiment.augment, data.size, data.fit, frames=frames)
    plain = Augment(data.size, fit=data.fit, frames=frames)
    how: dict[str, Any] = {"border": border, "skip_broken": skip_broken}
    train = build_examples(experiment, data.train, augment, mixed=True, **how)
    val = build_examples(experiment, data.val, plain, mixed=False, **how)
    _prepare_cache(
        PixelCache(experiment.out / CACHE), frames, [*_draws(experiment, train), *_draws(None, val)]
    )
    sampler = EndlessSampler(training.validate_every * training.batch_size, examples_done)
    options = loader_options(training.workers, cuda=trains_on_cuda(experiment))
    return (
        Batches(train, batch_size=training.batch_size, sampler=sampler, **options),
        DataLoader[Any](val, batch_size=training.batch_size, shuffle=False, collate_fn=collate_examples),
    )


def _frames(experiment: Experiment) -> Frames:
    data = experiment.data
    if data.fit == "window" or not data.cache:
        return Frames()
    return CachedFrames(PixelCache(experiment.out / CACHE), data.size, data.fit)


def _draws(experiment: Experiment | None, examples: Examples) -> list[tuple[Dataset, int]]:
    """Gives each dataset with how many samples one process draws from it; all of them without experiment."""
    if experiment is None or examples.shares is None:
        return [(dataset, len(dataset)) for dataset in examples.datasets]
    images = experiment.training.steps * experiment.training.batch_size * (1 + examples.augment.mosaic)
    counts = [math.ceil(images * share) for share in examples.shares]
    return list(zip(examples.datasets, counts, strict=True))


def _prepare_cache(cache: PixelCache, frames: Frames, datasets: Sequence[tuple[Dataset, int]]) -> None:
    """Says what decoded images and drawn scenes will take, before any is written; nothing where none will be.

    Args:
        cache: Where they are kept.
        frames: Where the images of datasets without windows come from.
        datasets: The datasets, and how many samples are drawn from each.

    Raises:
        OSError: They cannot be written, or do not fit on the disk.
    """
    total = missing = 0
    for dataset, draws in datasets:
        whole = dataset.dataset if isinstance(dataset, Windows) else dataset
        if isinstance(whole, KeptScenes):
            found = whole.expected(len(whole) if isinstance(dataset, Windows) else draws)
        elif isinstance(dataset, Windows):
            found = expected(whole, dataset.pixels.bytes_of)
        elif isinstance(frames, CachedFrames):
            found = expected(whole, frames.bytes_of)
        else:
            continue
        total, missing = total + found[0], missing + found[1]
    if total:
        cache.check_writable()
        cache.check_space(total, missing)


def _single_thread(worker: int) -> None:
    """Keeps OpenCV's threads of several workers from fighting for the same cores."""
    cv2.setNumThreads(0)


__all__ = ["CACHE", "Batches", "build_examples", "build_loaders", "loader_options", "trains_on_cuda"]
