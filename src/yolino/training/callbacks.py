"""What happens beside the steps of a training: safe checkpoints, the best weights, pictures."""

from __future__ import annotations

import logging
import os
import subprocess
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import torch
from lightning.pytorch import Trainer
from lightning.pytorch.callbacks import Callback, WeightAveraging
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
BEST, NEWEST = "best.safetensors", "last.safetensors"


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
    """Writes `last.safetensors` at each validation, and `best.safetensors` whenever validation F1 improves.

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
        # Lightning's own count is one less, but not in a run that was continued.
        pl_module.log("step", float(trainer.global_step))
        scores = pl_module.validation_scores()
        for name, value in scores.items():
            pl_module.log(f"val/{name}", value, sync_dist=True, prog_bar=name == "f1")
        if trainer.sanity_checking or not trainer.is_global_zero:
            return
        step, better = trainer.global_step, scores["f1"] > self.best
        self.best = max(self.best, scores["f1"])
        header = build_header(self.experiment, {**scores, "step": step})
        weights, arguments = pl_module.network.state_dict(), network_arguments(self.experiment)
        for name in (NEWEST, BEST) if better else (NEWEST,):
            save_checkpoint(self.folder / name, weights, header, arguments)
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


class MovingAverage(WeightAveraging):
    """Keeps an exponential moving average of the weights that forgets the random start.

    The decay begins small and grows with the number of updates. With a constant one of 0.998 a fifth of the
    weights were still those of the first step after 750, and validation saw a network that found nothing.

    Args:
        decay: The decay in the end.
    """

    def __init__(self, decay: float) -> None:
        super().__init__(multi_avg_fn=averaging(decay))

    def on_fit_start(self, trainer: Trainer, pl_module: Any) -> None:
        """Moves the average to the device: Lightning makes it before it moves the module there.

        The number of updates stays with the CPU, which decides with it at each step what to do.
        """
        assert self._average_model is not None
        self._average_model.module.to(pl_module.device)


def averaging(decay: float) -> Callable[[list[Tensor], list[Tensor], Tensor | int], None]:
    """Gives the update of averages, in place: all weights in a few kernels, and nothing waits for a GPU."""

    @torch.no_grad()
    def update(averages: list[Tensor], weights: list[Tensor], count: Tensor | int) -> None:
        count = torch.as_tensor(count).double()
        now = ((1 + count) / (10 + count)).clamp_max(decay)
        if not averages[0].is_floating_point():  # counts of batches
            now = now.float()
            for average, current in zip(averages, weights, strict=True):
                average.copy_(now * average + (1 - now) * current)
            return
        kept, taken = (share.to(averages[0].dtype) for share in (now, 1 - now))
        torch._foreach_mul_(averages, kept)
        torch._foreach_add_(averages, torch._foreach_mul(weights, taken))

    return update


def build_header(experiment: Experiment, metrics: Mapping[str, float]) -> Header:
    """Gives the header of the model that an experiment trains."""
    data, model = experiment.data, experiment.model
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
        postprocess=header_postprocess(experiment, metrics["threshold"]),
        metrics=dict(metrics),
        commit=git_commit(),
    )


def header_postprocess(experiment: Experiment, threshold: float) -> dict[str, Any]:
    """Gives the post-processing of an experiment's model, with a threshold where the experiment has none."""
    postprocess = experiment.postprocess.model_dump()
    if postprocess["threshold"] is None:
        postprocess["threshold"] = threshold
    if not postprocess["flip"]:
        del postprocess["flip"]  # earlier versions do not know it, and refuse a file that has it
    return postprocess


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
