"""`yolino train`: from an experiment file to `best.safetensors`, resumable at any time."""

from __future__ import annotations

import contextlib
import logging
import warnings
from collections.abc import Iterator, Sequence
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
)
from lightning.pytorch.loggers import CSVLogger, TensorBoardLogger

from yolino.config import Experiment, load_experiment
from yolino.io import write_atomic
from yolino.training.callbacks import (
    BEST,
    LAST,
    AtomicCheckpointIO,
    KeepBest,
    MovingAverage,
    Pictures,
    ValidateLast,
)
from yolino.training.checks import check_experiment
from yolino.training.data import Examples, describe
from yolino.training.loaders import build_loaders
from yolino.training.module import TrainingModule
from yolino.training.settings import SETTINGS, changed_settings, read_settings
from yolino.training.start import start_from
from yolino.training.waiting import Waiting, advice, from_worker

logger = logging.getLogger(__name__)


def build_trainer(
    experiment: Experiment, folder: Path, callbacks: Sequence[Callback], **changes: Any
) -> Trainer:
    """Gives Lightning's trainer for an experiment; an epoch is the span between two validations."""
    training = experiment.training
    every: list[Callback] = [*callbacks, ValidateLast()]
    if training.ema_decay:
        every.append(MovingAverage(training.ema_decay))
    every.append(
        ModelCheckpoint(dirpath=folder, filename=LAST.removesuffix(".ckpt"), enable_version_counter=False)
    )
    if training.patience:
        every.append(EarlyStopping("val/f1", patience=training.patience, mode="max"))
    if changes.get("enable_progress_bar", True):
        every.append(TQDMProgressBar())
    loggers = [
        TensorBoardLogger(folder, name="", version="tensorboard"),
        CSVLogger(folder, name="csv"),
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
        log_every_n_steps=min(10, training.validate_every),
        default_root_dir=folder,
        **changes,
    )


def train(
    config: str | Path, overrides: Sequence[str] = (), *, progress: bool = True, skip_broken: bool = False
) -> Path:
    """Trains the experiment of a file; goes on where an earlier, killed run of the same name stopped.

    Args:
        config: The experiment file.
        overrides: `key=value` changes to it.
        progress: Whether to show a bar with the remaining time.
        skip_broken: Whether to leave out labels that cannot be read; otherwise they stop it before it begins.

    Returns:
        The checkpoint with the best validation F1.

    Raises:
        FileNotFoundError: The experiment file or the data is missing.
        ValueError: A mistake in the file, or an earlier run of that name with other settings.
        OSError: Something cannot be written.
    """
    experiment = with_licence(load_experiment(config, overrides))
    check_experiment(experiment)
    folder = experiment.out / experiment.name
    seed_everything(experiment.training.seed, verbose=False)
    if experiment.training.threads:
        torch.set_num_threads(experiment.training.threads)
    module = TrainingModule(experiment)
    if experiment.training.start_from is not None:
        start_from(module.network, experiment.training.start_from, experiment.data.classes)
    loader, val_loader = build_loaders(
        experiment,
        border=module.network.representation.to_border,
        place=lambda: (trainer.global_step, trainer.global_rank, trainer.world_size),
        skip_broken=skip_broken,
    )
    assert isinstance(loader.dataset, Examples)
    assert isinstance(val_loader.dataset, Examples)
    _claim(folder, experiment)
    callbacks = [
        Pictures(val_loader.dataset, experiment.postprocess.threshold or 0.5),
        KeepBest(experiment, folder),
        Waiting(loader, advice(experiment, loader.dataset)),
    ]
    with quiet():
        trainer: Trainer = build_trainer(
            experiment, folder, callbacks, enable_progress_bar=progress, enable_model_summary=False
        )
        last = folder / LAST
        if last.is_file():
            logger.info("going on from %s", last)
        try:
            trainer.fit(module, loader, val_loader, ckpt_path=str(last) if last.is_file() else None)
        except (KeyboardInterrupt, SystemExit):  # Lightning turns the first into the second
            kept = f"goes on from {last}" if last.is_file() else "begins anew: nothing was validated yet"
            logger.warning("stopped at step %d; the same command %s", trainer.global_step, kept)
            raise
        except (OSError, ValueError) as error:
            raise from_worker(error) from error
    return folder / BEST


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keeps Lightning from advertising, and from warning about what is meant."""
    for name in ("lightning.pytorch", "lightning.fabric"):
        logging.getLogger(name).setLevel(logging.WARNING)  # advertisements, and what was found or not
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*treespec, LeafSpec.*")
        warnings.filterwarnings("ignore", ".*does not have many workers.*")
        warnings.filterwarnings("ignore", ".*dataloader is not resumable.*")  # EndlessSampler knows its place
        warnings.filterwarnings("ignore", ".*Checkpoint directory .* exists and is not empty.*")
        yield


def with_licence(experiment: Experiment) -> Experiment:
    """Gives the experiment with the licences and descriptions of its training data, where it states none."""
    data = experiment.data
    found = [described for source in data.train if (described := describe(source, data.root))]
    changes = {}
    for key in ("licence", "description"):
        stated = list(dict.fromkeys(getattr(one, key) for one in found))
        if getattr(data, key) == "unknown" and stated:
            changes[key] = "; ".join(stated)
    return experiment.model_copy(update={"data": data.model_copy(update=changes)})


def _claim(folder: Path, experiment: Experiment) -> None:
    """Writes the settings into the run's folder, or checks that they are those of the run to go on with.

    Raises:
        ValueError: The folder holds a run with other settings (the number of steps may grow).
    """
    file = folder / SETTINGS
    settings = experiment.model_dump(mode="json")
    if file.is_file() and (folder / LAST).is_file():
        changed = changed_settings(read_settings(folder), settings)
        if changed := [key for key in changed if key != "training.steps"]:
            raise ValueError(
                f"{folder} holds a run with other settings ({', '.join(changed)}); "
                "give this one another name=..., or delete that folder."
            )
    folder.mkdir(parents=True, exist_ok=True)
    write_atomic(file, yaml.safe_dump(settings, sort_keys=False))
