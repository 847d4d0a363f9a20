"""A folder with two very small experiments, and results that nobody had to train for."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from yolino.config import load_experiment
from yolino.sweep.result import RUNS, Part, Result, run_name

BASE = """
name: base
data:
  size: [64, 96]
  train: [{dataset: synthetic, options: {kind: shapes, length: 50, size: [64, 96]}}]
  val: [{dataset: synthetic, options: {kind: shapes, length: 3, seed: 9, size: [64, 96]}}]
model:
  backbone: residual
  backbone_args: {widths: [8, 8, 16, 16], blocks: [1, 1, 1, 1], stem: 4}
  neck_width: 16
  predictors: 2
augment: {preset: none}
training:
  {steps: 4, batch_size: 2, validate_every: 2, warmup_steps: 1, ema_decay: 0.5, accelerator: cpu, devices: 1}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The rows `a` (the base, as it is) and `b` (another representation)."""
    path = tmp_path / "mine"
    path.mkdir()
    (path / "_base.yaml").write_text(BASE)
    (path / "a.yaml").write_text("base: _base.yaml")
    (path / "b.yaml").write_text("base: _base.yaml\nmodel: {representation: eu, upsample: 0}")
    return path


Finish = Callable[..., Result]


@pytest.fixture
def finish(folder: Path, tmp_path: Path) -> Finish:
    """Writes the result of a run into the folder `out`."""

    def write(row: str, seed: int = 0, *, train: int = 50, **scores: float) -> Result:
        experiment = load_experiment(folder / f"{row}.yaml", [f"training.seed={seed}"])
        result = Result(
            row=row,
            seed=seed,
            settings=experiment.model_dump(mode="json"),
            scores=scores,
            intervals={name: (value - 0.1, value + 0.05) for name, value in scores.items()},
            threshold=0.4,
            train=(Part(name="shapes", images=train),),
            scored=(Part(name="other shapes", images=3),),
            step=2,
            steps=4,
            seconds=90.0,
            parameters=1_250_000,
            device="cpu",
            version="0",
            commit="0" * 40,
        )
        result.write(tmp_path / "out" / RUNS / run_name(row, seed))
        return result

    return write
