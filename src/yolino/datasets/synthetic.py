"""Synthetic data that needs no download: highway pictures and generic shapes, the same for the same seed."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np

from yolino.datasets.synthetic_road import CLASSES as ROAD_CLASSES
from yolino.datasets.synthetic_road import road_scene
from yolino.datasets.synthetic_shapes import CLASSES as SHAPE_CLASSES
from yolino.datasets.synthetic_shapes import shapes_scene
from yolino.types import Polylines, Sample

SCENES: dict[str, tuple[Callable[..., Sample], tuple[str, ...]]] = {
    "road": (road_scene, ROAD_CLASSES),
    "shapes": (shapes_scene, SHAPE_CLASSES),
}
"""What can be drawn: the function that draws one scene, and its classes."""

DRAWING = ("synthetic*.py", "texture.py", "road/*.py", "../geometry.py")
"""The source files that say what is drawn, as patterns below this folder."""


class Synthetic:
    """A dataset of drawn scenes.

    Sample `i` depends on the seed and on `i` alone: not on the order of access, the process or the length.

    Args:
        kind: `road` (highway pictures with lane boundaries) or `shapes` (generic curves).
        length: Number of samples.
        seed: Not negative; another seed gives other scenes.
        size: Height and width of the images in pixels.
        classes: Names of the classes to take, in the order of their labels, or a mapping from the names of
            the scenes to these; polylines of other names are left out. None takes all.

    Raises:
        ValueError: If the kind or a class is unknown, or length, seed or size are out of range.
    """

    directed = True

    def __init__(
        self,
        kind: str = "road",
        length: int = 1000,
        seed: int = 0,
        size: Sequence[int] = (320, 640),
        *,
        classes: Sequence[str] | Mapping[str, str] | None = None,
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
        self._scene, drawn = SCENES[kind]
        self.classes, self._labels = _choose(drawn, drawn if classes is None else classes)

    def __len__(self) -> int:
        return self.length

    @property
    def key(self) -> str:
        """A name that says what is drawn: where it is the same, sample `i` is the same."""
        height, width = self.size
        labels = "".join("x" if label < 0 else str(label) for label in self._labels)
        return f"{self.kind}-{self.seed}-{height}x{width}-{labels}-{drawing_version()}"

    def __getitem__(self, i: int) -> Sample:
        if not -self.length <= i < self.length:
            raise IndexError(f"Sample {i} was asked for, but there are {self.length}.")
        i = int(i) % self.length
        rng = np.random.default_rng((self.seed, i))
        sample = self._scene(rng, self.size)
        return replace(sample, name=self.name(i), polylines=self._chosen(sample.polylines))

    def _chosen(self, lines: Polylines) -> Polylines:
        """Gives the polylines of the chosen classes with their labels."""
        labels = self._labels[lines.labels]
        return Polylines(lines.vertices, lines.offsets, lines.scores, labels)[labels >= 0]

    def name(self, i: int) -> str:
        """Gives the name of sample `i`."""
        return f"{self.kind}-{self.seed}-{i}"


def _choose(
    drawn: tuple[str, ...], wanted: Sequence[str] | Mapping[str, str]
) -> tuple[tuple[str, ...], np.ndarray]:
    """Gives the names of the labels, and the label of each class that is drawn; -1 for those left out."""
    pairs = wanted if isinstance(wanted, Mapping) else {name: name for name in wanted}
    unknown = [name for name in pairs if name not in drawn]
    if unknown or not pairs:
        problem = f"there is none {unknown[0]!r}" if unknown else "none of them is chosen"
        raise ValueError(f"The scenes have the classes {', '.join(drawn)}, but {problem}.")
    classes = tuple(dict.fromkeys(pairs.values()))
    return classes, np.array([classes.index(pairs[name]) if name in pairs else -1 for name in drawn])


@cache
def drawing_version() -> str:
    """Gives a name that changes whenever the code that draws, or a library that it draws with, changes."""
    folder = Path(__file__).parent
    code = hashlib.sha256(f"{np.__version__} {cv2.__version__}".encode())
    for pattern in DRAWING:
        for file in sorted(folder.glob(pattern)):
            code.update(file.read_bytes())
    return code.hexdigest()[:10]


__all__ = ["DRAWING", "SCENES", "Synthetic", "drawing_version"]
