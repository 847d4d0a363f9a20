"""One network out of several that were trained from one start: the mean of their weights.

Fine-tunings of one network that differ in their seed end in one valley of the loss. The mean of their weights
lies nearer to its middle than each of them, and costs no time in use (Wortsman et al., Model soups, 2022).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import torch
from lightning.pytorch import Trainer
from torch import Tensor
from torch.nn.modules.batchnorm import _BatchNorm
from torch.utils.data import DataLoader

from yolino.config import Experiment, load_experiment
from yolino.header import Header
from yolino.model.checkpoint import load_checkpoint, save_checkpoint
from yolino.model.network import Network
from yolino.training.callbacks import build_header
from yolino.training.checks import check_experiment
from yolino.training.loaders import Batches, build_loaders, trains_on_cuda
from yolino.training.module import TrainingModule, network_arguments
from yolino.training.run import quiet, with_licence
from yolino.training.settings import SETTINGS
from yolino.training.waiting import from_worker

SUFFIX = ".safetensors"
# The average of networks from different starts finds less than the best of them (the default model and a run
# that shared its random weights: .94 of its F1; others: .23), that of networks from one start about as much.
LEAST_SHARE = 0.95
_SAME = ("size", "fit", "scale", "stride", "predictors", "representation", "classes", "directed")
_ONE_KIND = "only networks of one kind have an average."

Progress = Callable[[Sequence[int], str], Iterator[int]]


class Averaged(NamedTuple):
    """What an averaging wrote, and what it measured on the validation data.

    Attributes:
        path: The checkpoint.
        members: `Validation.scores` of each of the networks, in their order.
        scores: Those of their average.
    """

    path: Path
    members: tuple[Mapping[str, float], ...]
    scores: Mapping[str, float]


def average(
    checkpoints: Sequence[str | Path],
    out: str | Path,
    *,
    config: str | Path | None = None,
    overrides: Sequence[str] = (),
    images: int = 960,
    skip_broken: bool = False,
    progress: Progress = lambda indices, title: iter(indices),
) -> Averaged:
    """Writes the checkpoint of the average of several networks, and scores it beside them.

    Args:
        checkpoints: Two or more, trained from one start with `training.start_from`, or in one run.
        out: The checkpoint to write.
        config: The experiment file with the training and validation data and the post-processing; by default
            the one that training left beside the first checkpoint. What `yolino tune` changed in a checkpoint
            is not in it.
        overrides: `key=value` changes to it.
        images: Training images that the statistics of the normalization are measured on.
        skip_broken: Whether to leave out labels that cannot be read.
        progress: Wraps indices, to show a progress bar with a title.

    Raises:
        FileNotFoundError: A file is missing.
        ValueError: A mistake in what was given, or the average finds less than the best of its members.
    """
    out, files = Path(out), [Path(file) for file in checkpoints]
    _check_names(files, out)
    loaded = [load_checkpoint(file) for file in files]
    settings = _settings(config, files[0])
    experiment = _offline(with_licence(load_experiment(settings, overrides)))
    if experiment.training.threads:
        torch.set_num_threads(experiment.training.threads)
    header, module = check_experiment(experiment), TrainingModule(experiment)
    for file, (network, other) in zip(files, loaded, strict=True):
        _check_finite(network.state_dict(), file)
        _check_same(other, file, header, settings)
        _check_fits(network, file, module.network, settings)
    batches = -(-images // experiment.training.batch_size)
    loader, val_loader = _loaders(experiment, module.network, batches, skip_broken)

    def score(weights: Mapping[str, Tensor]) -> Mapping[str, float]:
        module.network.load_state_dict(weights)
        return validate(module, val_loader)

    weights = [network.state_dict() for network, _ in loaded]
    members = tuple(score(weights[i]) for i in progress(range(len(weights)), "Scoring each"))
    module.network.load_state_dict(mean_weights(weights))
    measure_statistics(module, loader, batches, progress)
    scores = validate(module, val_loader)
    _check_valley(members, scores)
    header = _header(experiment, [header for _, header in loaded], scores)
    save_checkpoint(out, module.network.state_dict(), header, network_arguments(experiment))
    return Averaged(out, members, scores)


def mean_weights(members: Sequence[Mapping[str, Tensor]]) -> dict[str, Tensor]:
    """Gives the mean of the weights by name, summed in 64 bits; counts are those of the first."""
    return {
        name: torch.stack([member[name].double() for member in members]).mean(0).to(first.dtype)
        if first.is_floating_point()
        else first.clone()
        for name, first in members[0].items()
    }


@torch.no_grad()
def measure_statistics(
    module: TrainingModule,
    loader: Batches,
    batches: int,
    progress: Progress = lambda indices, title: iter(indices),
) -> None:
    """Measures mean and variance of all batch normalizations anew, on augmented training images.

    Those of an average are not the average of those of its members. Frozen parts keep theirs.
    """
    network = module.network.eval()  # no dropout: the features are those in use
    frozen = {id(part) for root in module.frozen for part in root.modules()}
    norms = [m for m in network.modules() if isinstance(m, _BatchNorm) and id(m) not in frozen]
    momenta = [norm.momentum for norm in norms]
    for norm in norms:
        norm.train()
        norm.reset_running_stats()
        norm.momentum = None  # the mean over all batches
    network.to("cuda" if trains_on_cuda(module.experiment) else "cpu")
    device = next(network.parameters()).device
    try:
        for _, batch in zip(progress(range(batches), "Measuring the features"), loader, strict=False):
            network(batch.images.to(device).float())
    except (OSError, ValueError) as error:
        raise from_worker(error) from error
    for norm, momentum in zip(norms, momenta, strict=True):
        norm.momentum = momentum
    network.eval()


def validate(module: TrainingModule, loader: DataLoader[Any]) -> Mapping[str, float]:
    """Gives the validation scores of a network, computed as while it trains."""
    training = module.experiment.training
    with quiet():
        trainer = Trainer(
            accelerator=training.accelerator,
            devices=1,
            precision=training.precision,
            logger=False,
            enable_progress_bar=False,
            enable_model_summary=False,
            enable_checkpointing=False,
        )
        trainer.validate(module, loader, verbose=False)
    return module.validation_scores()


def _check_names(files: Sequence[Path], out: Path) -> None:
    if len(files) < 2:
        raise ValueError(f"An average needs two or more checkpoints, but was given {len(files)}.")
    if other := next((file for file in files if file.exists() and not _is_checkpoint(file)), None):
        raise ValueError(
            f"{other} is no checkpoint: give the last{SUFFIX} or best{SUFFIX} that `yolino train` left."
        )
    places = [file.resolve() for file in files]
    if twice := next((file for i, file in enumerate(files) if places[i] in places[:i]), None):
        raise ValueError(f"{twice} is given twice: each checkpoint counts once.")
    if out.suffix != SUFFIX or out.is_dir():
        raise ValueError(f"{out} must be a file that ends in {SUFFIX}: an average is a checkpoint.")
    if out.resolve() in places:
        raise ValueError(f"This would overwrite its source {out}: name another file to write.")


def _is_checkpoint(file: Path) -> bool:
    return file.is_file() and file.suffix == SUFFIX


def _check_finite(weights: Mapping[str, Tensor], file: Path) -> None:
    if not all(bool(tensor.isfinite().all()) for tensor in weights.values()):
        raise ValueError(f"{file} holds weights that are not finite: its training failed, so leave it out.")


def _settings(config: str | Path | None, first: Path) -> Path:
    """Gives the experiment file: the one named, or the one beside the first checkpoint."""
    if config is not None:
        return Path(config)
    beside = first.parent / SETTINGS
    if not beside.is_file():
        raise FileNotFoundError(
            f"There is no {SETTINGS} beside {first}, as training leaves it: name its experiment file with "
            "--config."
        )
    return beside


def _offline(experiment: Experiment) -> Experiment:
    """Gives the experiment without weights of a backbone to load, as all come from the checkpoints."""
    model = experiment.model
    arguments = {key: value for key, value in model.backbone_args.items() if key != "weights"}
    changes = {"pretrained": False, "backbone_args": arguments}
    return experiment.model_copy(update={"model": model.model_copy(update=changes)})


def _check_same(header: Header, file: Path, first: Header, first_file: Path) -> None:
    """Complains where what two networks see or say does not mean the same."""
    for key in _SAME:
        mine, other = getattr(header, key), getattr(first, key)
        if mine != other:
            raise ValueError(
                f"{file} has the {key} {_shown(mine)}, but {first_file} has {_shown(other)}: {_ONE_KIND}"
            )


def _check_fits(network: Network, file: Path, first: Network, first_file: Path) -> None:
    mine, other = network.state_dict(), first.state_dict()
    for name in sorted(mine.keys() ^ other.keys()) or sorted(mine):
        if name not in mine or name not in other or mine[name].shape != other[name].shape:
            raise ValueError(
                f"{file} and {first_file} have different networks (they differ in {name}): {_ONE_KIND}"
            )


def _shown(value: Any) -> str:
    return str(list(value) if isinstance(value, tuple) else value)


def _loaders(
    experiment: Experiment, network: Network, batches: int, skip_broken: bool
) -> tuple[Batches, DataLoader[Any]]:
    """Gives the loaders of so many training batches, and of the validation data."""
    training = experiment.training.model_copy(update={"steps": batches, "validate_every": batches})
    short = experiment.model_copy(update={"training": training})
    return build_loaders(short, border=network.representation.to_border, skip_broken=skip_broken)


def _check_valley(members: Sequence[Mapping[str, float]], scores: Mapping[str, float]) -> None:
    each = [member["line_f1"] for member in members]
    if scores["line_f1"] < LEAST_SHARE * max(each):
        raise ValueError(
            f"The average finds less (F1 of lines {scores['line_f1']:.3f}) than the best of its members "
            f"({', '.join(f'{one:.3f}' for one in each)}), so nothing was written: an average needs "
            "checkpoints of one run, or of runs that began from one checkpoint (training.start_from), all of "
            "them good."
        )


def _header(experiment: Experiment, headers: Sequence[Header], scores: Mapping[str, float]) -> Header:
    """Gives the header of the average, with the licences and the data of all its members."""
    return dataclasses.replace(
        build_header(experiment, scores),
        licence=joined_parts([experiment.data.licence, *(header.licence for header in headers)]),
        data=joined_parts([experiment.data.description, *(header.data for header in headers)]),
        metrics={**scores, "averaged": len(headers)},
    )


def joined_parts(texts: Sequence[str]) -> str:
    """Gives the parts of all texts, each once."""
    parts = list(dict.fromkeys(part for text in texts for part in text.split("; ")))
    return "; ".join(part for part in parts if part != "unknown" or len(parts) == 1)


__all__ = ["Averaged", "average", "joined_parts", "mean_weights", "measure_statistics", "validate"]
