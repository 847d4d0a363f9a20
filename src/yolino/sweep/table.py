"""What stands in the table of a sweep: columns, means over seeds, the reported numbers beside ours."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from yolino.config import load_experiment
from yolino.sweep.description import METRICS, Numbers, Sweep
from yolino.sweep.result import Result, Row, read_row

NOTHING = "–"


def read_rows(sweep: Sweep, out: Path) -> dict[str, Row]:
    """Gives all that the folder of a sweep holds, by row.

    Raises:
        ValueError: A file in it is no result.
    """
    return {name: read_row(name, out) for name in sweep.files}


def settings(sweep: Sweep, row: Row) -> dict[str, str]:
    """Gives what tells a row apart, by heading: as it was run, or else as its file says."""
    ran = next(iter(row.results.values()), None)
    values = ran.settings if ran else load_experiment(sweep.files[row.name]).model_dump(mode="json")
    derived = {"row": row.name, "stride": f"{32 >> values['model']['upsample']} px"}
    return {
        heading: derived[key] if key in derived else _value(values, key)
        for heading, key in sweep.layout.columns.items()
    }


def _value(values: Mapping[str, Any], key: str) -> str:
    """Gives the value of a key such as `training.lr`, for people."""
    value: Any = values
    for part in key.split("."):
        value = value.get(part, "") if isinstance(value, Mapping) else ""
    return json.dumps(value) if isinstance(value, list | dict) else str(value)


def mean(results: Sequence[Result], metric: str) -> float | None:
    """Gives the mean of a score over the runs of a row; None if they have no such score."""
    values = [result.scores[metric] for result in results if metric in result.scores]
    return sum(values) / len(values) if values else None


def spread(results: Sequence[Result], metric: str) -> tuple[float, float] | None:
    """Gives the least and the largest score over the runs of a row; None for a single run."""
    values = [result.scores[metric] for result in results if metric in result.scores]
    return (min(values), max(values)) if len(values) > 1 else None


def short(value: float | None) -> str:
    """Gives a score with three digits, as the paper prints it: `.914`."""
    if value is None:
        return NOTHING
    text = f"{value:.3f}"
    return text.replace("0.", ".", 1) if text.lstrip("-").startswith("0.") else text


def printed(numbers: Numbers) -> dict[str, str]:
    """Gives the reported numbers of a row, all with as many digits as the longest of them, at least two."""
    known = {metric: short(value) for metric in METRICS if (value := numbers.of(metric)) is not None}
    cut = -1 if all(text.endswith("0") for text in known.values()) else None
    return {metric: text[:cut] for metric, text in known.items()}


def metrics(sweep: Sweep, rows: Mapping[str, Row]) -> list[str]:
    """Gives the scores that a row has or that were reported; all while there are none."""
    results = [result for row in rows.values() for result in row.results.values()]
    numbers = sweep.layout.numbers.values()
    known = [
        name
        for name in METRICS
        if mean(results, name) is not None or any(one.of(name) is not None for one in numbers)
    ]
    return known or list(METRICS)


def heading(sweep: Sweep, rows: Mapping[str, Row]) -> list[str]:
    """Gives the headings of the table's columns."""
    return [*sweep.layout.columns, *(METRICS[metric] for metric in metrics(sweep, rows))]


def cells(
    sweep: Sweep, rows: Mapping[str, Row], name: str, best: Mapping[str, float] | None = None
) -> list[str]:
    """Gives the cells of a row: its settings, and each score with the reported one in parentheses.

    Args:
        sweep: The sweep.
        rows: All rows.
        name: Name of the row.
        best: The best value of each score, which is set in bold; None sets none.
    """
    row, shown = rows[name], metrics(sweep, rows)
    found = list(settings(sweep, row).values())
    reported = printed(sweep.layout.numbers.get(row.name, Numbers()))
    for metric in shown:
        value = mean(list(row.results.values()), metric)
        text = short(value)
        if best is not None and value is not None and value == best.get(metric):
            text = f"**{text}**"
        if metric == shown[0] and not row.results and row.problems:
            text = next(iter(row.problems.values())).partition(":")[0]  # not run, or failed
        found.append(f"{text} ({reported[metric]})" if metric in reported else text)
    return found


def notes(rows: Mapping[str, Row]) -> list[str]:
    """Says which runs have no result, and why."""
    found = [
        f"{row.name}, seed {seed}: {problem}"
        for row in rows.values()
        for seed, problem in row.problems.items()
    ]
    waiting = [row.name for row in rows.values() if not row.results and not row.problems]
    return [*found, *([f"Not run yet: {', '.join(waiting)}."] if waiting else [])]


def legend(sweep: Sweep, rows: Mapping[str, Row]) -> str:
    """Says what the columns are."""
    said = []
    if "accuracy" in metrics(sweep, rows):
        said.append("Acc, FP, FN: the TuSimple benchmark's, of the polylines.")
    said.append(
        "F1, Rec, Prec: points of the segments after the NMS. Thresholds of segments and of lines are chosen "
        "on the validation data, where the experiments have none."
    )
    if any(len(row.results) > 1 for row in rows.values()):
        said.append("Means over the seeds.")
    if sweep.layout.numbers:
        said.append(f"In parentheses: {sweep.layout.reported_by}.")
    return " ".join(said)


__all__ = [
    "NOTHING",
    "cells",
    "heading",
    "legend",
    "mean",
    "metrics",
    "notes",
    "printed",
    "read_rows",
    "settings",
    "short",
    "spread",
]
