"""What a training run says when it waits for its images, and what a loader's process says when it fails."""

from __future__ import annotations

import logging
from time import perf_counter
from typing import Any

import numpy as np
from lightning.pytorch import Trainer
from lightning.pytorch.callbacks import Callback

from yolino.config import Experiment
from yolino.inference.engine import usable_cores
from yolino.training.cache import in_files
from yolino.training.data import Examples
from yolino.training.loaders import Batches

logger = logging.getLogger(__name__)
WAITING = "train/waiting_for_images"
_MUCH = 0.1  # share of the time
_STEPS = 20  # from which it is told; the first ones of an epoch fill the pipeline


class Waiting(Callback):
    """Logs the share of each step that was spent waiting for its images, and says once when that is much.

    Args:
        loader: Takes the time that is waited for batches.
        advice: What can be done about it.
    """

    def __init__(self, loader: Batches, advice: str) -> None:
        self.loader, self.advice = loader, advice
        self._last: tuple[float, float] | None = None
        self._shares: list[float] = []
        self._told = False

    def on_train_epoch_start(self, trainer: Trainer, pl_module: Any) -> None:
        """Leaves out the first step of an epoch: validation and the start of processes are not waiting."""
        self._last = None

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: Any, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Takes the time since the last step."""
        now, waited = perf_counter(), self.loader.waited
        if self._last is not None:
            share = (waited - self._last[1]) / max(now - self._last[0], 1e-9)
            pl_module.log(WAITING, share, on_step=False, on_epoch=True, batch_size=1)
            self._shares.append(share)
        self._last = (now, waited)
        if len(self._shares) == _STEPS:
            self._tell(float(np.mean(self._shares)))
            self._shares.clear()

    def _tell(self, share: float) -> None:
        if share > _MUCH and not self._told:
            self._told = True
            logger.warning("%.0f %% of the time is spent waiting for images. %s", 100 * share, self.advice)


def advice(experiment: Experiment, examples: Examples) -> str:
    """Gives what makes loading faster, among what an experiment does not do yet."""
    data, workers, cores = experiment.data, experiment.training.workers, usable_cores()
    ways = []
    if workers < cores:
        ways.append(f"load them in more processes with training.workers={cores} (now {workers})")
    if data.fit != "window" and not data.cache and any(map(in_files, examples.datasets)):
        ways.append("decode each file only once with data.cache=true")
    if not ways:
        ways.append(f"all {cores} cores load already, so only a smaller data.size or less augmentation helps")
    text = ", or ".join(ways)
    return f"{text[0].upper()}{text[1:]}."


def from_worker(error: Exception) -> Exception:
    """Gives the error that a loading process met, instead of the traceback that torch makes of it."""
    text = str(error).strip()
    if not text.startswith("Caught ") or "Traceback" not in text:
        return error
    return type(error)(text.splitlines()[-1].partition(": ")[2])


__all__ = ["WAITING", "Waiting", "advice", "from_worker"]
