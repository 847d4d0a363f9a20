"""What one split of a dataset knows of another: the same images, nearly the same ones, the same clips.

Images are compared by a difference hash: the image, gray and 17 x 16 small, says for each pixel whether its
right neighbor is brighter (256 bits). What compression, size, brightness, noise and shifts of a few pixels
change is within `NEAR_BITS`; frames of other drives are far beyond (measured in docs/datasets.md). Where an
image is all but empty the bits say little, so the small images must also correlate.
"""

from __future__ import annotations

import hashlib
import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Int, UInt8

from yolino.datasets.grouping import group_names
from yolino.datasets.report import Finding, Picture
from yolino.io import read_image

LEAKS = {
    "same name": "an image of this name is in both splits",
    "same file": "image files of equal content are in both splits",
    "near-identical image": "images that look nearly the same are in both splits",
    "same group": "images of one clip or folder are in both splits",
}
LEAK_ERRORS = frozenset({"same name", "same file"})
"""Kinds that make scores worthless; the others are notices: look at them."""
NEAR_BITS = 32
"""So many of the 256 bits may differ in nearly identical images."""
ALIKE = 0.9
"""So much must small gray images correlate in nearly identical images."""
_ROWS, _COLS = 16, 17
_BLOCK = 2**24  # pairs that are compared at once
_WORKERS = 4


@dataclass(frozen=True, slots=True)
class Leak:
    """Something that is in two splits.

    Attributes:
        kind: A key of `LEAKS`.
        splits: The two splits.
        samples: An image of each.
        detail: What they have in common.
    """

    kind: str
    splits: tuple[str, str]
    samples: tuple[str, str]
    detail: str


class Comparison(NamedTuple):
    """What comparing splits gave.

    Attributes:
        leaks: What was found: at most one image, and one group, for each image of the later split.
        unreadable: Images that cannot be decoded, by split; they are not compared.
        collections: Splits that are several others together; they are not compared.
    """

    leaks: tuple[Leak, ...]
    unreadable: tuple[tuple[str, Finding], ...]
    collections: tuple[str, ...]

    @property
    def errors(self) -> tuple[Leak, ...]:
        """The leaks of the kinds in `LEAK_ERRORS`."""
        return tuple(leak for leak in self.leaks if leak.kind in LEAK_ERRORS)

    @property
    def counts(self) -> dict[str, int]:
        """Number of leaks of each kind that was found."""
        counts = Counter(leak.kind for leak in self.leaks)
        return {kind: counts[kind] for kind in LEAKS if counts[kind]}


def find_leaks(
    splits: Mapping[str, Sequence[Picture]],
    *,
    by: str = "auto",
    decode: bool = True,
    progress: Callable[[Sequence[int]], Iterable[int]] = iter,
) -> Comparison:
    """Gives what the splits of a dataset have in common.

    A split that consists of two or more of the others (`trainval`) is not compared. Images that do not exist
    are compared by name only.

    Args:
        splits: The images of each split.
        by: What must not be in two splits, as in `group_names`.
        decode: Whether to look at the pixels, for nearly identical images: milliseconds for each.
        progress: Wraps the indices of the images that are decoded, to show a progress bar.

    Raises:
        ValueError: `by` is wrong.
    """
    collections = _collections({name: {one.name for one in split} for name, split in splits.items()})
    compared = {name: split for name, split in splits.items() if name not in collections}
    pairs = list(combinations(compared.items(), 2))
    named = (one.file for split in compared.values() for one in split if one.file is not None)
    files = [file for file in dict.fromkeys(named) if file.is_file()] if pairs else []
    contents, looks = _contents(files), _look_at(files if decode else [], progress)
    found: list[Leak] = []
    for (a, in_a), (b, in_b) in pairs:
        found += _images_in_common((a, b), (in_a, in_b), contents, looks)
        found += _groups_in_common((a, b), (in_a, in_b), by)
    unreadable = tuple(
        (name, Finding("unreadable image", one.name, looks.problems[one.file]))
        for name, split in compared.items()
        for one in split
        if one.file in looks.problems
    )
    return Comparison(tuple(found), unreadable, collections)


def _collections(names: Mapping[str, set[str]]) -> tuple[str, ...]:
    """Gives the splits that are several of the others together."""
    found = []
    for split, own in names.items():
        parts = [other for other in names.values() if other < own]
        if parts and set().union(*parts) == own:
            found.append(split)
    return tuple(found)


def _contents(files: Sequence[Path]) -> dict[Path, bytes]:
    """Gives a digest of each file that has the size of another one."""
    sizes = {file: file.stat().st_size for file in files}
    counts = Counter(sizes.values())
    return {
        file: hashlib.blake2b(file.read_bytes(), digest_size=16).digest()
        for file, size in sizes.items()
        if counts[size] > 1
    }


class _Looks(NamedTuple):
    """What images look like, a row for each that could be decoded, and why the others could not."""

    rows: Mapping[Path | None, int]
    bits: UInt8[np.ndarray, "n 256"]
    grays: UInt8[np.ndarray, "n 272"]
    problems: Mapping[Path | None, str]


def fingerprint(
    image: UInt8[np.ndarray, "h w 3"],
) -> tuple[UInt8[np.ndarray, " 256"], UInt8[np.ndarray, " 272"]]:
    """Gives the difference hash of an image, bit by bit, and the small gray image that it was made from."""
    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    small = np.asarray(cv2.resize(gray, (_COLS, _ROWS), interpolation=cv2.INTER_AREA))
    return (small[:, 1:] > small[:, :-1]).astype(np.uint8).ravel(), small.ravel()


