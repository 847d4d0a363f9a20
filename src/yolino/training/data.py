"""From datasets to batches: sources are mixed, augmented and cut into cells."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import UInt8
from torch import Tensor
from torch.utils.data import Dataset, Sampler

from yolino.config import Augmentation, Source, check_keys
from yolino.datasets import Dataset as Annotated
from yolino.datasets import FileDataset
from yolino.datasets.description import (
    Description,
    arguments_of,
    build,
    load_description,
    open_split,
)
from yolino.grid import Grid
from yolino.training.augment import GROUPS, PRESETS, Augment, Augmented
from yolino.training.frames import Frames
from yolino.training.mosaic import join_images
from yolino.training.targets import CellTargets, Targets, cell_targets, collate
from yolino.training.windows import Windows
from yolino.types import Polylines, Sample

logger = logging.getLogger(__name__)


class Example(NamedTuple):
    """One image of a batch, in the network frame."""

    image: UInt8[np.ndarray, "h w 3"]
    targets: CellTargets
    polylines: Polylines
    ignore: tuple[np.ndarray, ...]


class Batch(NamedTuple):
    """What a training step takes: `images` are RGB pixels 0..255."""

    images: UInt8[Tensor, "b 3 h w"]
    targets: Targets
    polylines: tuple[Polylines, ...]
    ignore: tuple[tuple[np.ndarray, ...], ...]


def build_dataset(
    source: Source, root: Path, classes: Sequence[str], *, split: str = "train", skip_broken: bool = False
) -> Annotated:
    """Gives the dataset of a source; its labels become those of `classes`.

    Args:
        source: The source.
        root: Folder that holds the datasets.
        classes: Classes that the dataset must have.
        split: Split to take where the source names a description and no split.
        skip_broken: Whether to leave out what cannot be read.

    Raises:
        ValueError: The dataset is unknown or empty, its options are wrong, or it lacks the classes.
        FileNotFoundError: Its files are not there.
    """
    options: dict[str, Any] = dict(source.options)
    if "root" in options:
        options["root"] = root / options["root"]
    description = describe(source, root)
    format, name = source.dataset or "", repr(source.dataset)
    if description is not None:
        format, name = description.format, str(source.data)
    if skip_broken and "skip_broken" in arguments_of(format):
        options["skip_broken"] = True
    if description is None:
        dataset = build(format, options)
    else:
        dataset = open_split(description, source.split or split, **options)
    if isinstance(dataset, FileDataset) and dataset.broken:
        logger.warning(
            "%s: %d broken parts left out, first: %s", name, len(dataset.broken), dataset.broken[0]
        )
    if not len(dataset):
        raise ValueError(f"The dataset {name} with {source.options} has no samples.")
    missing = [one for one in classes if one not in dataset.classes]
    if missing:
        raise ValueError(
            f"The dataset {name} has no classes {', '.join(missing)}; it has {', '.join(dataset.classes)}."
        )
    return dataset


def describe(source: Source, root: Path) -> Description | None:
    """Gives the description of the dataset that a source names, or None where it names a format.

    Raises:
        FileNotFoundError: There is no such file or folder.
        ValueError: It is no description.
    """
    if source.data is None:
        return None
    if not source.data.exists() and not (root / source.data).exists():
        raise FileNotFoundError(
            f"There is no data description {source.data} and no {root / source.data}: give a data.yaml or a "
            "folder, from the working directory or below data.root."
        )
    return load_description(source.data if source.data.exists() else root / source.data)


def build_augment(
    augmentation: Augmentation, size: tuple[int, int], fit: str, *, frames: Frames | None = None
) -> Augment:
    """Gives the augmentation of a preset, with `options` replacing single values of its groups.

    Raises:
        ValueError: The preset is unknown or an option does not exist.
    """
    if augmentation.preset not in PRESETS:
        raise ValueError(
            f"augmentation preset {augmentation.preset!r} is unknown; use one of {', '.join(PRESETS)}."
        )
    groups: dict[str, Any] = {name: dict(values) for name, values in PRESETS[augmentation.preset].items()}
    check_keys("augment.options", augmentation.options, [*GROUPS, "mosaic", "fill"])
    for name, changes in augmentation.options.items():
        if name in GROUPS:
            if not isinstance(changes, dict):
                raise ValueError(f"augment.options.{name} is {changes!r}, but must hold keys and values.")
            check_keys(f"augment.options.{name}", changes, [key.name for key in fields(GROUPS[name])])
        groups[name] = {**groups.get(name, {}), **changes} if isinstance(changes, dict) else changes
    try:
        return Augment(size, fit=fit, frames=frames, **groups)
    except TypeError as error:
        raise ValueError(
            f"augment.options do not fit the preset {augmentation.preset!r}: {error}."
        ) from error


class Examples(Dataset[Example]):
    """Augmented examples drawn from several datasets.

    Example i depends on `seed` and i alone, not on any worker.

    Args:
        datasets: Where samples come from.
        weights: Share of each dataset, or None to go through the samples of all once, in order.
        augment: Image and labels -> the network frame.
        grid: The cells.
        border: Whether segments must end on the borders of the cells.
        classes: Names of the classes to learn; without, all labels are 0.
        seed: Seed of the drawing and of the augmentation.
    """

    def __init__(
        self,
        datasets: Sequence[Annotated],
        weights: Sequence[float] | None,
        augment: Augment,
        grid: Grid,
        *,
        border: bool,
        classes: Sequence[str] = (),
        seed: int = 0,
    ) -> None:
        self.datasets, self.augment, self.grid = datasets, augment, grid
        self.border, self.seed = border, seed
        self.shares = None if weights is None else np.asarray(weights) / np.sum(weights)
        self.label_maps = [_label_map(d.classes, classes) for d in datasets]

    def __len__(self) -> int:
        return sum(len(d) for d in self.datasets)

    def __getitem__(self, index: int) -> Example:
        rng = np.random.default_rng([self.seed, index])
        one = self._augmented(*self._pick(index, rng), rng)
        # Without mosaics nothing is drawn, so that older experiments keep their examples.
        if self.augment.mosaic and rng.random() < self.augment.mosaic:
            other = self._augmented(*self._draw(rng), rng)
            one = join_images(*((one, other) if rng.random() < 0.5 else (other, one)), rng)
        targets = cell_targets(one.polylines, self.grid, border=self.border, ignore=one.ignore)
        return Example(one.image, targets, one.polylines, one.ignore)

    def _augmented(self, which: int, sample: Sample, rng: np.random.Generator) -> Augmented:
        """Gives the augmented image of a sample of a dataset, with the labels that are learned."""
        image, polylines, ignore = self.augment(sample, rng, classes=self.datasets[which].classes)
        labels = self.label_maps[which][polylines.labels]
        polylines = Polylines(polylines.vertices, polylines.offsets, polylines.scores, labels)[labels >= 0]
        return Augmented(image, polylines, ignore)

    def _pick(self, index: int, rng: np.random.Generator) -> tuple[int, Sample]:
        """Gives the number of a dataset and one of its samples."""
        if self.shares is None:
            for which, dataset in enumerate(self.datasets):
                if index < len(dataset):
                    return which, dataset[index]
                index -= len(dataset)
            raise IndexError(index)
        return self._draw(rng)

    def _draw(self, rng: np.random.Generator) -> tuple[int, Sample]:
        """Gives the number of a dataset, by its share, and any of its samples."""
        which = int(rng.choice(len(self.datasets), p=self.shares))
        dataset = self.datasets[which]
        if isinstance(dataset, Windows):
            return which, dataset.draw(rng)
        return which, dataset[int(rng.integers(len(dataset)))]


def _label_map(have: Sequence[str], want: Sequence[str]) -> np.ndarray:
    """Gives the new label of each old one; -1 for lines whose class is not to be learned."""
    if not want:
        return np.zeros(max(len(have), 1), np.int64)
    return np.array([list(want).index(name) if name in want else -1 for name in have], np.int64)


class EndlessSampler(Sampler[int]):
    """Numbers the examples of all epochs and processes through.

    So no epoch repeats, and a resumed run goes on with the examples that were next. (Lightning's own count of
    epochs is one too high after a resumption.)

    Args:
        count: Examples per epoch and process.
        place: Tells, when an epoch begins, how many examples each process has consumed, the number of this
            process and that of all processes (Lightning knows them only then).
    """

    def __init__(self, count: int, place: Callable[[], tuple[int, int, int]]) -> None:
        self.count, self.place = count, place

    def __len__(self) -> int:
        return self.count

    def __iter__(self) -> Iterator[int]:
        first, rank, processes = self.place()
        for i in range(first, first + self.count):
            yield i * processes + rank


def collate_examples(examples: Sequence[Example]) -> Batch:
    """Joins examples to a batch."""
    # Stacked as (b, h, w, 3): the permuted view is in the channels_last order that convolutions like.
    images = torch.from_numpy(np.stack([e.image for e in examples])).permute(0, 3, 1, 2)
    return Batch(
        images,
        collate([e.targets for e in examples]),
        tuple(e.polylines for e in examples),
        tuple(e.ignore for e in examples),
    )


def to_device(batch: Batch, device: torch.device) -> Batch:
    """Moves the tensors, from pinned memory without waiting; the polylines stay with the CPU's metrics."""

    def move(value: Any) -> Any:
        return value.to(device, non_blocking=True) if isinstance(value, Tensor) else value

    return batch._replace(images=move(batch.images), targets=Targets(*map(move, batch.targets)))
