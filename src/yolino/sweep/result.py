"""What a run leaves for the table: its scores and what they rest on, or why there are none."""

from __future__ import annotations

import re
import traceback
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from yolino.config import Section, explain
from yolino.io import write_atomic

RESULT, PROBLEM = "result.json", "problem.txt"
RUNS = "runs"


class Part(Section):
    """A dataset that a run used: its name and the number of its images."""

    name: str
    images: int


class Result(Section):
    """What came of one run.

    Attributes:
        row: Name of the row.
        seed: Seed of everything random.
        settings: The whole experiment, as it was run.
        scores: The scores by their names in `yolino.evaluate.evaluate`.
        intervals: Their 95 % bootstrap intervals.
        threshold: Smallest score of a segment that counts for the scores of segments.
        line_threshold: The same for those of lines; None in results of earlier versions: the same.
        train: What was trained on.
        scored: What was scored on.
        step: Step of the best checkpoint.
        steps: Steps in all.
        seconds: Time of training, over all its parts.
        parameters: Numbers that were learned.
        device: What the network was scored on.
        version: Version of yolino.
        commit: Git commit of the code.
    """

    row: str
    seed: int
    settings: dict[str, Any]
    scores: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    threshold: float
    line_threshold: float | None = None
    train: tuple[Part, ...]
    scored: tuple[Part, ...]
    step: int
    steps: int
    seconds: float
    parameters: int
    device: str
    version: str
    commit: str

    def write(self, folder: Path) -> None:
        """Writes the result of a finished run, wholly or not at all."""
        write_atomic(folder / RESULT, self.model_dump_json(indent=1) + "\n")
        (folder / PROBLEM).unlink(missing_ok=True)


@dataclass(frozen=True)
class Row:
    """All that a sweep's folder holds about one row.

    Attributes:
        name: Name of the row.
        results: Results of its finished runs, by seed.
        problems: Why there is no result, by seed.
    """

    name: str
    results: dict[int, Result]
    problems: dict[int, str]


def run_name(row: str, seed: int) -> str:
    """Gives the name of a run, and of its folder."""
    return f"{row}-seed{seed}"


def run_folders(row: str, out: Path) -> dict[int, Path]:
    """Gives the folders of all runs of a row, begun or finished, by seed."""
    found = {}
    for folder in (out / RUNS).glob("*-seed*"):  # names of rows may hold what `glob` takes for a pattern
        match = re.fullmatch(r"(.*)-seed(\d+)", folder.name)
        if match is not None and match[1] == row:
            found[int(match[2])] = folder
    return dict(sorted(found.items()))


def read_result(folder: Path) -> Result | None:
    """Gives the result of the run in a folder, or None if it is not finished.

    Raises:
        ValueError: The file is no such result.
    """
    path = folder / RESULT
    if not path.is_file():
        return None
    try:
        return Result.model_validate_json(path.read_bytes())
    except ValidationError as error:
        said = explain(error, Result)
        raise ValueError(f"{path}: {said} Delete the folder {folder} to run it anew.") from error


def read_row(name: str, out: Path) -> Row:
    """Gives what the folder of a sweep holds about a row.

    Raises:
        ValueError: A file is no result.
    """
    results: dict[int, Result] = {}
    problems: dict[int, str] = {}
    for seed, folder in run_folders(name, out).items():
        result = read_result(folder)
        if result is not None:
            results[seed] = result
        elif (folder / PROBLEM).is_file():
            problems[seed] = (folder / PROBLEM).read_text(encoding="utf-8").partition("\n")[0]
    return Row(name, results, problems)


def write_problem(folder: Path, problem: str, error: BaseException | None = None) -> None:
    """Writes why a run has no result in one line, and below it where the code was, if it failed."""
    trace = "" if error is None else "".join(traceback.format_exception(error))
    write_atomic(folder / PROBLEM, f"{problem}\n{trace}")


__all__ = [
    "PROBLEM",
    "RESULT",
    "RUNS",
    "Part",
    "Result",
    "Row",
    "read_result",
    "read_row",
    "run_folders",
    "run_name",
    "write_problem",
]
