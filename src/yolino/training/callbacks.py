"""What happens beside the steps of a training: safe checkpoints, the best weights, pictures."""

from __future__ import annotations

import logging
import os
import subprocess
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from lightning.pytorch import Trainer
from lightning.pytorch.callbacks import Callback
from lightning.pytorch.loggers import TensorBoardLogger
from lightning.pytorch.plugins.io import TorchCheckpointIO
from torch import Tensor

from yolino.config import Experiment
from yolino.header import Header
from yolino.model.checkpoint import save_checkpoint
from yolino.training.data import Examples
from yolino.training.module import network_arguments
from yolino.training.pictures import prediction_pictures

logger = logging.getLogger(__name__)
LAST = "last.ckpt"
BEST = "best.safetensors"


class AtomicCheckpointIO(TorchCheckpointIO):
    """Writes Lightning's checkpoint to a temporary name first: a kill while writing leaves the one before."""

    def save_checkpoint(
        self, checkpoint: dict[str, Any], path: Any, storage_options: Any | None = None
    ) -> None:
        """Writes, then renames."""
        temporary = f"{path}.part"
        super().save_checkpoint(checkpoint, temporary, storage_options)
        os.replace(temporary, path)


class KeepBest(Callback):
    """Writes `best.safetensors` whenever validation F1 improves.

    Stands before the averaging of weights in the list, so that the averaged weights are still in place.
    """

    def __init__(self, experiment: Experiment, folder: Path) -> None:
        self.experiment, self.folder, self.best = experiment, folder, -1.0

    def state_dict(self) -> dict[str, Any]:
        """Gives what a resumed run must remember."""
        return {"best": self.best}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Remembers."""
        self.best = float(state_dict["best"])

    def on_validation_epoch_end(self, trainer: Trainer, pl_module: Any) -> None:
        """Scores, logs, and keeps the weights if they are the best so far."""
        scores = pl_module.validation_scores()
        for name, value in scores.items():
            pl_module.log(f"val/{name}", value, sync_dist=True, prog_bar=name == "f1")
        if trainer.sanity_checking or not trainer.is_global_zero:
            return
        step, better = trainer.global_step, scores["f1"] > self.best
        if better:
            self.best = scores["f1"]
            header = build_header(self.experiment, {**scores, "step": step})
            save_checkpoint(
                self.folder / BEST, pl_module.network.state_dict(), header, network_arguments(self.experiment)
            )
        text = " ".join(f"{k} {v:.3f}" for k, v in scores.items())
        logger.info("step %d: %s%s", step, text, " (best)" if better else "")


class ValidateLast(Callback):
    """Validates after the very last step, too, where the steps are no multiple of those between validations.

    Otherwise the weights of the last steps were never scored, and a short run left no checkpoint at all.
    """

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: Any, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Asks Lightning to stop, before which it validates and writes the checkpoint."""
        if trainer.global_step >= trainer.max_steps:
            trainer.should_stop = True


class Pictures(Callback):
    """Puts pictures of predictions beside labels into TensorBoard."""

    def __init__(self, examples: Examples, threshold: float, count: int = 4) -> None:
        self.examples, self.threshold, self.count = examples, threshold, min(count, len(examples))

    def on_validation_epoch_end(self, trainer: Trainer, pl_module: Any) -> None:
        """Draws the first validation images with the weights of the validation."""
        if trainer.sanity_checking or not trainer.is_global_zero:
            return
        board = next((log for log in trainer.loggers if isinstance(log, TensorBoardLogger)), None)
        if board is not None:
            sheet = prediction_pictures(
                pl_module, [self.examples[i] for i in range(self.count)], self.threshold
            )
            board.experiment.add_image(
                "val/label and prediction", sheet, trainer.global_step, dataformats="HWC"
            )


def moving_average(decay: float) -> Callable[[Tensor, Tensor, Tensor | int], Tensor]:
    """Gives the update of an exponential moving average that forgets the random start.

    The decay begins small and grows with the number of updates. With a constant one of 0.998 a fifth of the
    weights were still those of the first step after 750, and validation saw a network that found nothing.
    """

    def update(average: Tensor, current: Tensor, count: Tensor | int) -> Tensor:
        now = min(decay, (1 + int(count)) / (10 + int(count)))
        return now * average + (1 - now) * current

    return update


def build_header(experiment: Experiment, metrics: Mapping[str, float]) -> Header:
    """Gives the header of the model that an experiment trains."""
    data, model = experiment.data, experiment.model
    postprocess = experiment.postprocess.model_dump()
    if postprocess["threshold"] is None:
        postprocess["threshold"] = metrics["threshold"]
    return Header(
        version=version("yolino"),
        name=experiment.name,
        size=data.size,
        stride=32 >> model.upsample,
        predictors=model.predictors,
        representation=model.representation,
        classes=data.classes,
        directed=data.directed,
        fit=data.fit,
        scale=data.scale,
        licence=data.licence,
        data=data.description,
        postprocess=postprocess,
        metrics=dict(metrics),
        commit=git_commit(),
    )


def git_commit() -> str:
    """Gives the commit of the working tree that holds this package, or "unknown" for an installed one."""
    try:
        done = subprocess.run(
            ["git", "-C", str(Path(__file__).parent), "rev-parse", "HEAD"],
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return done.stdout.strip()
