"""Labelled datasets as the command line names them."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from yolino.datasets import DATASETS, Dataset, TuSimple


def open_dataset(
    name: str,
    root: Path | None,
    labels: Sequence[Path],
    options: Sequence[str] = (),
    *,
    classes: Sequence[str] = (),
    lenient: bool = False,
) -> Dataset:
    """Gives the dataset `name`.

    Args:
        name: A name in `DATASETS`.
        root: Folder of the dataset.
        labels: Label files; none means all that the dataset finds.
        options: More arguments of the dataset, each `key=value`.
        classes: Classes of the model that is to be compared; a dataset that knows them is read with them.
        lenient: Whether missing images are left for a check to find, where the dataset can do so.

    Raises:
        ValueError: If the dataset is unknown or does not take one of these arguments.
        FileNotFoundError: If its files do not exist.
    """
    if name not in DATASETS:
        raise ValueError(f"The dataset {name!r} is unknown; use {' or '.join(DATASETS)}.")
    arguments: dict[str, Any] = dict(map(_option, options))
    if root is not None:
        arguments["root"] = root
    if labels:
        arguments["labels"] = list(labels)
    parameters = inspect.signature(DATASETS[name]).parameters
    if lenient and "require_images" in parameters:
        arguments.setdefault("require_images", False)
    required = [key for key, value in parameters.items() if value.default is inspect.Parameter.empty]
    if unknown := [key for key in arguments if key not in parameters]:
        raise ValueError(
            f"The dataset {name!r} takes no {' or '.join(unknown)}; it takes {', '.join(parameters)}."
        )
    if missing := [key for key in required if key not in arguments]:
        raise ValueError(f"The dataset {name!r} needs --{' and --'.join(missing)}.")
    dataset = DATASETS[name](**arguments)
    if classes and isinstance(dataset, TuSimple) and dataset.has_classes:
        return TuSimple(**{**arguments, "classes": True})
    return dataset


def _option(text: str) -> tuple[str, Any]:
    key, equals, value = text.partition("=")
    if not equals or not key:
        raise ValueError(f"The option {text!r} is not of the form key=value, e.g. length=100.")
    try:
        return key, yaml.safe_load(value)
    except yaml.YAMLError:
        return key, value


__all__ = ["open_dataset"]
