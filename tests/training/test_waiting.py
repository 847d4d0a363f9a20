"""A run that waits for its images says so once, with what to do; a loading process fails in one sentence."""

from __future__ import annotations

import csv
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from lightning.pytorch import Trainer
from torch.utils.data import Dataset

from yolino.config import load_experiment
from yolino.training import waiting
from yolino.training.data import Examples
from yolino.training.loaders import Batches, build_loaders
from yolino.training.run import train
from yolino.training.waiting import WAITING, Waiting, advice, from_worker
from yolino.types import Polylines, Sample

SOURCE = "{dataset: synthetic, options: {kind: shapes, length: 4, size: [64, 96]}}"
TEXT = (
    f"name: tiny\ndata: {{size: [64, 96], train: [{SOURCE}], val: [{SOURCE}]}}\n"
    "model: {backbone: residual, neck_width: 8, predictors: 2,\n"
    "  backbone_args: {widths: [8, 8, 8, 8], blocks: [1, 1, 1, 1], stem: 4}}\n"
    "augment: {preset: none}\n"
    "training: {steps: 3, batch_size: 2, validate_every: 3, accelerator: cpu, devices: 1}\n"
)


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "tiny.yaml"
    path.write_text(TEXT)
    return path


class Slow(Dataset[int]):
    def __len__(self) -> int:
        return 4

    def __getitem__(self, index: int) -> int:
        time.sleep(0.02)
        return index


def test_a_loader_takes_the_time_that_is_waited_for_it() -> None:
    batches = Batches(Slow(), batch_size=2)
    for _ in range(2):
        found = []
        for batch in batches:
            time.sleep(0.05)  # the step, which nobody waits for
            found += batch.tolist()  # type: ignore[attr-defined]
        assert found == [0, 1, 2, 3]
    assert 8 * 0.02 <= batches.waited < 8 * 0.02 + 0.15


class Module:
    def __init__(self) -> None:
        self.logged: list[float] = []

    def log(self, name: str, value: float, **options: Any) -> None:
        assert name == WAITING
        self.logged.append(value)


@pytest.mark.parametrize(("waited", "told"), [(0.5, 1), (0.05, 0)])
def test_much_waiting_is_told_once(
    waited: float, told: int, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    clock, module, loader = [0.0], Module(), Batches(Slow())
    monkeypatch.setattr(waiting, "perf_counter", lambda: clock[0])
    callback: Any = Waiting(loader, "Do this.")
    trainer = Trainer.__new__(Trainer)
    for _ in range(2):
        callback.on_train_epoch_start(trainer, module)
        for step in range(30):
            clock[0] += 1.0 if step else 100.0  # the first step of an epoch has validation before it
            loader.waited += waited if step else 100.0
            callback.on_train_batch_end(trainer, module, None, None, step)
    assert np.allclose(module.logged, waited)
    assert len(module.logged) == 2 * 29
    assert caplog.text.count("% of the time is spent waiting for images. Do this.") == told
    assert ("50 %" in caplog.text) == bool(told)


def test_the_advice_names_what_is_not_done_yet(
    config: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Listed(list[Sample]):
        classes, directed = ("line",), True

    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((8, 8, 3), np.uint8))
    drawn, _ = build_loaders(load_experiment(config), border=False)
    shown = drawn.dataset
    assert isinstance(shown, Examples)
    file = Sample("a", tmp_path / "a.png", Polylines.from_list([]))
    files = Examples([Listed([file])], None, shown.augment, shown.grid, border=False)
    monkeypatch.setattr(waiting, "usable_cores", lambda: 2)

    def said(examples: Examples, *changes: str) -> str:
        return advice(load_experiment(config, changes), examples)

    assert said(files).startswith("Load them in more processes with training.workers=2 (now 0), or decode")
    assert said(files, "training.workers=2") == "Decode each file only once with data.cache=true."
    assert "data.cache" not in said(shown)
    assert said(files, "training.workers=2", "data.cache=true").startswith("All 2 cores load already")


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning", "ignore::UserWarning")
def test_a_run_logs_its_waiting_and_keeps_the_average_with_the_weights(config: Path, tmp_path: Path) -> None:
    train(config, [f"out={tmp_path}"], progress=False)
    rows = list(csv.DictReader(next((tmp_path / "tiny" / "csv").rglob("metrics.csv")).open()))
    (share,) = [float(row[WAITING]) for row in rows if row.get(WAITING)]
    assert 0 < share < 1
    last = torch.load(tmp_path / "tiny" / "last.ckpt", weights_only=True)
    assert last["averaging_state"]["n_averaged"] == 3


def test_the_error_of_a_loading_process_is_its_sentence() -> None:
    text = "Caught OSError in DataLoader worker process 0.\nOriginal Traceback (most recent call):\n"
    found = from_worker(OSError(f"{text}OSError: The disk: it is full.\n"))
    assert type(found) is OSError
    assert str(found) == "The disk: it is full."
    own = ValueError("Caught in the act.")
    assert from_worker(own) is own
