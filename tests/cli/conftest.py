from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from yolino.cli import main

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Run:
    """Runs `yolino` in an empty folder; gives its exit code and what it wrote to stdout and stderr."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")

    def run_yolino(*arguments: object) -> tuple[int, str, str]:
        capfd.readouterr()
        code = main([str(argument) for argument in arguments])
        return code, *capfd.readouterr()

    return run_yolino


@pytest.fixture
def model(tiny_model: Path, tmp_path: Path) -> Path:
    """The tiny model, in the folder of the test."""
    return Path(shutil.copy(tiny_model, tmp_path / "tiny.onnx"))


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    """A bright image of 256x256 pixels."""
    path = tmp_path / "photo.jpg"
    cv2.imwrite(str(path), np.full((256, 256, 3), 200, np.uint8))
    return path
