"""Made-up images: what a network says about them, and what is right."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from yolino.datasets import TuSimple
from yolino.tuning.candidates import Candidates
from yolino.types import Polylines, Sample, Segments

ROWS = list(range(160, 720, 10))
SIZE = (320, 640)


class Made:
    """A dataset of no format, and without images."""

    classes = ("lane",)
    directed = True

    def __len__(self) -> int:
        return 0

    def __getitem__(self, index: int, /) -> Sample:
        raise IndexError(index)


def upright(x: float, score: float) -> Segments:
    """A line upwards in pieces of a cell, all with one score."""
    y = np.arange(320.0, 0.0, -16.0)
    points = np.stack(
        [np.stack([np.full_like(y, x), y], 1), np.stack([np.full_like(y, x), y - 16], 1)], axis=1
    )
    return Segments(points, np.full(len(y), np.float32(score), np.float64))


def image_of(name: str, *lines: tuple[float, float], truth: tuple[float, ...]) -> Candidates:
    """An image with lines at these columns, of these scores, and true ones."""
    parts = [upright(x, score) for x, score in lines]
    segments = Segments(
        np.concatenate([part.endpoints for part in parts]), np.concatenate([part.scores for part in parts])
    )
    right = Polylines.from_list([np.array([(x, 320.0), (x, 0.0)]) for x in truth])
    return Candidates(name, SIZE, right, (), segments, np.eye(3))


@pytest.fixture
def images() -> list[Candidates]:
    """Right lines have scores from .7 to .79, wrong ones from .4 to .49."""
    return [
        image_of(f"drive/{i:02d}.jpg", (100.0, 0.7 + i / 100), (400.0, 0.4 + i / 100), truth=(100.0,))
        for i in range(10)
    ]


@pytest.fixture
def write_frames(tmp_path: Path) -> Callable[..., TuSimple]:
    """Writes frames with vertical lanes at the given columns, and their labels."""

    def write(*frames: tuple[float, ...]) -> TuSimple:
        records = []
        for i, columns in enumerate(frames):
            name = f"clips/{i:02d}/20.png"
            (tmp_path / name).parent.mkdir(parents=True)
            cv2.imwrite(str(tmp_path / name), np.full((720, 1280, 3), 200, np.uint8))
            lanes = [[x] * len(ROWS) for x in columns]
            records.append({"raw_file": name, "lanes": lanes, "h_samples": ROWS})
        (tmp_path / "label_data_test.json").write_text("".join(json.dumps(one) + "\n" for one in records))
        return TuSimple(tmp_path)

    return write
