"""What a sweep is: a folder of experiment files, and `sweep.yaml`, which orders and titles their results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import Field, ValidationError

from yolino.config import (
    Experiment,
    Section,
    Source,
    differences,
    explain,
    load_experiment,
    read_yaml,
    suggest,
)

FILE = "sweep.yaml"
_MANY = 4  # columns of settings that differ
# What the name of a row or the sentences below the table tell.
_TOLD = {"name", "out"} | {
    f"data.{key}" for key in ("train", "val", "root", "cache", "licence", "description")
}
METRICS = {
    "accuracy": "Acc",
    "fp": "FP",
    "fn": "FN",
    "segment_f1": "F1",
    "segment_recall": "Rec",
    "segment_precision": "Prec",
}
"""Scores of the table by their names in `yolino.evaluate.evaluate`, with the paper's headings."""


class Basis(Section):
    """What the reported numbers of a group rest on.

    Attributes:
        data: Name of the data.
        train: Number of its training images.
        val: Number of the images that were scored.
        backbone: Backbone of the network.
    """

    data: str
    train: int | None = Field(None, ge=0)
    val: int | None = Field(None, ge=0)
    backbone: str | None = None


class Numbers(Section):
    """The reported scores of a row; F1, recall and precision are those of the segments after the NMS."""

    accuracy: float | None = None
    fp: float | None = None
    fn: float | None = None
    f1: float | None = None
    recall: float | None = None
    precision: float | None = None

    def of(self, metric: str) -> float | None:
        """Gives the number that belongs to one of `METRICS`."""
        value: float | None = getattr(self, metric.removeprefix("segment_"))
        return value


class Group(Section):
    """Rows that are shown together.

    Attributes:
        rows: Names of experiment files, without `.yaml`; a row may be in several groups and is run once.
        title: Heading of the group.
        reported_on: What the reported numbers of these rows rest on.
        score_on: What the rows are scored on; empty: on the validation data of their experiment files.
    """

    rows: tuple[str, ...] = Field(min_length=1)
    title: str = ""
    reported_on: Basis | None = None
    score_on: tuple[Source, ...] = ()


class Layout(Section):
    """The file `sweep.yaml`.

    Attributes:
        title: Heading of the table.
        reported_by: Whose numbers stand beside the measured ones.
        columns: Heading of each column that tells the rows apart, and the key of the experiment that it
            shows, such as `model.predictors`; `stride` is the side of a cell and `row` the name of the file.
            Without: the name and the first keys that differ.
        groups: The rows in their order; without: all files of the folder.
        numbers: What was reported, by row.
    """

    title: str = ""
    reported_by: str = "reported"
    columns: dict[str, str] = Field(default_factory=dict)
    groups: tuple[Group, ...] = ()
    numbers: dict[str, Numbers] = Field(default_factory=dict)


@dataclass(frozen=True)
class Sweep:
    """A folder of experiments, read.

    Attributes:
        files: The experiment file of each row, in the order of the rows.
        layout: The groups (at least one), columns, and reported numbers.
    """

    files: dict[str, Path]
    layout: Layout

    def score_on(self, row: str) -> tuple[Source, ...]:
        """Gives what a row is scored on instead of its validation data; nothing for these."""
        return next((group.score_on for group in self.layout.groups if row in group.rows), ())


def load_sweep(folder: str | Path) -> Sweep:
    """Gives the sweep of a folder: its files `*.yaml`, but those whose names begin with `_` or a dot.

    Raises:
        FileNotFoundError: There is no such folder, or no experiment in it.
        ValueError: An experiment or `sweep.yaml` has a mistake, or that names a row that has no file.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise FileNotFoundError(f"There is no folder {folder}: a sweep is a folder of experiment files.")
    files = {
        path.stem: path
        for path in sorted(folder.glob("*.yaml"))
        if path.name != FILE and not path.name.startswith(("_", "."))
    }
    if not files:
        raise FileNotFoundError(f"{folder} holds no experiment files (*.yaml, not beginning with _).")
    layout = _load_layout(folder / FILE)
    if not layout.groups:
        layout = layout.model_copy(update={"groups": (Group(rows=tuple(files)),)})
    _check(layout, files, folder / FILE)
    rows = dict.fromkeys(row for group in layout.groups for row in group.rows)
    files = {row: files[row] for row in rows}
    defaults = {
        "title": layout.title or folder.resolve().name,
        "columns": layout.columns or _differing(list(files.values())),
    }
    return Sweep(files, layout.model_copy(update=defaults))


def _differing(files: Sequence[Path]) -> dict[str, str]:
    """Gives columns for the settings that differ between files, called by the last parts of their keys."""
    first, *others = (load_experiment(path).model_dump(mode="json") for path in files)
    keys = list(dict.fromkeys(key for other in others for key in differences(first, other)))
    shown = [key for key in keys if key not in _TOLD]
    last = [key.rpartition(".")[2] for key in shown]
    headings = [short if last.count(short) == 1 else key for key, short in zip(shown, last, strict=True)]
    return {"Row": "row", **dict(list(zip(headings, shown, strict=True))[:_MANY])}


def _load_layout(path: Path) -> Layout:
    if not path.is_file():
        return Layout()
    values = read_yaml(path)
    if not isinstance(values, dict | None):
        raise ValueError(f"{path} holds no keys; it may have {', '.join(Layout.model_fields)}.")
    try:
        return Layout.model_validate(values or {})
    except ValidationError as error:
        raise ValueError(f"{path}: {explain(error, Layout)}") from error


def _check(layout: Layout, files: dict[str, Path], path: Path) -> None:
    """Raises a ValueError for the first thing in the layout that does not fit the files or itself."""
    scored: dict[str, Sequence[Source]] = {}
    for group in layout.groups:
        for row in group.rows:
            if row not in files:
                raise ValueError(
                    f"{path}: there is no experiment {row}.yaml for the row {row!r}; {suggest(row, files)}"
                    f"The folder has {', '.join(files)}."
                )
            if scored.setdefault(row, group.score_on) != group.score_on:
                raise ValueError(f"{path}: {row} is in groups with different score_on; one row has one.")
    for row in layout.numbers:
        if row not in scored:
            raise ValueError(
                f"{path}: numbers has the row {row!r}, which is in no group; {suggest(row, scored)}"
                f"The groups have {', '.join(scored)}."
            )
    for heading, key in layout.columns.items():
        _check_key(key, f"{path}: columns.{heading}")


def _check_key(key: str, where: str) -> None:
    """Raises a ValueError if an experiment has no such key."""
    if key in ("stride", "row"):
        return
    first, *rest = key.split(".")
    fields = Experiment.model_fields
    known = first in fields
    kind = fields[first].annotation if known else None
    if known and rest:
        known = isinstance(kind, type) and issubclass(kind, Section) and rest[0] in kind.model_fields
    if not known:
        names = [
            f"{name}.{part}"
            for name, info in fields.items()
            if isinstance(info.annotation, type) and issubclass(info.annotation, Section)
            for part in info.annotation.model_fields
        ]
        raise ValueError(f"{where} is {key!r}, which no experiment has; {suggest(key, names)}".rstrip())


__all__ = ["FILE", "METRICS", "Basis", "Group", "Layout", "Numbers", "Sweep", "load_sweep"]
