"""Reads experiment files: what they inherit, what the command line changes, and how two of them differ."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from yolino.config.mistakes import explain
from yolino.config.sections import Experiment

BASE = "base"


def load_experiment(path: str | Path, overrides: Sequence[str] = ()) -> Experiment:
    """Reads an experiment file and applies overrides: `training.lr=1e-3`, `data.train.0.weight=2`.

    A file with `base: other.yaml` (relative to itself) has the values of that file, except for those that it
    gives itself; sections are joined key by key, lists are replaced as a whole, and `key: null` takes back
    what the base says. Without a `name` of its own it is called like the file.

    Raises:
        FileNotFoundError: No such file.
        ValueError: Not YAML, files that are each other's base, a misspelt key (the nearest right one is
            named), or a value that is not allowed.
    """
    path = Path(path)
    values = _read_inherited(path, ())
    for change in overrides:
        override(values, change)
    try:
        return Experiment.model_validate(values)
    except ValidationError as error:
        raise ValueError(f"{path}: {explain(error, Experiment)}") from error


def _read_inherited(path: Path, heirs: tuple[Path, ...]) -> dict[str, Any]:
    """Gives the values of a file and of what it is based on.

    Args:
        path: The file.
        heirs: The files that are based on it, the first one first.
    """
    if heirs and not path.is_file():
        raise FileNotFoundError(f"{heirs[-1]} names the base {path}, which does not exist.")
    own = _read_values(path)
    if BASE not in own:
        return own
    base = own.pop(BASE)
    if not isinstance(base, str):
        raise ValueError(f"{path}: base is {base!r}, but must be the path of one experiment file.")
    chain = (*heirs, path)
    other = path.parent / base
    if other.resolve() in [file.resolve() for file in chain]:
        circle = " -> ".join(str(file) for file in (*chain, other))
        raise ValueError(f"{circle}: an experiment file cannot be its own base; take one `base:` out.")
    return _joined(_read_inherited(other, chain), {"name": path.stem, **own})


def _joined(base: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """Gives the values of `base` with those of `own` in their place, section by section."""
    joined = dict(base)
    for key, value in own.items():
        before = joined.get(key)
        if value is None and key in joined:
            del joined[key]  # its default holds again
        elif isinstance(value, Mapping) and isinstance(before, Mapping):
            joined[key] = _joined(before, value)
        else:
            joined[key] = value
    return joined


def _read_values(path: Path) -> dict[str, Any]:
    """Gives what stands in the one file."""
    if not path.is_file():
        raise FileNotFoundError(
            f"The experiment file {path} does not exist; the repository has some under configs/."
        )
    values = read_yaml(path)
    if not isinstance(values, dict):
        raise ValueError(f"{path} holds no sections; an experiment file begins with `name:` and `data:`.")
    return values


class _Loader(yaml.SafeLoader):
    """Takes a key that is there twice for a mistake; PyYAML silently takes the last one."""

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        """Gives a node whose keys are all different."""
        node = super().compose_mapping_node(anchor)
        known = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and key.value in known:
                raise yaml.MarkedYAMLError(
                    None, None, f"the key {key.value!r} is there twice", key.start_mark
                )
            known.add(str(key.value))
        return node


def read_yaml(path: Path) -> Any:
    """Gives what a YAML file holds.

    Raises:
        ValueError: It is not YAML, or has a key twice.
        OSError: It cannot be read.
    """
    try:
        return yaml.load(path.read_text(encoding="utf-8"), _Loader)
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        said = " ".join(str(error).split()).replace('in "<unicode string>", line', "at line")
        raise ValueError(f"{path} is not YAML: {said}") from error


def override(values: dict[str, Any], change: str) -> None:
    """Sets one `a.b.c=value` (value read as YAML) in nested dicts and lists.

    Raises:
        ValueError: The change is not of this form, or its key does not fit the values.
    """
    key, equals, text = change.partition("=")
    if not equals or not key:
        raise ValueError(f"Override {change!r} is not of the form key=value, e.g. training.lr=1e-3.")
    *parents, last = key.split(".")
    at: Any = values
    for part in parents:
        at = at[_place(at, part, change)] if isinstance(at, list) else at.setdefault(part, {})
        if not isinstance(at, dict | list):
            raise ValueError(f"Override {change!r}: {part} is a single value and has no keys below it.")
    try:
        value = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ValueError(f"Override {change!r}: {text!r} is not a value in YAML.") from error
    if isinstance(value, str) and value == text.strip():  # what stands in quotation marks stays a text
        value = _number(value)
    at[_place(at, last, change) if isinstance(at, list) else last] = value


def _number(text: str) -> str | float:
    """Reads `1e-3`, which YAML 1.1 takes for a text."""
    try:
        return float(text)
    except ValueError:
        return text


def _place(items: list[Any], part: str, override: str) -> int:
    if not part.isdigit() or int(part) >= len(items):
        raise ValueError(f"Override {override!r}: {part} must be a number from 0 to {len(items) - 1}.")
    return int(part)


def differences(a: Any, b: Any, key: str = "") -> list[str]:
    """Names the keys, as `training.lr`, whose values differ in two nested dicts."""
    if isinstance(a, dict) and isinstance(b, dict):
        names = list(dict.fromkeys([*a, *b]))
        return [d for n in names for d in differences(a.get(n), b.get(n), f"{key}.{n}".lstrip("."))]
    return [] if a == b else [key]


__all__ = ["differences", "load_experiment", "override", "read_yaml"]
