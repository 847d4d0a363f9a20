"""What every engine has, and the checks that they share."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import UInt8

from yolino.header import Header
from yolino.types import Output

DEVICES = ("auto", "cpu", "cuda")
PRECISIONS = ("auto", "fp32", "bf16", "fp16", "int8")
METADATA_KEY = "yolino"


@runtime_checkable
class Engine(Protocol):
    """A loaded network with the header of its file.

    It may be called from as many threads at once as it was opened for (`streams`). What it gives belongs to
    the caller: no later call changes it.

    Attributes:
        header: What the model file says about itself.
        name: What runs it and how, for people: "OpenVINO bf16".
        device: "cpu" or "cuda".
        precision: Arithmetic of the network: "fp32", "bf16", "fp16" or "int8".
        streams: How many threads may call it at once.
    """

    header: Header
    name: str
    device: str
    precision: str
    streams: int

    def __call__(self, batch: UInt8[np.ndarray, "b h w 3"], /) -> Output:
        """Gives what the network says about RGB images of its input size."""
        ...


def check_file(path: Path) -> None:
    """Raises FileNotFoundError if there is no such model file."""
    if not path.is_file():
        raise FileNotFoundError(f"The model {path} does not exist; give a model file or 'default'.")


def check_arguments(device: str, threads: int | None, streams: int) -> None:
    """Raises ValueError if an argument of an engine is not allowed."""
    if device not in DEVICES:
        raise ValueError(f"The device {device!r} is unknown; use one of {', '.join(DEVICES)}.")
    if threads is not None and threads < 1:
        raise ValueError(f"threads is {threads}, but must be at least 1 (or None: let the engine decide).")
    if streams < 1:
        raise ValueError(f"streams is {streams}, but must be at least 1.")


def read_header(text: str | None, path: Path) -> Header:
    """Gives the header that a model file carries.

    Args:
        text: The JSON text in the file's metadata; None where there is none.
        path: The file, for messages.

    Raises:
        ValueError: If there is none, or it is damaged.
    """
    if text is None:
        raise ValueError(
            f"{path} is not a YOLinO model: its metadata has no '{METADATA_KEY}' header; "
            "export one with `yolino export CHECKPOINT`."
        )
    try:
        return Header.from_json(text)
    except ValueError as error:
        raise ValueError(f"{path} has a damaged header. {error}") from error


def check_interface(
    path: Path,
    header: Header,
    inputs: dict[str, tuple[str, list[int | None]]],
    outputs: Sequence[str],
) -> list[str]:
    """Gives the names of the outputs to fetch, in the order of `Output`.

    Args:
        path: The file, for messages.
        header: What it says about itself.
        inputs: Type and shape of each input of its graph; None is a size that is free.
        outputs: Names of its outputs.

    Raises:
        ValueError: If the graph's input and outputs are not those of an exported network.
    """
    if list(inputs) != ["images"] or inputs["images"][0] != "uint8":
        raise ValueError(f"{path} must have the one input 'images' (b, h, w, 3) of uint8, but has {inputs}.")
    fixed = [edge for edge in inputs["images"][1][1:3] if edge is not None]
    if fixed and tuple(fixed) != header.size:
        raise ValueError(f"{path} takes images of {tuple(fixed)}, but its header says {header.size}.")
    wanted = ["endpoints", "scores"] + ["probabilities"] * bool(header.classes)
    if missing := [name for name in wanted if name not in outputs]:
        raise ValueError(
            f"{path} lacks the outputs {', '.join(missing)}: it has {', '.join(outputs) or 'none'}. "
            "Export the model again with `yolino export CHECKPOINT`."
        )
    return wanted


def choose_precision(wanted: str, header: Header, path: Path, allowed: Sequence[str], where: str) -> str:
    """Gives the arithmetic of a run.

    Args:
        wanted: "auto" (int8 where the file is quantized, else fp32) or what was asked for.
        header: What the file says about itself.
        path: The file, for messages.
        allowed: What the engine can do on this device.
        where: Engine and device, for messages.

    Raises:
        ValueError: The file is quantized and something else was asked for, or the other way round, or the
            engine cannot do it.
    """
    quantized = header.precision == "int8"
    if wanted not in PRECISIONS:
        raise ValueError(f"The precision {wanted!r} is unknown; use one of {', '.join(PRECISIONS)}.")
    if quantized and wanted not in ("auto", "int8"):
        raise ValueError(
            f"{path} is quantized to int8 and cannot run in {wanted}: leave out --precision, or give a file "
            "that is not quantized."
        )
    if wanted == "int8" and not quantized:
        raise ValueError(
            f"{path} is not quantized, so it cannot run in int8: write a file that is with "
            "`yolino export SOURCE --precision int8 --calibrate DATA`."
        )
    chosen = ("int8" if quantized else "fp32") if wanted == "auto" else wanted
    if chosen not in allowed:
        raise ValueError(f"{where} cannot run in {chosen}; it has {', '.join(allowed)}.")
    return chosen


def usable_cores() -> int:
    """Gives how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def cache_folder(name: str) -> Path | None:
    """Gives a folder for what engines keep between runs, made if need be; None where it cannot be written.

    It lies below `YOLINO_CACHE`, else in the user's cache folder (`XDG_CACHE_HOME`, or `~/.cache`).
    """
    base = os.environ.get("YOLINO_CACHE") or os.environ.get("XDG_CACHE_HOME")
    try:
        root = Path(base) if base else Path.home() / ".cache"
        folder = (root if os.environ.get("YOLINO_CACHE") else root / "yolino") / name
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):  # RuntimeError: nobody's home
        return None
    return folder if os.access(folder, os.W_OK) else None


__all__ = [
    "DEVICES",
    "METADATA_KEY",
    "PRECISIONS",
    "Engine",
    "cache_folder",
    "check_arguments",
    "check_file",
    "check_interface",
    "choose_precision",
    "read_header",
    "usable_cores",
]
