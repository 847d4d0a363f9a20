"""Checkpoints: weights as safetensors with a header. Nothing in them is code, so loading one runs none."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from yolino.header import Header
from yolino.io import write_atomic
from yolino.model.network import Network


def save_checkpoint(
    path: str | Path, weights: Mapping[str, Tensor], header: Header, network: Mapping[str, Any]
) -> None:
    """Writes weights, header and the arguments of `Network`, to a temporary name first."""
    tensors = {name: tensor.detach().cpu().contiguous() for name, tensor in weights.items()}
    write_atomic(
        Path(path), save(tensors, metadata={"yolino": header.to_json(), "network": json.dumps(dict(network))})
    )


def load_checkpoint(path: str | Path) -> tuple[Network, Header]:
    """Reads a checkpoint and builds its network, in evaluation mode.

    Raises:
        FileNotFoundError: No such file.
        ValueError: The file is not a safetensors file, has no header, or its weights do not fit its network.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(
            f"The checkpoint {path} does not exist; `yolino train` writes best.safetensors."
        )
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            weights = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (no mapping)
    except SafetensorError as error:
        raise ValueError(f"{path} is not a safetensors file: {error}.") from error
    if "yolino" not in metadata or "network" not in metadata:
        raise ValueError(
            f"{path} is not a checkpoint of yolino: its metadata has no header; `yolino train` writes one."
        )
    arguments = json.loads(metadata["network"]) | {"pretrained": False}
    arguments.get("backbone_args", {}).pop("weights", None)
    network = Network(**arguments)
    try:
        network.load_state_dict(weights)
    except RuntimeError as error:
        raise ValueError(
            f"The weights in {path} do not fit its network: {' '.join(str(error).split())[:300]}"
        ) from error
    return network.eval(), Header.from_json(metadata["yolino"])
