"""Records of the TuSimple lane benchmark: lines of its label and submission files, read, checked, written."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NotRequired, TypedDict, cast

from yolino.io import write_atomic

_LARGEST = 1e6


class Record(TypedDict):
    """One image of a label or submission file; rows and columns count pixels.

    `raw_file` names the image below the root, `lanes` holds an x for each row of `h_samples` (-2: none),
    `run_time` is in milliseconds (submissions only), `classes` has one id per lane, 1 to 7 (extended labels
    only).
    """

    raw_file: str
    lanes: list[list[float]]
    h_samples: list[float]
    run_time: NotRequired[float]
    classes: NotRequired[str]


def read_records(path: str | Path) -> list[Record]:
    """Gives the records of a label or submission file.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It is empty or has a line that is no valid record; the message names the line.
    """
    return [record for _, record in located_records(Path(path))]


def located_records(path: Path) -> Iterator[tuple[str, Record]]:
    """Yields where each record stands (file and line) and the record, checked."""
    if not path.is_file():
        raise FileNotFoundError(f"There is no label file {path}.")
    count = 0
    with path.open("rb") as lines:
        for number, line in enumerate(lines, 1):
            if line.strip():
                count += 1
                where = f"{path}, line {number}"
                yield where, _check_record(_parse(line, where), where)
    if count == 0:
        raise ValueError(f"The label file {path} has no records: it must hold one JSON object per line.")


def write_records(path: str | Path, records: Iterable[Record]) -> None:
    """Writes a submission file: one record per line, first to a temporary name."""
    write_atomic(path, "".join(json.dumps(record) + "\n" for record in records))


def _parse(line: bytes, where: str) -> Any:
    try:
        return json.loads(line)
    except (ValueError, RecursionError) as error:
        reason = error.msg if isinstance(error, json.JSONDecodeError) else type(error).__name__
        raise ValueError(f"{where} is not valid JSON ({reason}): one JSON object is needed.") from None


def _check_record(record: Any, where: str) -> Record:
    if not isinstance(record, dict):
        raise ValueError(f"{where} holds a {type(record).__name__}, but a JSON object is needed.")
    missing = [key for key in ("raw_file", "lanes", "h_samples") if key not in record]
    if missing:
        raise ValueError(f"{where} lacks {', '.join(missing)}: raw_file, lanes and h_samples are needed.")
    if not isinstance(record["raw_file"], str) or not record["raw_file"]:
        raise ValueError(f"{where} has raw_file {record['raw_file']!r}, but the name of an image is needed.")
    if not isinstance(record["lanes"], list):
        raise ValueError(f"{where} has lanes of type {type(record['lanes']).__name__}, but a list is needed.")
    _check_numbers(record["h_samples"], "h_samples", where)
    for i, lane in enumerate(record["lanes"]):
        _check_numbers(lane, f"lane {i}", where)
        if len(lane) != len(record["h_samples"]):
            raise ValueError(
                f"{where}: lane {i} has {len(lane)} values, but h_samples has {len(record['h_samples'])}: "
                "one x for each row is needed."
            )
    return cast(Record, record)


def _check_numbers(values: Any, name: str, where: str) -> None:
    if not isinstance(values, list):
        raise ValueError(f"{where}: {name} is a {type(values).__name__}, but a list of numbers is needed.")
    for value in values:
        if type(value) not in (int, float) or not abs(value) <= _LARGEST:
            raise ValueError(f"{where}: {name} holds {value!r}, but finite numbers of pixels are needed.")


__all__ = ["Record", "located_records", "read_records", "write_records"]
