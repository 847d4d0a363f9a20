"""The header of a trained model."""

from __future__ import annotations

from pathlib import Path

import pytest

from yolino.config import load_experiment
from yolino.header import Header
from yolino.training.callbacks import build_header

TEXT = """
name: tiny
data:
  train: [{dataset: synthetic, options: {kind: shapes}}]
  val: [{dataset: synthetic, options: {kind: shapes}}]
"""


@pytest.mark.parametrize(("changes", "flip"), [((), None), (("postprocess.flip=true",), True)])
def test_mirrored_images_are_in_the_header_where_they_are_wanted(
    changes: tuple[str, ...], flip: bool | None, tmp_path: Path
) -> None:
    """Earlier versions refuse a header that has `flip`, so it is left out where it says no."""
    path = tmp_path / "tiny.yaml"
    path.write_text(TEXT)
    header = build_header(load_experiment(path, changes), {"threshold": 0.3})
    assert header.postprocess.get("flip") is flip
    assert header.postprocess["threshold"] == 0.3
    assert Header.from_json(header.to_json()) == header
