"""Splits of a dataset: whole groups of images, so that nothing leaks from one split to another."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import zip_longest
from math import isfinite
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory

import numpy as np
import yaml

from yolino.datasets.description import Description
from yolino.datasets.files import listed_names
from yolino.datasets.grouping import group_names
from yolino.io import write_atomic

_TOLERANCE = 0.10
"""How far the share of a split may be off for a level of folders to be chosen."""


def split(
    names: Sequence[str], shares: Mapping[str, float | int], by: str = "auto", seed: int = 0
) -> dict[str, list[str]]:
    """Gives the images of each split: whole groups, their numbers of images as near to the shares as may be.

    The largest group goes first, to the split that lacks most images, and no split stays empty. Among groups
    of one size the seed decides.

    Args:
        names: Names of the images.
        shares: Share of each split; they are scaled to a sum of 1.
        by: What a group is, as in `group_names`; `auto`: what `choose_level` gives.
        seed: Seed of the order of equally large groups.

    Returns:
        The names of each split, in their order.

    Raises:
        ValueError: A name occurs twice, a share is not positive, or there are fewer groups than splits.
    """
    targets = _targets(names, shares)
    if by == "auto":
        by = choose_level(names, shares, seed)
    groups = group_names(names, by)
    sizes = Counter(groups)
    if len(sizes) < len(targets):
        raise ValueError(
            f"There are {len(sizes)} groups of images by {by!r} for {len(targets)} splits: "
            "group by something finer, like folder or image, or make fewer splits."
        )
    split_of = _assign(sizes, targets, np.random.default_rng(seed))
    found: dict[str, list[str]] = {name: [] for name in targets}
    for name, group in zip(names, groups, strict=True):
        found[split_of[group]].append(name)
    return found


def choose_level(names: Sequence[str], shares: Mapping[str, float | int], seed: int = 0) -> str:
    """Gives the coarsest grouping that works: a number of folders from the root, or else `image`.

    It works where every split gets images and no share is off by more than 10 points.

    Args:
        names: Names of the images.
        shares: Share of each split.
        seed: Seed of the order of equally large groups.
    """
    targets = _targets(names, shares)
    deepest = max(len(PurePosixPath(name.lstrip("/")).parts) for name in names) - 1
    for depth in range(1, deepest + 1):
        sizes = Counter(group_names(names, str(depth)))
        if len(sizes) >= len(targets):
            reached = Counter[str]()
            for group, one in _assign(sizes, targets, np.random.default_rng(seed)).items():
                reached[one] += sizes[group]
            if all(abs(reached[one] - targets[one]) <= _TOLERANCE * len(names) for one in targets):
                return str(depth)
    return "image"


def _targets(names: Sequence[str], shares: Mapping[str, float | int]) -> dict[str, float]:
    """Gives the number of images that each split should have."""
    if not names:
        raise ValueError("There are no images to split.")
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise ValueError(f"There are several images of the name {twice[0]}: a list cannot tell them apart.")
    wrong = [f"{name}={share}" for name, share in shares.items() if not (isfinite(share) and share > 0)]
    if wrong or not shares:
        raise ValueError(f"Shares must be positive numbers, got {', '.join(wrong) or 'none'}.")
    total = sum(shares.values())
    return {name: len(names) * share / total for name, share in shares.items()}


def _assign(
    sizes: Mapping[str, int], targets: Mapping[str, float], generator: np.random.Generator
) -> dict[str, str]:
    """Gives the split of each group."""
    groups = sorted(sizes)
    shuffled = [groups[i] for i in generator.permutation(len(groups))]
    lacking, empty, found = dict(targets), set(targets), dict[str, str]()
    for place, group in enumerate(sorted(shuffled, key=lambda one: -sizes[one])):
        left = len(groups) - place
        choices = [name for name in targets if name in empty or left > len(empty)]
        chosen = max(choices, key=lambda name: lacking[name])
        found[group] = chosen
        lacking[chosen] -= sizes[group]
        empty.discard(chosen)
    return found


def write_splits(
    out: Path, description: Description, splits: Mapping[str, Sequence[str]], *, force: bool = False
) -> Path:
    """Writes a list of names for each split, and a data.yaml: the description with these splits.

    Args:
        out: The folder; it is made if need be.
        description: The dataset; its splits of other names stay.
        splits: The names of the images of each split.
        force: Whether to replace files that are there.

    Returns:
        The data.yaml.

    Raises:
        ValueError: A split or an image has a name that cannot be written.
        FileExistsError: A file is there already.
    """
    lists = {name: out / f"{name}.txt" for name in splits}
    file = out / "data.yaml"
    for name, names in splits.items():
        _check_name(name)
        _check_listable(names)
    there = [path for path in (*lists.values(), file) if path.exists()]
    if there and not force:
        raise FileExistsError(
            f"{there[0]} is there already: choose another folder (--out), or replace it (--force)."
        )
    for name, names in splits.items():
        write_atomic(lists[name], "".join(f"{one}\n" for one in names))
    # Both as they really are, so that ".." leads where it should even through links.
    root, folder = os.path.realpath(description.root), os.path.realpath(out)
    changed = description.model_copy(
        update={
            "root": Path(os.path.relpath(root, folder)),
            "splits": {
                **description.splits,
                **{
                    name: Path(os.path.relpath(os.path.join(folder, path.name), root)).as_posix()
                    for name, path in lists.items()
                },
            },
        }
    )
    values = changed.model_dump(mode="json", exclude_defaults=True)
    values |= {"root": changed.root.as_posix()}
    order = {"format": changed.format, "root": changed.root.as_posix()}
    write_atomic(file, yaml.safe_dump({**order, **values}, sort_keys=False, allow_unicode=True))
    return file


def _check_name(split: str) -> None:
    if not re.fullmatch(r"\w[\w.-]*", split):
        raise ValueError(
            f"{split!r} is no name of a split: use letters, digits, _, - and points, like train."
        )


def _check_listable(names: Sequence[str]) -> None:
    """Raises where a list would not be read as it was written."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "names.txt"
        path.write_text("".join(f"{name}\n" for name in names), encoding="utf-8")
        read = [name for _, name in listed_names(path)]
    for name, found in zip_longest(names, read):
        if name != found:
            raise ValueError(
                f"A list cannot hold the name {name!r}: it would be read as {found!r}; rename it."
            )


__all__ = ["choose_level", "split", "write_splits"]
