"""`yolino train`: from an experiment file to `best.safetensors`, resumable at any time."""

from __future__ import annotations

import logging
import os
import subprocess
import warnings
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import torch
import yaml
from lightning.pytorch import Trainer, seed_everything
from lightning.pytorch.callbacks import (
    Callback,
    EarlyStopping,
    ModelCheckpoint,
    TQDMProgressBar,
    WeightAveraging,
)
from lightning.pytorch.loggers import CSVLogger, TensorBoardLogger
from lightning.pytorch.plugins.io import TorchCheckpointIO
from torch import Tensor
from torch.utils.data import DataLoader

from yolino.config import Experiment, Source, load_experiment
from yolino.grid import Grid
from yolino.header import Header
from yolino.io import write_atomic
from yolino.model.checkpoint import save_checkpoint
from yolino.training.augment import Augment
from yolino.training.data import (
    Batch,
    EndlessSampler,
    Examples,
    build_augment,
    build_dataset,
    collate_examples,
)
from yolino.training.module import TrainingModule, network_arguments
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
    """Gives the header of the model that an experiment trains, with the threshold best in validation."""
    data, model = experiment.data, experiment.model
    postprocess = experiment.postprocess.model_dump()
    if "threshold" in metrics:
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


def build_examples(
    experiment: Experiment, sources: Sequence[Source], augment: Augment, *, border: bool, mixed: bool
) -> Examples:
    """Gives the examples of the sources: mixed by weight for training, one after the other for validation."""
    data = experiment.data
    return Examples(
        [build_dataset(source, data.root, data.classes) for source in sources],
        [source.weight for source in sources] if mixed else None,
        augment,
        Grid(data.size, 32 >> experiment.model.upsample),
        border=border,
        classes=data.classes,
        seed=experiment.training.seed,
    )


def build_loaders(
    experiment: Experiment,
    *,
    border: bool,
    step: Callable[[], int] = lambda: 0,
    rank: int = 0,
    world_size: int = 1,
) -> tuple[DataLoader[Batch], DataLoader[Batch]]:
    """Gives the training and the validation loader; `step` tells the steps done when an epoch begins."""
    data, training = experiment.data, experiment.training
    augment = build_augment(experiment.augment, data.size, data.fit)
    train = build_examples(experiment, data.train, augment, border=border, mixed=True)
    val = build_examples(experiment, data.val, Augment(data.size, fit=data.fit), border=border, mixed=False)
    sampler = EndlessSampler(
        training.validate_every * training.batch_size,
        lambda: step() * training.batch_size,
        rank=rank,
        world_size=world_size,
    )
    shared: dict[str, Any] = {"batch_size": training.batch_size, "collate_fn": collate_examples}
    workers: dict[str, Any] = {"num_workers": training.workers, "persistent_workers": training.workers > 0}
    return (
        DataLoader(train, sampler=sampler, worker_init_fn=_single_thread, **workers, **shared),  # type: ignore[arg-type]
        DataLoader(val, shuffle=False, **shared),
    )


def _single_thread(worker: int) -> None:
    """Keeps OpenCV's threads of several workers from fighting for the same cores."""
    import cv2

    cv2.setNumThreads(0)


def build_trainer(
    experiment: Experiment, folder: Path, callbacks: Sequence[Callback], **changes: Any
) -> Trainer:
    """Gives Lightning's trainer for an experiment; an epoch is the span between two validations."""
    training = experiment.training
    every: list[Callback] = [*callbacks]
    if training.ema_decay:
        every.append(WeightAveraging(avg_fn=moving_average(training.ema_decay)))
    every.append(
        ModelCheckpoint(dirpath=folder, filename=LAST.removesuffix(".ckpt"), enable_version_counter=False)
    )
    if training.patience:
        every.append(EarlyStopping("val/f1", patience=training.patience, mode="max"))
    if changes.get("enable_progress_bar", True):
        every.append(TQDMProgressBar())
    loggers = [
        TensorBoardLogger(folder, name="", version="tensorboard"),
        CSVLogger(folder, name="", version="csv"),
    ]
    return Trainer(
        max_steps=training.steps,
        accelerator=training.accelerator,
        devices=training.devices,
        precision=training.precision,
        gradient_clip_val=training.clip,
        callbacks=every,
        logger=loggers,
        plugins=[AtomicCheckpointIO()],
        use_distributed_sampler=False,
        num_sanity_val_steps=0,
        log_every_n_steps=10,
        default_root_dir=folder,
        **changes,
    )


def train(config: str | Path, overrides: Sequence[str] = (), *, progress: bool = True) -> Path:
    """Trains the experiment of a file; goes on where an earlier, killed run of the same name stopped.

    Args:
        config: The experiment file.
        overrides: `key=value` changes to it.
        progress: Whether to show a bar with the remaining time.

    Returns:
        The checkpoint with the best validation F1.

    Raises:
        FileNotFoundError: The experiment file or the data is missing.
        ValueError: A mistake in the file, or an earlier run of that name with other settings.
    """
    experiment = load_experiment(config, overrides)
    folder = experiment.out / experiment.name
    _claim(folder, experiment)
    seed_everything(experiment.training.seed, verbose=False)
    if experiment.training.threads:
        torch.set_num_threads(experiment.training.threads)
    module = TrainingModule(experiment)
    rank, world_size = int(os.environ.get("RANK", "0")), int(os.environ.get("WORLD_SIZE", "1"))
    border = module.network.representation.to_border
    loader, val_loader = build_loaders(
        experiment, border=border, step=lambda: int(trainer.global_step), rank=rank, world_size=world_size
    )
    assert isinstance(val_loader.dataset, Examples)
    callbacks = [
        Pictures(val_loader.dataset, experiment.postprocess.threshold),
        KeepBest(experiment, folder),
    ]
    trainer = build_trainer(
        experiment, folder, callbacks, enable_progress_bar=progress, enable_model_summary=False
    )
    last = folder / LAST
    if last.is_file():
        logger.info("going on from %s", last)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*does not have many workers.*")
        warnings.filterwarnings("ignore", ".*Checkpoint directory .* exists and is not empty.*")
        trainer.fit(module, loader, val_loader, ckpt_path=str(last) if last.is_file() else None)
    return folder / BEST


def _claim(folder: Path, experiment: Experiment) -> None:
    """Writes the settings into the run's folder, or checks that they are those of the run to go on with.

    Raises:
        ValueError: The folder holds a run with other settings (the number of steps may grow).
    """
    file = folder / "experiment.yaml"
    settings = experiment.model_dump(mode="json")
    if file.is_file() and (folder / LAST).is_file():
        before = yaml.safe_load(file.read_text(encoding="utf-8"))
        changed = _differences(before, settings)
        if changed:
            raise ValueError(
                f"{folder} holds a run with other settings ({', '.join(changed)}); "
                "give this one another name=..., or delete that folder."
            )
    folder.mkdir(parents=True, exist_ok=True)
    write_atomic(file, yaml.safe_dump(settings, sort_keys=False))


# What may change between a run and its continuation without making it another experiment.
_FREE = (
    "training.steps",
    "training.workers",
    "training.threads",
    "training.devices",
    "training.accelerator",
    "out",
)


def _differences(a: Any, b: Any, key: str = "") -> list[str]:
    """Names the keys whose values differ."""
    if isinstance(a, dict) and isinstance(b, dict):
        names = list(dict.fromkeys([*a, *b]))
        return [d for n in names for d in _differences(a.get(n), b.get(n), f"{key}.{n}".lstrip("."))]
    return [] if a == b or key in _FREE else [key]
