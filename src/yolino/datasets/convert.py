"""From one format to another: samples of any dataset into any writer, with their images."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from yolino.datasets.dataset import Dataset
from yolino.datasets.detection import detect_format
from yolino.datasets.files import FileDataset
from yolino.datasets.georeference import sidecars
from yolino.datasets.registry import WRITERS
from yolino.io import image_size, write_atomic, write_image
from yolino.types import Sample

IMAGES = ("link", "copy", "none")
"""What becomes of the images: hard links (copies where the disk cannot), copies, or nothing."""


def convert(
    dataset: Dataset,
    format: str,
    out: Path,
    *,
    images: str = "link",
    force: bool = False,
    facts: Mapping[str, Any] | None = None,
    progress: Callable[[Sequence[int]], Iterable[int]] = iter,
) -> None:
    """Writes a dataset in another format, with its images and a `data.yaml`, so that it can be used at once.

    Images that exist only in memory are always written. What the format cannot hold is lost: see `loses` of
    the entries of `WRITERS`.

    Args:
        dataset: What to write.
        format: Name in `WRITERS`.
        out: Folder to write to; images lie there under the names of their samples.
        images: One of `IMAGES`; with none, the `data.yaml` says where they lie.
        force: Whether to write into a folder that holds labels already.
        facts: More entries of the `data.yaml`: the licence, say.
        progress: Wraps the indices that are looped over, to show a progress bar.

    Raises:
        ValueError: The format or `images` is unknown, the folder holds labels already, or a sample lacks what
            the format needs.
        FileNotFoundError: An image is missing that has to be brought along or measured.
    """
    if format not in WRITERS:
        raise ValueError(f"The format {format!r} cannot be written; use one of {', '.join(WRITERS)}.")
    if images not in IMAGES:
        raise ValueError(f"images is {images!r}; use one of {', '.join(IMAGES)}.")
    if not force and holds_labels(out):
        raise ValueError(f"{out} holds labels already, which would be replaced: choose another folder.")
    with WRITERS[format](out, classes=dataset.classes, directed=dataset.directed) as writer:
        for index in progress(range(len(dataset))):
            sample = dataset[index]
            writer.add(_bring(sample, out, images))
    description: dict[str, Any] = {"format": format, "root": ".", "directed": dataset.directed}
    if len(dataset.classes) > 1 and "classes" not in WRITERS[format].loses:
        description["classes"] = list(dataset.classes)
    if images == "none" and isinstance(dataset, FileDataset):
        description["options"] = {"images": str((dataset.images or dataset.root).resolve())}
    description |= facts or {}
    write_atomic(out / "data.yaml", yaml.safe_dump(description, sort_keys=False, allow_unicode=True))


def holds_labels(folder: Path) -> bool:
    """Gives whether a folder holds labels of a known layout, or a description."""
    if not folder.is_dir():
        return False
    try:
        detect_format(folder)
    except ValueError:
        return any((folder / name).exists() for name in ("data.yaml", "data.yml"))
    return True


def _bring(sample: Sample, out: Path, images: str) -> Sample:
    """Brings the image of a sample into the folder; gives the sample as it will be found there."""
    if not isinstance(sample.image, Path):
        target = out / "images" / f"{sample.name}.png"
        write_image(target, sample.image)
        size = (sample.image.shape[0], sample.image.shape[1])
        return replace(sample, name=target.relative_to(out).as_posix(), image=target, size=size)
    if not sample.image.is_file() and (images != "none" or sample.size is None):
        raise FileNotFoundError(f"There is no image {sample.image}, which {sample.name} needs.")
    known = image_size(sample.image) if sample.image.is_file() else sample.size
    target = out / sample.name
    if images != "none" and not (target.exists() and os.path.samefile(target, sample.image)):
        _transfer(sample.image, target, images)
        for sidecar in sidecars(sample.image):
            _transfer(sidecar, target.with_name(sidecar.name), images)
    return replace(sample, size=known)


def _transfer(source: Path, target: Path, images: str) -> None:
    """Links or copies a file; one that is already there under this name is replaced as a whole."""
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = target.with_name(f".{target.name}.tmp")
    temporary.unlink(missing_ok=True)
    try:
        if images == "link":
            try:
                os.link(os.path.realpath(source), temporary)
            except OSError:  # another disk, or one without links
                shutil.copy2(source, temporary)
        else:
            shutil.copy2(source, temporary)
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


__all__ = ["IMAGES", "convert", "holds_labels"]
