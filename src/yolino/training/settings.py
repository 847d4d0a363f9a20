"""The settings of an earlier run in a folder, and what may change without making it another experiment."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import ValidationError

from yolino.config import Experiment, differences, explain, read_yaml

SETTINGS = "experiment.yaml"
"""The file in the folder of a run that holds its settings."""

# Where and how fast a run runs, and what is only said about its data.
FREE = frozenset(
    {
        "out",
        "data.cache",
        "data.licence",
        "data.description",
        "training.workers",
        "training.threads",
        "training.devices",
        "training.accelerator",
        "training.compile",
    }
)


def read_settings(folder: Path) -> dict[str, Any]:
    """Gives the settings of the run in a folder.

    Raises:
        ValueError: They cannot be read, or are those of another version.
        OSError: There are none.
    """
    return with_defaults(read_yaml(folder / SETTINGS), folder)


def with_defaults(settings: Any, folder: Path) -> dict[str, Any]:
    """Gives the settings of a run with the defaults of keys that are newer than it.

    Raises:
        ValueError: They are those of another version.
    """
    try:
        return Experiment.model_validate(settings).model_dump(mode="json")
    except ValidationError as error:
        said = explain(error, Experiment)
        raise ValueError(
            f"{folder} is a run of another version of yolino: {said} Give another folder, or delete it."
        ) from error


def changed_settings(before: Any, now: Any) -> list[str]:
    """Names the keys whose values differ and make it another experiment."""
    return [key for key in differences(before, now) if key not in FREE]


__all__ = ["FREE", "SETTINGS", "changed_settings", "read_settings", "with_defaults"]
