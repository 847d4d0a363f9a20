"""Synthetic data that needs no download: highway pictures and generic shapes, the same for the same seed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from yolino.datasets.synthetic_road import CLASSES as ROAD_CLASSES
from yolino.datasets.synthetic_road import road_scene
from yolino.datasets.synthetic_shapes import CLASSES as SHAPE_CLASSES
from yolino.datasets.synthetic_shapes import shapes_scene
from yolino.types import Sample

SCENES: dict[str, tuple[Callable[..., Sample], tuple[str, ...]]] = {
    "road": (road_scene, ROAD_CLASSES),
    "shapes": (shapes_scene, SHAPE_CLASSES),
}
"""What can be drawn: the function that draws one scene, and its classes."""


class Synthetic:
    """A dataset of drawn scenes.

    Sample `i` depends on the seed and on `i` alone: not on the order of access, the process or the length.

    Args:
        kind: `road` (highway pictures with lane boundaries) or `shapes` (generic curves).
        length: Number of samples.
        seed: Not negative; another seed gives other scenes.
        size: Height and width of the images in pixels.

    Raises:
        ValueError: If the kind is unknown, or length, seed or size are out of range.
    """

    directed = True

    def __init__(
        self, kind: str = "road", length: int = 1000, seed: int = 0, size: Sequence[int] = (320, 640)
    ) -> None:
        if kind not in SCENES:
            raise ValueError(
                f"kind is {kind!r}, but only {', '.join(sorted(SCENES))} are known; choose one of them."
            )
        if length < 1 or seed < 0:
            raise ValueError(
                f"length is {length} and seed {seed}, but a positive length and a seed from 0 on are needed."
            )
        if min(size) < 1:
            raise ValueError(f"size is {tuple(size)}, but height and width must be at least 1 pixel.")
        self.kind, self.length, self.seed = kind, int(length), int(seed)
        self.size = (int(size[0]), int(size[1]))
        self._scene, self.classes = SCENES[kind]

    def __len__(self) -> int:
        return self.length

    def __getitem__(self, i: int) -> Sample:
        if not -self.length <= i < self.length:
            raise IndexError(f"Sample {i} was asked for, but there are {self.length}.")
        i = int(i) % self.length
        rng = np.random.default_rng((self.seed, i))
        return replace(self._scene(rng, self.size), name=f"{self.kind}-{self.seed}-{i}")
