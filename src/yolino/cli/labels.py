"""Labelled datasets as the command line names them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import typer
import yaml

from yolino.datasets import Dataset, FileDataset, TuSimple
from yolino.datasets.description import arguments_of, build, load_description, open_split

SHOWN = 20


class Selection(NamedTuple):
    """What the options of a command say about a dataset: a description, or a format and its arguments.

    Attributes:
        data: A data.yaml or a folder.
        split: A split of it.
        dataset: A name in `DATASETS`.
        root: Folder of the dataset.
        labels: Label files; none means all that the dataset finds.
        options: More arguments of the dataset, each `key=value`.
        skip_broken: Whether broken files are left out.
    """

    data: Path | None = None
    split: str | None = None
    dataset: str | None = None
    root: Path | None = None
    labels: Sequence[Path] = ()
    options: Sequence[str] = ()
    skip_broken: bool = False


def open_dataset(
    selection: Selection, *, classes: Sequence[str] = (), lenient: bool = False, progress: Any = iter
) -> Dataset:
    """Gives the dataset that was selected.

    Args:
        selection: The options of the command.
        classes: Classes of the model that is to be compared; a dataset that knows them is read with them.
        lenient: Whether missing images and broken files are left for a check to find.
        progress: Shows a progress bar while label files are read.

    Raises:
        ValueError: If the dataset is unknown or does not take one of these arguments, or labels are broken.
        FileNotFoundError: If its files do not exist.
    """
    changes: dict[str, Any] = dict(map(parse_option, selection.options))
    if selection.labels:
        changes["labels"] = list(selection.labels)
    if selection.root is not None:
        changes["root"] = selection.root
    if selection.data is not None:
        return _of_description(selection, changes, classes, lenient, progress)
    name = selection.dataset or "tusimple"
    if selection.split is not None:
        raise ValueError("--split needs --data: a format alone has no splits; use --labels.")
    changes |= _reading(name, selection.skip_broken, lenient, progress, set(changes))
    dataset = build(name, changes)
    if classes and isinstance(dataset, TuSimple) and dataset.has_classes and "classes" not in changes:
        return build(name, {**changes, "classes": True})
    return dataset


def _of_description(
    selection: Selection, changes: dict[str, Any], classes: Sequence[str], lenient: bool, progress: Any
) -> Dataset:
    assert selection.data is not None
    if selection.root is not None or selection.dataset is not None:
        raise ValueError("--data names the whole dataset: leave out --dataset and --root.")
    description = load_description(selection.data)
    known = set(changes) | set(description.options)
    changes |= _reading(description.format, selection.skip_broken, lenient, progress, known)
    dataset = open_split(description, selection.split, **changes)
    read_anew = classes and description.classes is None and isinstance(dataset, TuSimple)
    if read_anew and isinstance(dataset, TuSimple) and dataset.has_classes and "classes" not in known:
        return open_split(description, selection.split, **{**changes, "classes": True})
    return dataset


def _reading(format: str, skip_broken: bool, lenient: bool, progress: Any, given: set[str]) -> dict[str, Any]:
    """Gives the arguments that say how to read, as far as the format takes them."""
    known = arguments_of(format)
    wanted: dict[str, Any] = {"progress": progress}
    if skip_broken or lenient:
        wanted["skip_broken"] = True
    if lenient:
        wanted["require_images"] = False
    return {key: value for key, value in wanted.items() if key in known and key not in given}


def open_or_tell(selection: Selection, *, classes: Sequence[str] = ()) -> Dataset:
    """Gives the dataset that was selected; says on stderr what was left out because it is broken."""
    from yolino.cli.screen import counted

    dataset = open_dataset(selection, classes=classes, progress=counted("reading"))
    broken = dataset.broken if isinstance(dataset, FileDataset) else []
    for error in broken[:SHOWN]:
        typer.echo(f"Skipped: {error}", err=True)
    if broken:
        more = f" ({len(broken) - SHOWN} more than shown)" if len(broken) > SHOWN else ""
        typer.echo(f"{len(broken)} broken part{'s' * (len(broken) > 1)} left out{more}.", err=True)
    if len(dataset) == 0:
        raise ValueError("The dataset has no samples: check the root and the label files.")
    return dataset


def parse_option(text: str) -> tuple[str, Any]:
    """Gives key and value of `key=value`, the value read as YAML.

    Raises:
        ValueError: It is not of that form.
    """
    key, equals, value = text.partition("=")
    if not equals or not key:
        raise ValueError(f"The option {text!r} is not of the form key=value, e.g. length=100.")
    try:
        return key, yaml.safe_load(value)
    except yaml.YAMLError:
        return key, value


__all__ = ["Selection", "open_dataset", "open_or_tell", "parse_option"]
