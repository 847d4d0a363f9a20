"""Records of the TuSimple lane benchmark: lines of its label and submission files, read, checked, written."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NotRequired, TypedDict, cast

from yolino.datasets.annotation import LabelError, parse_json
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
    records = []
    for _, record in located_records(Path(path)):
        if isinstance(record, LabelError):
            raise record
        records.append(record)
    return records


def located_records(path: Path) -> Iterator[tuple[str, Record | LabelError]]:
    """Yields where each record stands (file and line) and the record, checked, or what is wrong with it."""
    if not path.is_file():
        raise FileNotFoundError(f"There is no label file {path}.")
    count = 0
    with path.open("rb") as lines:
        for number, line in enumerate(lines, 1):
            if line.strip():
                count += 1
                where = f"{path}, line {number}"
                try:
                    yield where, _check_record(parse_json(line, where), where)
                except LabelError as error:
                    yield where, error
    if count == 0:
        raise LabelError(str(path), "has no records, but one JSON object per line is needed")


def write_records(path: str | Path, records: Iterable[Record]) -> None:
    """Writes a submission file: one record per line, first to a temporary name."""
    write_atomic(path, "".join(json.dumps(record) + "\n" for record in records))


def _check_record(record: Any, where: str) -> Record:
    if not isinstance(record, dict):
        raise LabelError(where, f"holds a {type(record).__name__}, but a JSON object is needed")
    missing = [key for key in ("raw_file", "lanes", "h_samples") if key not in record]
    if missing:
        raise LabelError(where, f"lacks {', '.join(missing)}, raw_file, lanes and h_samples are needed")
    if not isinstance(record["raw_file"], str) or not record["raw_file"]:
        raise LabelError(where, f"has raw_file {record['raw_file']!r}, but the name of an image is needed")
    if not isinstance(record["lanes"], list):
        raise LabelError(where, f"has lanes of type {type(record['lanes']).__name__}, but a list is needed")
    _check_numbers(record["h_samples"], "h_samples", where)
    for i, lane in enumerate(record["lanes"]):
        _check_numbers(lane, f"lane {i}", where)
        if len(lane) != len(record["h_samples"]):
            raise LabelError(
                f"{where}, lane {i}",
                f"has {len(lane)} values, but h_samples has {len(record['h_samples'])}; "
                "one x for each row is needed",
            )
    return cast(Record, record)


def _check_numbers(values: Any, name: str, where: str) -> None:
    if not isinstance(values, list):
        raise LabelError(f"{where}, {name}", f"is a {type(values).__name__}, but a list of numbers is needed")
    for value in values:
        if type(value) not in (int, float) or not abs(value) <= _LARGEST:
            raise LabelError(f"{where}, {name}", f"holds {value!r}, but finite numbers of pixels are needed")


__all__ = ["Record", "located_records", "read_records", "write_records"]
