"""A model with convolutions, and labelled images that it does well on."""

from __future__ import annotations

from pathlib import Path

import pytest

from convolving_model import convolving_header, make_convolving_model, write_drive
from yolino.datasets import Dataset
from yolino.datasets.description import load_description, open_split

pytest.importorskip("onnx", reason="exporting needs onnx")


@pytest.fixture(scope="session")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An exported fp32 model."""
    return make_convolving_model(tmp_path_factory.mktemp("source") / "lines.onnx", convolving_header())


@pytest.fixture(scope="session")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The data.yaml of six labelled images."""
    return write_drive(tmp_path_factory.mktemp("data") / "drive")


@pytest.fixture(scope="session")
def labelled(drive: Path) -> Dataset:
    """The images of `drive`."""
    return open_split(load_description(drive), "all")
