"""What is exported: a checkpoint, an exported model, or a packaged one."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from yolino.export.metadata import changed_header, with_header
from yolino.export.packages import needed
from yolino.header import Header
from yolino.inference.engines import OnnxEngine
from yolino.inference.loading import model_path

# What the graph of an exported file has built in.
_BUILT_IN = ("size", "stride", "predictors", "representation")


@dataclass(frozen=True)
class Source:
    """A network and what is said about it.

    Attributes:
        path: The file that it is from.
        packaged: Whether that is a part of the installation.
        data: The network as ONNX, without a header.
        header: Its header, changed as asked for; `precision` is that of `data`.
    """

    path: Path
    packaged: bool
    data: bytes
    header: Header


def read_source(source: str | Path, changes: Sequence[str] = ()) -> Source:
    """Gives the network of a checkpoint (with torch), or of an exported model (without).

    Args:
        source: A `.safetensors` or `.onnx` file, or the name of a packaged model.
        changes: `key=value` changes to the header.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It cannot be read, or a change is not allowed.
        ModuleNotFoundError: It is a checkpoint and torch is not installed, or the package onnx is missing.
        RuntimeError: The network disagrees with torch after the conversion.
    """
    path = model_path(source)
    kind = path.suffix.lower()
    if kind == ".safetensors":
        return _from_checkpoint(path, changes)
    if kind != ".onnx":
        raise ValueError(
            f"The source is {path}, but only a checkpoint (.safetensors) or an exported .onnx file can be "
            "exported."
        )
    needed("onnx", "Exporting")
    old = OnnxEngine(path, device="cpu").header
    header = changed_header(old, changes)
    different = [key for key in _BUILT_IN if getattr(header, key) != getattr(old, key)]
    if len(header.classes) != len(old.classes):
        different.append("classes")
    if different:
        raise ValueError(
            f"The {different[0]} of {path} is built into its graph and cannot be changed: export the "
            "checkpoint again."
        )
    return Source(path, path != Path(source), with_header(path.read_bytes(), None), header)


def _from_checkpoint(path: Path, changes: Sequence[str]) -> Source:
    if path.is_file() and any(map(_is_missing, ("torch", "safetensors"))):
        raise ModuleNotFoundError(
            f"The checkpoint {path} needs torch: pip install 'yolino[train]', or give its .onnx file."
        )
    if not path.is_file():
        raise FileNotFoundError(
            f"The checkpoint {path} does not exist; `yolino train` writes best.safetensors."
        )
    network, header = importlib.import_module("yolino.model.checkpoint").load_checkpoint(path)
    header = changed_header(header, changes)
    data = importlib.import_module("yolino.export.graph").checked_bytes(network, header)
    return Source(path, False, with_header(data, None), header)


def _is_missing(name: str) -> bool:
    return importlib.util.find_spec(name) is None


__all__ = ["Source", "read_source"]
