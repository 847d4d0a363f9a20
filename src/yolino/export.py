"""Export: a checkpoint becomes an ONNX file with decoding, normalization and header inside."""

from __future__ import annotations

import json
import logging
import tempfile
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnx
import torch

from yolino.config import override
from yolino.header import Header
from yolino.inference.engines import OnnxEngine
from yolino.io import write_atomic
from yolino.model.checkpoint import load_checkpoint
from yolino.model.engine import Exportable, TorchEngine
from yolino.model.network import Network

logger = logging.getLogger(__name__)
FORMATS = ("onnx",)
TOLERANCE_PX = 1e-3
TOLERANCE_SCORE = 1e-4


def export(
    checkpoint: str | Path,
    *,
    format: str = "onnx",
    out: str | Path | None = None,
    changes: Sequence[str] = (),
) -> Path:
    """Writes the network of a checkpoint as one file that needs no torch.

    The file is run beside the torch network before it gets its name: end points must agree to 1e-3 px.

    Args:
        checkpoint: A `.safetensors` file of `yolino train`.
        format: `onnx`.
        out: The file to write; beside the checkpoint if None.
        changes: `key=value` changes to the header, such as `postprocess.threshold=0.3` after tuning.

    Returns:
        The file that was written.

    Raises:
        ValueError: Unknown format, or a checkpoint that cannot be read.
        RuntimeError: The exported network disagrees with torch.
    """
    if format not in FORMATS:
        raise ValueError(f"format {format!r} is unknown; use one of {', '.join(FORMATS)}.")
    network, header = load_checkpoint(checkpoint)
    header = changed_header(header, changes)
    out = Path(out) if out is not None else Path(checkpoint).with_suffix(".onnx")
    data = onnx_bytes(network, header)
    with tempfile.TemporaryDirectory() as folder:
        trial = Path(folder) / "model.onnx"
        trial.write_bytes(data)
        _compare(TorchEngine.of(network, header), OnnxEngine(trial, device="cpu"), header)
    write_atomic(out, data)
    return out


def changed_header(header: Header, changes: Sequence[str]) -> Header:
    """Gives the header with `key=value` changes.

    Raises:
        ValueError: A change is not of that form, names an unknown key, or has a value that is not allowed.
    """
    values = json.loads(header.to_json())
    for change in changes:
        override(values, change)
    return Header.from_json(json.dumps(values)) if changes else header


def onnx_bytes(network: Network, header: Header) -> bytes:
    """Gives the network as ONNX with a dynamic batch and the header as metadata `yolino`."""
    names = ["endpoints", "scores", "probabilities"][: 3 if network.num_classes else 2]
    example = torch.zeros(2, *header.size, 3, dtype=torch.uint8)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the tracer: the size is constant on purpose
        file = Path(folder) / "model.onnx"
        torch.onnx.export(
            Exportable(network, header.size).eval(),
            (example,),
            str(file),
            input_names=["images"],
            output_names=names,
            dynamic_axes={name: {0: "batch"} for name in ["images", *names]},
            opset_version=17,
            dynamo=False,
        )
        model = onnx.load(str(file))
    entry = model.metadata_props.add()
    entry.key, entry.value = "yolino", header.to_json()
    onnx.checker.check_model(model)
    serialized: bytes = model.SerializeToString()
    return serialized


def _compare(torch_engine: TorchEngine, onnx_engine: OnnxEngine, header: Header) -> None:
    """Runs both on random pixels.

    Raises:
        RuntimeError: They differ by more than the tolerance.
    """
    images = np.random.default_rng(0).integers(0, 256, (2, *header.size, 3), dtype=np.uint8)
    ours, theirs = torch_engine(images), onnx_engine(images)
    pixels = float(np.abs(ours[0] - theirs[0]).max())
    scores = float(np.abs(ours[1] - theirs[1]).max())
    if pixels > TOLERANCE_PX or scores > TOLERANCE_SCORE:
        raise RuntimeError(
            f"The exported network differs from torch by {pixels:.2g} px and {scores:.2g} in score."
        )
    logger.info("exported network equals torch to %.1e px", pixels)
