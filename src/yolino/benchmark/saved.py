"""Reads the result of a benchmark from a file, to report and draw it again without measuring."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError


class _Part(BaseModel):
    model_config = ConfigDict(extra="allow")


class _Measure(_Part):
    title: str
    value: bool | float | None
    unit: str
    low: float | None
    high: float | None
    target: bool | float | None
    bound: str | None
    met: bool | None
    note: str


class _Point(_Part):
    value: float
    median: float
    low: float
    high: float
    megabytes: float | None
    label: str


class _Curve(_Part):
    name: str
    title: str
    x: str
    unit: str
    points: list[_Point]
    exponent: float | None
    memory_exponent: float | None


class _Section(_Part):
    title: str
    about: str
    not_measured: str | None
    measures: dict[str, _Measure]
    curves: list[_Curve] = []


class _Machine(_Part):
    cpu: str
    cores: int
    threads: int
    system: str
    python: str
    load: float | None
    versions: dict[str, str]


class _Model(_Part):
    name: str
    file: str
    megabytes: float
    size: tuple[int, int]
    stride: int
    device: str


class _Settings(_Part):
    repeats: int
    quick: bool
    image: str


class _Targets(_Part):
    met: list[str]
    missed: list[str]
    not_measured: list[str]


class _Result(_Part):
    machine: _Machine
    model: _Model | None
    settings: _Settings
    targets: _Targets
    sections: dict[str, _Section]


# What is wrong, by the first word of pydantic's name for it.
_WRONG = {
    "missing": "it is missing",
    "model": "it must be an object",
    "dict": "it must be an object",
    "list": "it must be a list",
    "tuple": "it must be a list",
    "string": "it must be a text",
    "bool": "it must be true or false",
    "int": "it must be a whole number",
    "float": "it must be a number",
}


def read_result(path: str | Path) -> dict[str, Any]:
    """Gives a result that `yolino benchmark --json` printed into a file.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It is a folder, or not the whole result of a benchmark.
    """
    path = Path(path)
    if path.is_dir():
        raise ValueError(f"{path} is a folder; give a file with what `yolino benchmark --json` printed.")
    if not path.is_file():
        raise FileNotFoundError(f"{path} does not exist; give what `yolino benchmark --json` printed.")
    try:
        result: dict[str, Any] = json.loads(path.read_bytes())
        _Result.model_validate(result)
    except ValidationError as error:
        reason = _describe(error)
    except ValueError as error:
        reason = f"it is no JSON: {error}"
    else:
        return result
    raise ValueError(f"{path} is no result of `yolino benchmark --json` ({reason}).")


def _describe(error: ValidationError) -> str:
    """Gives the first thing that is wrong in our words: where it is, and what it must be."""
    first = error.errors()[0]
    place, kind = [str(part) for part in first["loc"]], first["type"].partition("_")[0]
    wrong = _WRONG.get(kind, "it is not what the benchmark writes")
    if place and place[-1] in ("bool", "float"):  # the choice among `bool | float`, not a name in the file
        place.pop()
        wrong = "it must be a number, true or false"
    return f"{'.'.join(place) or 'the whole'}: {wrong}"


__all__ = ["read_result"]
