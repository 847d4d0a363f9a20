"""`yolino datasets split`: lists of images for training, validation and test that know nothing of another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from yolino.cli.options import Data, DatasetName, Labels, More, Root, SkipBroken, Split

if TYPE_CHECKING:
    from yolino.cli.labels import Selection
    from yolino.datasets import Dataset
    from yolino.datasets.description import Description
    from yolino.datasets.report import Picture

EPILOG = """
**Examples**

- `yolino datasets split --data drive --shares train=0.8,val=0.1,test=0.1 --out drive_splits`
  keeps folders together, as coarse ones as the shares allow

- `yolino datasets split --dataset labelme --root photos --by "regex:/([a-z]+)" --out photos`
  keeps images together whose names begin with the same letters
"""


def add_to(group: typer.Typer) -> None:
    """Adds the command."""
    group.command("split", epilog=EPILOG)(split_dataset)


def split_dataset(
    *,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for lists and data.yaml.")],
    shares: Annotated[
        str, typer.Option("--shares", metavar="NAME=SHARE,...", help="Splits and how much each gets.")
    ] = "train=0.8,val=0.2",
    by: Annotated[
        str,
        typer.Option(
            "--by",
            metavar="auto|image|folder|N|regex:...",
            help="What stays together: images of a folder, of the same first N folders (driver, drive), or "
            "of the same first group of an expression; auto: the coarsest folders that allow the shares.",
        ),
    ] = "auto",
    seed: Annotated[int, typer.Option("--seed", min=0, help="Decides among equally large groups.")] = 0,
    data: Data = None,
    split: Split = None,
    dataset: DatasetName = None,
    root: Root = None,
    labels: Labels = None,
    option: More = None,
    skip_broken: SkipBroken = False,
    force: Annotated[bool, typer.Option("--force", help="Replace lists that are there.")] = False,
    leak_check: Annotated[
        bool, typer.Option("--leak-check/--no-leak-check", help="Look for nearly identical images.")
    ] = True,
) -> None:
    """Split a dataset (or --split of it) by clips, drives or regions, so that nothing leaks."""
    from yolino.cli.labels import Selection, open_or_tell
    from yolino.cli.screen import track
    from yolino.datasets.split import choose_level, write_splits
    from yolino.datasets.split import split as run

    selection = Selection(data, split, dataset, root, labels or (), option or (), skip_broken)
    wanted = _shares(shares)
    description = _description(selection, wanted)
    samples = open_or_tell(selection)
    pictures, counts = _count(samples, track(range(len(samples)), "counting"))
    names = [one.name for one in pictures]
    level = choose_level(names, wanted, seed) if by == "auto" else by
    splits = run(names, wanted, level, seed)
    file = write_splits(out, description, splits, force=force)
    _print(splits, level, counts, samples.classes)
    typer.echo(f"{', '.join(f'{name}.txt' for name in splits)} and data.yaml are in {file.parent}.")
    if leak_check:
        _warn(splits, {one.name: one for one in pictures}, level)


def _shares(text: str) -> dict[str, float]:
    found: dict[str, float] = {}
    for part in text.split(","):
        name, _, value = (piece.strip() for piece in part.partition("="))
        try:
            share = float(value)
        except ValueError:
            share = 0.0
        if not name or name in found or not 0 < share < float("inf"):
            raise ValueError(
                f"--shares is {text!r}; name each split once with a share above 0, like train=0.8,val=0.2."
            )
        found[name] = share
    return found


def _description(selection: Selection, wanted: Mapping[str, float]) -> Description:
    """Gives the description of what is split, without the splits that are made anew."""
    from yolino.cli.labels import parse_option
    from yolino.datasets.description import Description, arguments_of, load_description

    if selection.data is not None:
        found = load_description(selection.data)
    else:
        found = Description(format=selection.dataset or "tusimple", root=selection.root or Path())
    if "names" not in arguments_of(found.format):
        raise ValueError(f"The format {found.format!r} has no label files: there is nothing to split.")
    options: dict[str, Any] = {**found.options, **dict(map(parse_option, selection.options))}
    if selection.labels:
        options["labels"] = [_below(path, found.root) for path in selection.labels]
    options.pop("names", None)  # the lists of the splits take its place
    splits = dict(found.splits) if selection.split is not None else {}
    splits.pop(selection.split or "", None)
    if twice := [name for name in wanted if name in splits]:
        raise ValueError(
            f"There is a split {twice[0]} already: name the parts of {selection.split} otherwise."
        )
    return found.model_copy(update={"options": options, "splits": splits})


def _below(path: Path, root: Path) -> str:
    """Gives a path as it is named from the root."""
    import os

    return Path(os.path.relpath(path, root)).as_posix() if path.exists() else path.as_posix()


def _count(samples: Dataset, indices: Any) -> tuple[list[Picture], Mapping[str, Mapping[int, int]]]:
    """Gives the image of each sample, and by its name the number of its polylines of each label."""
    from collections import Counter

    from yolino.datasets.report import Picture

    pictures: list[Picture] = []
    counts: dict[str, Mapping[int, int]] = {}
    for index in indices:
        sample = samples[index]
        pictures.append(Picture(sample.name, sample.image if isinstance(sample.image, Path) else None))
        counts[sample.name] = Counter(sample.polylines.labels.tolist())
    return pictures, counts


def _print(
    splits: Mapping[str, Sequence[str]],
    level: str,
    counts: Mapping[str, Mapping[int, int]],
    classes: Sequence[str],
) -> None:
    from collections import Counter

    from yolino.cli.screen import print_table
    from yolino.datasets.grouping import group_names

    total = sum(map(len, splits.values()))
    groups = {name: list(dict.fromkeys(group_names(names, level))) for name, names in splits.items()}
    rows, of_class = [], {}
    for name, names in splits.items():
        labels = Counter[int]()
        for one in names:
            labels.update(counts[one])
        rows.append((name, len(names), f"{len(names) / total:.1%}", len(groups[name]), labels.total()))
        of_class[name] = labels
    title = f"Split by {_words(level)}, e.g. {next(iter(groups.values()))[0]}"
    print_table(("split", "images", "share", "groups", "polylines"), rows, title=title)
    if len(classes) > 1:
        table = [(kind, *(of_class[name][i] for name in splits)) for i, kind in enumerate(classes)]
        print_table(("polylines of class", *splits), table)


def _words(level: str) -> str:
    if level.isdecimal():
        return "the first folder" if level == "1" else f"the first {level} folders"
    return level


def _warn(splits: Mapping[str, Sequence[str]], pictures: Mapping[str, Picture], level: str) -> None:
    """Says on stderr what the new splits have in common all the same."""
    from yolino.cli.screen import track
    from yolino.datasets.leaks import LEAKS, find_leaks

    found = find_leaks(
        {name: [pictures[one] for one in names] for name, names in splits.items()},
        by="auto" if level == "image" else "image",
        progress=lambda indices: track(indices, "comparing images"),
    )
    for kind, count in found.counts.items():
        leak = next(one for one in found.leaks if one.kind == kind)
        both = " and ".join(
            f"{name} ({split})" for split, name in zip(leak.splits, leak.samples, strict=True)
        )
        times = f"{count} time{'s' * (count > 1)}"
        typer.echo(f"Warning: {LEAKS[kind]}, {times}: {both}. Try a coarser --by.", err=True)
    for split, finding in found.unreadable:
        typer.echo(f"Warning: {finding.detail} It is in {split}.", err=True)


__all__ = ["add_to", "split_dataset"]
