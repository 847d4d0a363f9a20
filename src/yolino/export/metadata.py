"""The header inside an ONNX file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from yolino.config import override
from yolino.export.packages import needed
from yolino.header import Header
from yolino.inference.engines import METADATA_KEY
from yolino.inference.postprocessing import build_flip, build_linker, build_nms, build_quarters


def with_header(model: Any, header: Header | None) -> bytes:
    """Gives an ONNX model, as bytes, with this header in place of its metadata; None: without any.

    Args:
        model: An `onnx.ModelProto`, or its bytes.
        header: The header.
    """
    if isinstance(model, bytes):
        model = needed("onnx", "Exporting").load_model_from_string(model)
    del model.metadata_props[:]
    if header is not None:
        entry = model.metadata_props.add()
        entry.key, entry.value = METADATA_KEY, header.to_json()
    serialized: bytes = model.SerializeToString()
    return serialized


def changed_header(header: Header, changes: Sequence[str]) -> Header:
    """Gives the header with `key=value` changes.

    Raises:
        ValueError: A change is not of that form, names an unknown key or the precision (which is what the
            weights are, not what one says), has a value that is not allowed, or makes a post-processing that
            cannot be run.
    """
    values = json.loads(header.to_json())
    for change in changes:
        if change.partition("=")[0].strip() == "precision":
            raise ValueError(f"{change!r} would not change the weights: use --precision.")
        override(values, change)
    if not changes:
        return header
    changed = Header.from_json(json.dumps(values))
    for build in (build_quarters, build_flip, build_nms, build_linker):
        build(changed)
    return changed


__all__ = ["changed_header", "with_header"]
