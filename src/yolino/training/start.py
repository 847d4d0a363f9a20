"""What training begins with: the weights of a checkpoint, as far as they mean the same."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor

from yolino.header import Header
from yolino.model.checkpoint import load_checkpoint
from yolino.model.network import Network

logger = logging.getLogger(__name__)
_ALIKE = ("neck", "representation")


def start_from(network: Network, path: Path, classes: Sequence[str] = ()) -> None:
    """Gives a network the weights of a checkpoint that fit it, and logs which those are.

    The backbone is taken over as a whole, the neck as far as it is the same (a second upsampling block is
    new). The rows of the head are, if neck, size of the cells and representation are the same: parameters and
    confidence of each predictor that both have, and what it says about each class of the same name. The rest
    begins as new.

    Args:
        network: Is changed.
        path: The checkpoint.
        classes: Names of the network's classes.

    Raises:
        FileNotFoundError: No such file.
        ValueError: The file is no checkpoint, or its backbone is another one.
    """
    source, header = _load(path)
    mine, theirs = _by_module(network), _by_module(source)
    fits = {name for name, tensors in mine.items() if _shapes(tensors) == _shapes(theirs.get(name, {}))}
    if "backbone" not in fits:
        raise ValueError(
            f"training.start_from: nothing of {path} ({header.name}) fits, as its backbone is another one "
            "than this experiment's; use its model.backbone and model.backbone_args, or none to start from."
        )
    network.load_state_dict({k: v for name in fits for k, v in theirs[name].items()}, strict=False)
    told = _Told(["backbone"], [])
    whole = fits == mine.keys()
    if whole or fits > {"backbone"}:
        told.taken.append("neck" if whole else "part of the neck")
    if not whole:
        told.new.append("the rest of it" if fits > {"backbone"} else "neck")
    if whole and _same_head(network, source):
        _take_rows(network, source, classes, header.classes, told)
    else:
        told.new.append("head")
    new = f"; new: {', '.join(told.new)}" if told.new else ""
    logger.info("begins with %s of %s (%s)%s", ", ".join(told.taken), path, header.name, new)


class _Told(NamedTuple):
    """What the user is told: what was taken over, and what begins as new."""

    taken: list[str]
    new: list[str]


def _load(path: Path) -> tuple[Network, Header]:
    if path.suffix != ".safetensors" and (path.is_file() or not path.suffix):
        raise ValueError(
            f"training.start_from is {path}, but training begins with a checkpoint: give the "
            "best.safetensors that `yolino train` wrote (an exported model cannot be trained further)."
        )
    try:
        return load_checkpoint(path)
    except FileNotFoundError as error:
        raise FileNotFoundError(f"training.start_from: {error}") from error
    except ValueError as error:
        raise ValueError(f"training.start_from: {error}") from error


def _by_module(network: Network) -> dict[str, dict[str, Tensor]]:
    """Gives the tensors of the backbone, and of each block or level of the neck, by name."""
    modules: dict[str, dict[str, Tensor]] = {"backbone": {}}
    for name, tensor in network.state_dict().items():
        part, *inside = name.split(".")
        if part != "head":
            key = part if part == "backbone" else ".".join([part, *inside[:2]])
            modules.setdefault(key, {})[name] = tensor
    return modules


def _shapes(tensors: Mapping[str, Tensor]) -> dict[str, torch.Size]:
    return {name: tensor.shape for name, tensor in tensors.items()}


def _same_head(network: Network, source: Network) -> bool:
    """Tells whether a row of both heads means the same, if what comes before them is the same."""
    alike = all(type(getattr(network, part)) is type(getattr(source, part)) for part in _ALIKE)
    return alike and network.stride == source.stride


def _take_rows(
    network: Network,
    source: Network,
    classes: Sequence[str],
    known: Sequence[str],
    told: _Told,
) -> None:
    """Copies the rows of the head that mean the same, and tells what was taken and what is new."""
    predictors, g = min(network.predictors, source.predictors), network.representation.num_params
    shared = [name for name in classes if name in known]
    mine = [*range(g + 1), *(g + 1 + list(classes).index(name) for name in shared)]
    theirs = [*range(g + 1), *(g + 1 + list(known).index(name) for name in shared)]
    with torch.no_grad():
        for row, old in zip(network.head.parameters(), source.head.parameters(), strict=True):
            _rows(row, network)[:predictors, mine] = _rows(old, source)[:predictors, theirs].to(row.device)
    told.taken.extend([f"{predictors} predictors", *(f"class {name}" for name in shared)])
    told.new.extend(f"class {name}" for name in classes if name not in known)
    if network.predictors > predictors:
        told.new.append(f"{network.predictors - predictors} predictors")


def _rows(tensor: Tensor, network: Network) -> Tensor:
    """Gives a view of the head's weights or biases by predictor and output."""
    return tensor.view(network.predictors, network.outputs_per_predictor, *tensor.shape[1:])


__all__ = ["start_from"]
