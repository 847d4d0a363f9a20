"""Drawn scenes in files: each is drawn once, not whenever it is needed."""

from __future__ import annotations

import logging
from io import BytesIO
from pathlib import Path
from tokenize import TokenError
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from yolino.datasets import Synthetic
from yolino.io import write_atomic
from yolino.training.cache import INSTEAD
from yolino.types import Polylines, Sample

logger = logging.getLogger(__name__)
_LABELS = 2000  # bytes that the labels of a usual scene and the heads of its arrays take


class KeptScenes:
    """The scenes of a synthetic dataset, read from files where they have been drawn before.

    A folder holds what has the same kind, seed and size and is drawn by the same code, a file for each scene.
    Files are either wholly there or not at all, so processes may fill one folder at the same time, and may be
    killed. Nothing is ever removed.

    Args:
        scenes: The dataset.
        folder: Where its folder is made.
    """

    def __init__(self, scenes: Synthetic, folder: Path) -> None:
        self.scenes, self.folder = scenes, folder / scenes.key
        self.classes, self.directed = scenes.classes, scenes.directed

    def __len__(self) -> int:
        return len(self.scenes)

    def __getitem__(self, i: int) -> Sample:
        """Gives a scene, the same as the dataset gives.

        Raises:
            IndexError: There are not so many.
            OSError: It cannot be written.
        """
        if not -len(self) <= i < len(self):
            return self.scenes[i]  # says what is wrong
        i = int(i) % len(self)
        file = self.folder / f"{i}.npy"
        found = _read(file)
        if found is not None:
            image, vertices, offsets, labels = found
            return Sample(self.scenes.name(i), image, Polylines(vertices, offsets, labels=labels))
        scene = self.scenes[i]
        buffer = BytesIO()
        lines = scene.polylines
        for array in (np.asarray(scene.image), lines.vertices, lines.offsets, lines.labels):
            np.save(buffer, array, allow_pickle=False)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            write_atomic(file, buffer.getvalue())
        except OSError as error:
            raise OSError(f"{error} {INSTEAD}") from None
        return scene

    def expected(self, draws: int) -> tuple[int, int]:
        """Gives the bytes of the scenes that so many draws need at most, and of those not there yet."""
        count = min(draws, len(self))
        there = sum(1 for _ in self.folder.glob("*.npy"))
        each = 3 * self.scenes.size[0] * self.scenes.size[1] + _LABELS
        return count * each, max(count - there, 0) * each


def _read(file: Path) -> list[NDArray[Any]] | None:
    """Gives pixels, vertices, offsets and labels in a file, or None if it is missing or damaged."""
    try:
        with file.open("rb") as stream:
            return [np.load(stream, allow_pickle=False) for _ in range(4)]
    except FileNotFoundError:
        return None
    except (ValueError, EOFError, TokenError, BadZipFile):  # as NumPy takes what is no array
        logger.warning("%s is damaged, and written anew", file)
        return None


__all__ = ["KeptScenes"]
