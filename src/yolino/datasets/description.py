"""`data.yaml`: what a dataset is, in one file that training, evaluation and all other commands take."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml
from pydantic import Field, ValidationError

from yolino.config import Section, explain
from yolino.datasets.dataset import Dataset
from yolino.datasets.detection import detect_format
from yolino.datasets.files import listed_names
from yolino.datasets.registry import DATASETS
from yolino.image import IMAGE_SUFFIXES

NAMES = ("data.yaml", "data.yml")


class Description(Section):
    """A dataset.

    Attributes:
        format: Name in `DATASETS`.
        root: Folder of the dataset; a relative one starts from the folder of the file.
        splits: What each split is: a list of image names (`train.txt`), or label files, folders or globs.
        classes: Names to take, in the order of their labels, or a mapping from the names in the label files;
            None takes all.
        directed: Whether the direction of a polyline means something; None: what the format says.
        ignore: Names whose polygons are regions where nothing is labelled.
        licence: Licence of the images and labels; written into every model trained on them.
        description: What the data is, for the model file.
        options: Further arguments of the format.
    """

    format: str
    root: Path = Path()
    splits: dict[str, str | list[str]] = Field(default_factory=dict)
    classes: list[str] | dict[str, str] | None = None
    directed: bool | None = None
    ignore: tuple[str, ...] | None = None
    licence: str = "unknown"
    description: str = "unknown"
    options: dict[str, Any] = Field(default_factory=dict)


def load_description(path: str | Path) -> Description:
    """Gives the description in a `data.yaml`, of a folder that holds one, or else of its files.

    Without a `data.yaml` the format is found out from the files (`detect_format`), and splits are the lists
    of names that lie in the folder or in its `list`.

    Raises:
        FileNotFoundError: There is no such file or folder.
        ValueError: It is no description, or the format of the folder is none that is known.
    """
    path = Path(path)
    if path.is_dir():
        file = next((path / name for name in NAMES if (path / name).is_file()), None)
        return _of_folder(path) if file is None else load_description(file)
    if not path.is_file():
        raise FileNotFoundError(f"There is no data description {path}: give a data.yaml, or a folder.")
    try:
        values = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is not YAML: {' '.join(str(error).split())}") from error
    if not isinstance(values, dict):
        raise ValueError(f"{path} holds no keys; a data description begins with `format:` and `root:`.")
    try:
        found = Description.model_validate(values)
    except ValidationError as error:
        raise ValueError(f"{path}: {explain(error, Description)}") from error
    if found.format not in DATASETS:
        raise ValueError(f"{path}: format {found.format!r} is unknown; use one of {', '.join(DATASETS)}.")
    return found.model_copy(update={"root": path.parent / found.root})


def _of_folder(root: Path) -> Description:
    lists = {file.stem: file for file in sorted([*root.glob("*.txt"), *root.glob("list/*.txt")])}
    splits = {
        stem: file.relative_to(root).as_posix()
        for stem, file in lists.items()
        # CULane has train_gt.txt beside train.txt; a readme names no images.
        if stem.removesuffix("_gt") not in lists.keys() - {stem} and _lists_images(file)
    }
    return Description(format=detect_format(root), root=root, splits=dict(splits))


def _lists_images(file: Path) -> bool:
    try:
        first = next(listed_names(file), None)
    except (UnicodeDecodeError, OSError):
        return False
    return first is not None and Path(first[1]).suffix.lower() in IMAGE_SUFFIXES


def open_split(description: Description, split: str | None = None, **changes: Any) -> Dataset:
    """Gives one split of a dataset, or all of it.

    Args:
        description: The dataset.
        split: Name of the split; None takes everything.
        changes: Arguments of the format that go before those of the description.

    Raises:
        FileNotFoundError: Files are missing.
        ValueError: There is no such split, labels are broken, or an argument does not fit the format.
    """
    arguments: dict[str, Any] = {"root": description.root}
    for key in ("classes", "directed", "ignore"):
        if (value := getattr(description, key)) is not None:
            arguments[key] = value
    if split is not None:
        arguments |= _split_arguments(description, split)
    return build(description.format, {**arguments, **description.options, **changes})


def _split_arguments(description: Description, split: str) -> dict[str, Any]:
    if split not in description.splits:
        known = ", ".join(description.splits) or "none"
        raise ValueError(
            f"The dataset {description.root} has no split {split!r}; it has {known}. "
            "Name it under `splits:` in data.yaml."
        )
    value = description.splits[split]
    return {"names": value} if isinstance(value, str) and value.endswith(".txt") else {"labels": value}


def arguments_of(format: str) -> dict[str, inspect.Parameter]:
    """Gives the arguments that a format takes, by name.

    Raises:
        ValueError: The format is unknown.
    """
    if format not in DATASETS:
        raise ValueError(f"The dataset {format!r} is unknown; use one of {', '.join(DATASETS)}.")
    found: dict[str, inspect.Parameter] = {}
    for kind in DATASETS[format].__mro__:
        if "__init__" not in vars(kind) or kind in (object,):
            continue
        parameters = inspect.signature(kind.__init__).parameters.values()  # type: ignore[misc]
        for one in parameters:
            if one.kind is not one.VAR_KEYWORD and one.name != "self":
                found.setdefault(one.name, one)
        if not any(one.kind is one.VAR_KEYWORD for one in parameters):
            break
    return found


def build(format: str, arguments: Mapping[str, Any]) -> Dataset:
    """Gives a dataset of a format.

    Raises:
        FileNotFoundError: Files are missing.
        ValueError: The format is unknown, does not take one of the arguments, or labels are broken.
    """
    known = arguments_of(format)
    if unknown := [key for key in arguments if key not in known]:
        raise ValueError(
            f"The dataset {format!r} takes no {' or '.join(unknown)}; it takes {', '.join(known)}."
        )
    needed = [key for key, value in known.items() if value.default is inspect.Parameter.empty]
    if missing := [key for key in needed if key not in arguments]:
        raise ValueError(f"The dataset {format!r} needs --{' and --'.join(missing)}.")
    return DATASETS[format](**arguments)


__all__ = ["Description", "arguments_of", "build", "load_description", "open_split"]
