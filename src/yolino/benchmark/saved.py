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


def read_result(path: str | Path) -> dict[str, Any]:
    """Gives a result that `yolino benchmark --json` printed into a file.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It is not the whole result of a benchmark.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path} does not exist; give what `yolino benchmark --json` printed.")
    try:
        result: dict[str, Any] = json.loads(path.read_bytes())
        _Result.model_validate(result)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"])) or "the whole"
        reason = f"{place}: {first['msg']}"
    except ValueError as error:
        reason = f"it is no JSON: {error}"
    else:
        return result
    raise ValueError(f"{path} is no result of `yolino benchmark --json` ({reason}).")


__all__ = ["read_result"]
