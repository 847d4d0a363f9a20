"""The curves of a run, from the files that training logs into."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from yolino.types import Floats

Curve = tuple[Floats, Floats]


def read_curves(folder: Path) -> dict[str, Curve]:
    """Gives the steps and values of all that a run logged, by name: `val/f1`, `train/loc`, ...

    A run that was continued has a file for each of its parts; what a later part repeats replaces what the
    earlier one had from there on.

    Args:
        folder: The run's folder; one without logs has no curves.
    """
    files = sorted((folder / "csv").glob("version_*/metrics.csv"), key=_number)
    points: dict[str, dict[int, float]] = {}
    for file in files:
        text = file.read_text(encoding="utf-8")
        whole = text[: text.rfind("\n") + 1]  # a kill may leave a part of a line
        rows = [row for row in csv.DictReader(io.StringIO(whole)) if row.get("step")]
        if not rows:
            continue
        first = int(rows[0]["step"]) + 1
        for name, curve in points.items():
            points[name] = {step: value for step, value in curve.items() if step < first}
        for row in rows:
            for name, text in row.items():
                if name and "/" in name and text:
                    # Lightning counts training steps from 0; validations state how many there were.
                    step = int(row["step"]) + name.startswith("train/")
                    points.setdefault(name, {})[step] = float(text)
    return {
        name: (np.array(list(curve), np.float64), np.array(list(curve.values()), np.float64))
        for name, curve in points.items()
        if curve
    }


def _number(file: Path) -> int:
    number = file.parent.name.removeprefix("version_")
    return int(number) if number.isdigit() else 0


def last_step(folder: Path) -> int:
    """Gives the last step that a run has validated; 0 for none."""
    steps = read_curves(folder).get("val/f1")
    return 0 if steps is None else int(steps[0].max())


__all__ = ["Curve", "last_step", "read_curves"]