def _look_at(files: Sequence[Path], progress: Callable[[Sequence[int]], Iterable[int]]) -> _Looks:
    rows, problems = dict[Path | None, int](), dict[Path | None, str]()
    seen: list[tuple[UInt8[np.ndarray, " 256"], UInt8[np.ndarray, " 272"]]] = []
    # The threads quiet OpenCV, each for itself, and may restore the level in the wrong order.
    level = cv2.utils.logging.getLogLevel()
    try:
        with ThreadPoolExecutor(min(_WORKERS, os.cpu_count() or 1)) as pool:
            looks = pool.map(_look, files)
            for i in progress(range(len(files))):
                look = next(looks)
                if isinstance(look, str):
                    problems[files[i]] = look
                else:
                    rows[files[i]] = len(seen)
                    seen.append(look)
    finally:
        cv2.utils.logging.setLogLevel(level)
    bits = np.array([look[0] for look in seen], np.uint8).reshape(len(seen), _ROWS * (_COLS - 1))
    grays = np.array([look[1] for look in seen], np.uint8).reshape(len(seen), _ROWS * _COLS)
    return _Looks(rows, bits, grays, problems)


def _look(file: Path) -> tuple[UInt8[np.ndarray, " 256"], UInt8[np.ndarray, " 272"]] | str:
    """Gives the fingerprint of an image file, or why there is none."""
    try:
        image = read_image(file, reduce=8)
        if min(image.shape[:2]) < _COLS:
            image = read_image(file)
    except (ValueError, OSError) as error:
        return str(error)
    return fingerprint(image)


def _images_in_common(
    splits: tuple[str, str],
    pictures: tuple[Sequence[Picture], Sequence[Picture]],
    contents: Mapping[Path, bytes],
    looks: _Looks,
) -> Iterator[Leak]:
    """Yields the images of the second split that are in the first: by name, by content, by their look."""
    first, second = pictures
    names = {one.name for one in first}
    held = {contents.get(one.file, one.file): one.name for one in first if one.file is not None}
    rest: list[Picture] = []
    for one in second:
        if one.name in names:
            yield Leak("same name", splits, (one.name, one.name), str(one.file or ""))
        elif one.file is not None and (key := contents.get(one.file, one.file)) in held:
            yield Leak("same file", splits, (held[key], one.name), str(one.file))
        else:
            rest.append(one)
    yield from _alike(splits, (first, rest), looks)


def _alike(
    splits: tuple[str, str], pictures: tuple[Sequence[Picture], Sequence[Picture]], looks: _Looks
) -> Iterator[Leak]:
    """Yields the images of the second split that look nearly like one of the first."""
    first, second = ([one for one in some if one.file in looks.rows] for some in pictures)
    if not first or not second:
        return
    rows_a, rows_b = (np.array([looks.rows[one.file] for one in some]) for some in (first, second))
    for j, (i, bits) in enumerate(zip(*nearest(looks.bits[rows_a], looks.bits[rows_b]), strict=True)):
        alike = correlation(looks.grays[rows_a[i]], looks.grays[rows_b[j]])
        if bits <= NEAR_BITS and alike >= ALIKE:
            detail = f"{bits} of {looks.bits.shape[1]} bits differ, correlation {alike:.2f}"
            yield Leak("near-identical image", splits, (first[i].name, second[j].name), detail)


def nearest(
    first: UInt8[np.ndarray, "n bits"], second: UInt8[np.ndarray, "m bits"]
) -> tuple[Int[np.ndarray, " m"], Int[np.ndarray, " m"]]:
    """Gives for each row of the second the row of the first with fewest different bits, and their number."""
    signs = first.astype(np.float32) * 2 - 1
    places, distances = [], []
    rows = max(_BLOCK // len(first), 1)
    for i in range(0, len(second), rows):
        agreement = (second[i : i + rows].astype(np.float32) * 2 - 1) @ signs.T
        places.append(agreement.argmax(axis=1))
        distances.append((first.shape[1] - agreement.max(axis=1)) / 2)
    return np.concatenate(places), np.concatenate(distances).astype(np.int64)


def correlation(a: UInt8[np.ndarray, " n"], b: UInt8[np.ndarray, " n"]) -> float:
    """Gives the correlation of two images' pixels; 0 where one of them is of one color."""
    x, y = (one.astype(np.float64) - one.mean() for one in (a, b))
    scale = float(np.sqrt((x**2).sum() * (y**2).sum()))
    return float((x * y).sum()) / scale if scale > 0 else 0.0


def _groups_in_common(
    splits: tuple[str, str], pictures: tuple[Sequence[Picture], Sequence[Picture]], by: str
) -> Iterator[Leak]:
    """Yields the groups of which both splits have images; an image that is a group for itself is none."""
    held: list[dict[str, list[str]]] = []
    for some in pictures:
        names = [one.name for one in some]
        groups: dict[str, list[str]] = {}
        for name, group in zip(names, group_names(names, by), strict=True):
            if group != name:
                groups.setdefault(group, []).append(name)
        held.append(groups)
    first, second = held
    for group, names in second.items():
        if group in first:
            counted = f"{len(first[group])} images in {splits[0]}, {len(names)} in {splits[1]}"
            yield Leak("same group", splits, (first[group][0], names[0]), f"{group}: {counted}")


__all__ = [
    "ALIKE",
    "LEAKS",
    "LEAK_ERRORS",
    "NEAR_BITS",
    "Comparison",
    "Leak",
    "correlation",
    "find_leaks",
    "fingerprint",
    "nearest",
]
