"""The CULane benchmark: lists that name the images, and a text file of lanes beside each of them.

`list/train.txt` has an image per line (`/driver_23_30frame/05151649_0422.MP4/00000.jpg`); further columns,
as in `list/train_gt.txt`, are left out. `00000.lines.txt` beside that image has a lane per line, `x y x y
...`, from the lower end to the upper one, which is kept. The numbers count pixels and may lie outside the
image; a file without lines is an image without lanes. (https://xingangpan.github.io/projects/CULane.html)
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from yolino.datasets.annotation import LabelError
from yolino.datasets.lists import ListedDataset, listed_names, pixel_numbers
from yolino.datasets.writing import ImageWriter, without_suffix
from yolino.io import write_atomic
from yolino.types import Sample

_SCENE = re.compile(r"test\d+_(.+)")


class CULaneWriter(ImageWriter):
    """Writes the lanes beside where the images are, and a list of the images.

    Args:
        out: The folder.
        classes: Not written.
        directed: Not written.
        names: Name of the list.
    """

    loses = ("classes", "ignored regions", "scores", "sizes")

    def __init__(
        self,
        out: Path,
        *,
        classes: Sequence[str] = (),
        directed: bool = True,
        names: str = "list/all.txt",
    ) -> None:
        super().__init__(out, classes=classes, directed=directed)
        self._names = names

    def add(self, sample: Sample) -> None:
        """Writes the lanes of one image."""
        self.check(sample)
        lanes = [" ".join(map(_shortest, pixel_numbers(line).ravel().tolist())) for line in sample.polylines]
        self.write(sample, CULane.label_name(sample.name), "".join(f"{lane}\n" for lane in lanes))

    def close(self) -> None:
        """Writes the list."""
        names = "".join(f"/{name.lstrip('/')}\n" for name in self.written.values())
        write_atomic(self.out / self._names, names)


class CULane(ListedDataset):
    """Frames and lane markings of the CULane benchmark, in the layout that it publishes.

    Args:
        root: Folder that the lists start from.
        labels: Lists, label files or folders of them, absolute or below `root`; None: those of the images in
            `names`, or all `*.lines.txt` below `root`.
        options: The other arguments of `FileDataset`; `names="list/train.txt"` is the benchmark's way.
    """

    patterns = ("**/*.lines.txt",)
    suffix = ".lines.txt"
    writer = CULaneWriter

    @staticmethod
    def label_name(image: str) -> str:
        """Gives the name of the label file of an image: beside it."""
        return without_suffix(image) + CULane.suffix

    @staticmethod
    def image_name(label: str) -> str:
        """Gives the name of the image of a label file, without suffix."""
        return label.removesuffix(CULane.suffix)

    @staticmethod
    def read_lines(path: Path) -> list[Float[np.ndarray, "_ 2"]]:
        """Gives the vertices of each lane of a label file, in pixels.

        Raises:
            LabelError: A line has an odd number of values, or one that is no finite number.
            OSError: The file cannot be read.
        """
        lanes = []
        for number, line in enumerate(path.read_bytes().removeprefix(codecs.BOM_UTF8).splitlines(), 1):
            if values := line.split():
                lanes.append(_lane(values, f"{path}, line {number}"))
        return lanes


def categories(root: str | Path) -> dict[str, list[str]]:
    """Gives the names of the test images of each scene of CULane (`normal`, `crowd`, `night`, ...).

    Args:
        root: Folder of the benchmark; without `list/test_split/` there are no scenes.
    """
    scenes = {}
    for path in sorted(Path(root).glob("list/test_split/*.txt")):
        scene = _SCENE.fullmatch(path.stem)
        scenes[scene[1] if scene else path.stem] = [name for _, name in listed_names(path)]
    return scenes


def _lane(values: Sequence[bytes], where: str) -> Float[np.ndarray, "v 2"]:
    try:
        numbers = np.fromiter(map(float, values), np.float64, len(values))
    except ValueError:
        numbers = np.array([np.nan])
    if not np.isfinite(numbers).all():
        wrong = next(value for value in values if not _is_finite(value)).decode(errors="replace")
        raise LabelError(where, f"holds {wrong!r}, but finite numbers are needed")
    if len(values) % 2:
        raise LabelError(where, f"has {len(values)} values, but pairs x y are needed")
    return numbers.reshape(-1, 2) + 0.5


def _is_finite(value: bytes) -> bool:
    try:
        return bool(np.isfinite(float(value)))
    except ValueError:
        return False


def _shortest(value: float) -> str:
    return repr(value).removesuffix(".0")


__all__ = ["CULane", "CULaneWriter", "categories"]
