"""OpenVINO's files: `.xml` (the graph and the header) and `.bin` (the weights) beside it; int8 by NNCF."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path
from typing import Any

from yolino.export.calibration import Inputs
from yolino.export.formats import refuse_to_quantize
from yolino.export.onnx_format import folded
from yolino.export.packages import import_nncf, needed
from yolino.export.pairs import write_pair
from yolino.header import Header
from yolino.inference.engine_openvino import openvino_core
from yolino.inference.engines import METADATA_KEY, Engine, OpenVinoEngine

_CONVOLUTIONS = (
    "Convolution",
    "GroupConvolution",
    "ConvolutionBackpropData",
    "GroupConvolutionBackpropData",
)


class OpenVinoFormat:
    """`.xml` files, each with its `.bin` beside it."""

    suffix = ".xml"

    def check(self) -> None:
        """Raises ModuleNotFoundError if the package onnx or openvino is missing."""
        needed("onnx", "Exporting")
        needed("openvino", "Exporting to OpenVINO")

    def convert(self, data: bytes) -> Any:
        """Gives an `openvino.Model`."""
        needed("openvino", "Exporting to OpenVINO")
        return openvino_core().read_model(data)

    def quantize(self, data: bytes, inputs: Inputs) -> Any:
        """Gives the model quantized to 8 bits (see `Format`)."""
        nncf = import_nncf()
        model = self.convert(folded(data))
        heads, decoding = tail_names(model)
        count = sum(node.get_type_name() in _CONVOLUTIONS for node in model.get_ops())
        refuse_to_quantize(count, len(heads))
        with contextlib.redirect_stdout(io.StringIO()):  # its progress bars; ours is on stderr
            return nncf.quantize(
                model,
                nncf.Dataset(inputs),
                subset_size=len(inputs),
                ignored_scope=nncf.IgnoredScope(names=[*heads, *decoding], validate=False),
            )

    def save(self, model: Any, header: Header, path: Path) -> None:
        """Writes the `.xml` with the header in its `rt_info`, and the `.bin`."""
        model.set_rt_info(header.to_json(), [METADATA_KEY, "header"])
        # What `halved` made small is small already; OpenVINO's own rounding would reach the decoding, too.
        needed("openvino", "Exporting to OpenVINO").save_model(model, str(path), compress_to_fp16=False)

    def open(self, path: Path) -> Engine:
        """Gives the OpenVINO engine."""
        return OpenVinoEngine(path, device="cpu")

    def place(self, trial: Path, out: Path) -> list[Path]:
        """Gives the two files their names."""
        write_pair(out, trial.read_bytes(), trial.with_suffix(".bin").read_bytes())
        return [out, out.with_suffix(".bin")]


def tail_names(model: Any) -> tuple[list[str], list[str]]:
    """Gives the names of the convolutions of an `openvino.Model` that no other one follows, and what does."""
    heads, decoding = set(), set()
    open_nodes = [result.get_node() for result in model.outputs]
    while open_nodes:
        node = open_nodes.pop()
        name = node.get_friendly_name()
        if node.get_type_name() in _CONVOLUTIONS:
            heads.add(name)
        elif name not in decoding:
            decoding.add(name)
            open_nodes += [value.get_node() for value in node.input_values()]
    return sorted(heads), sorted(decoding)


__all__ = ["OpenVinoFormat", "tail_names"]
