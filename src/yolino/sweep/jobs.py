"""The runs of a sweep, and all that can be said about them before the first one begins."""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from yolino.config import Experiment, Source, load_experiment, suggest
from yolino.datasets import Dataset
from yolino.model.network import Network
from yolino.sweep.description import Sweep
from yolino.sweep.result import RUNS, Part, read_result, run_folders, run_name
from yolino.training.callbacks import LAST
from yolino.training.checks import check_experiment
from yolino.training.data import build_augment, build_dataset
from yolino.training.module import frozen_parts, network_arguments
from yolino.training.settings import changed_settings, read_settings, with_defaults

_POSTPROCESS = "postprocess."


@dataclass(frozen=True)
class Job:
    """One run.

    Attributes:
        row: Name of the row.
        seed: Seed of everything random.
        path: The experiment file.
        changes: What is changed in it.
        experiment: The experiment with these changes.
        score_on: What is scored; empty: the validation data.
    """

    row: str
    seed: int
    path: Path
    changes: tuple[str, ...]
    experiment: Experiment
    score_on: tuple[Source, ...] = ()

    @property
    def folder(self) -> Path:
        """Where the run puts its files."""
        return self.experiment.out / self.experiment.name

    @property
    def finished(self) -> bool:
        """Whether the run has a result."""
        return read_result(self.folder) is not None

    @property
    def other_postprocess(self) -> list[str]:
        """Names what the post-processing of the finished run had otherwise; changing it needs no training."""
        result = read_result(self.folder)
        if result is None:
            return []
        before = with_defaults(result.settings, self.folder)
        now = self.experiment.model_dump(mode="json")
        return [key for key in changed_settings(before, now) if key.startswith(_POSTPROCESS)]


def plan(
    sweep: Sweep,
    overrides: Sequence[str],
    out: Path,
    *,
    only: Sequence[str] = (),
    seeds: Sequence[int] = (),
) -> list[Job]:
    """Gives the runs of a sweep in their order, all rows with the first seed, then with the next.

    Args:
        sweep: The sweep.
        overrides: `key=value` changes to all experiments.
        out: Folder of the results.
        only: Names of the rows to run; without: all.
        seeds: Seeds to run each row with; without: that of its experiment file.

    Raises:
        FileNotFoundError: A file is missing.
        ValueError: A mistake in a file or a change, an unknown row, or an earlier run with other settings.
    """
    rows = _chosen(sweep, only)
    for change in overrides:
        key = change.partition("=")[0].strip()
        if key in ("name", "out") or (key == "training.seed" and seeds):
            instead = {"name": "the names of the files", "out": "--out"}.get(key, "--seeds")
            raise ValueError(f"{key} cannot be changed for all rows of a sweep; use {instead}.")
    jobs = [
        _job(sweep, row, (*overrides, *([] if seed is None else [f"training.seed={seed}"])), out)
        for seed in dict.fromkeys(seeds or (None,))
        for row in rows
    ]
    planned = {job.folder for job in jobs}
    for job in jobs:
        _check_settings(job, out, planned)
    return jobs


def _chosen(sweep: Sweep, only: Sequence[str]) -> list[str]:
    for name in only:
        if name not in sweep.files:
            raise ValueError(
                f"The sweep has no row {name!r}; {suggest(name, sweep.files)}It has {', '.join(sweep.files)}."
            )
    return [row for row in sweep.files if not only or row in only]


def _job(sweep: Sweep, row: str, overrides: Sequence[str], out: Path) -> Job:
    path = sweep.files[row]
    seed = load_experiment(path, overrides).training.seed
    # In quotation marks, so that no name is read as anything else.
    changes = (*overrides, f"name={_quoted(run_name(row, seed))}", f"out={_quoted(str(out / RUNS))}")
    experiment = load_experiment(path, changes)
    try:
        check_experiment(experiment)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    return Job(row, seed, path, changes, experiment, sweep.score_on(row))


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def _check_settings(job: Job, out: Path, planned: Collection[Path]) -> None:
    """Raises a ValueError if the row has runs with other settings; those planned may be scored anew."""
    now = job.experiment.model_dump(mode="json")
    for folder in run_folders(job.row, out).values():
        result = read_result(folder)
        if result is not None:
            before = with_defaults(result.settings, folder)
            if folder in planned:
                before = before | {"postprocess": now["postprocess"]}
        elif folder == job.folder and (folder / LAST).is_file():
            before = read_settings(folder)
        else:
            continue
        free = {"name"} if folder == job.folder else {"name", "training.seed"}
        if changed := [key for key in changed_settings(before, now) if key not in free]:
            raise ValueError(
                f"{folder} is a run of {job.row} with other settings ({', '.join(changed)}): give another "
                "--out, take the change back, or delete that folder to run it anew."
            )


def check_parts(experiment: Experiment) -> None:
    """Builds what training will build, but for the data: a misspelt name is told hours before its turn.

    Raises:
        ValueError: The network or the augmentation cannot be built like this.
        FileNotFoundError: Weights of the backbone are not there.
    """
    data, weights = experiment.data, {"pretrained": False}  # nothing is downloaded
    frozen_parts(Network(**network_arguments(experiment) | weights), experiment.training.freeze)
    build_augment(experiment.augment, data.size, data.fit)


def open_source(source: Source, experiment: Experiment, split: str, *, skip_broken: bool = False) -> Dataset:
    """Gives the dataset of a source of an experiment."""
    return build_dataset(
        source, experiment.data.root, experiment.data.classes, split=split, skip_broken=skip_broken
    )


class Shelf:
    """Counts the images of datasets, each only once."""

    def __init__(self, *, skip_broken: bool = False) -> None:
        self.skip_broken = skip_broken
        self._known: dict[str, Part] = {}

    def parts(self, job: Job) -> tuple[tuple[Part, ...], tuple[Part, ...]]:
        """Gives what a run trains on, and what it is scored on.

        Raises:
            FileNotFoundError: Some of it, or of its validation data, is not there.
            ValueError: It is broken.
        """
        data = job.experiment.data
        train = tuple(self._part(source, job.experiment, "train") for source in data.train)
        val = tuple(self._part(source, job.experiment, "val") for source in data.val)
        scored = tuple(self._part(source, job.experiment, "val") for source in job.score_on)
        return train, scored or val

    def _part(self, source: Source, experiment: Experiment, split: str) -> Part:
        key = f"{source!r} {experiment.data.root} {experiment.data.classes} {split}"
        if key not in self._known:
            dataset = open_source(source, experiment, split, skip_broken=self.skip_broken)
            self._known[key] = Part(name=_name(source, split), images=len(dataset))
        return self._known[key]


def _name(source: Source, split: str) -> str:
    """Gives what a source is called in a sentence."""
    if source.data is not None:
        return f"{source.data} ({source.split or split})"
    labels = source.options.get("labels")
    names = [labels] if isinstance(labels, str) else labels or []
    return " ".join([str(source.dataset), *map(str, names)])


__all__ = ["Job", "Shelf", "check_parts", "open_source", "plan"]
