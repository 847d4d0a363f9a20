"""Lists of images: the benchmarks that name their images in lists, and have a label file for each."""

from __future__ import annotations

import os
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from yolino.datasets.annotation import Annotation, LabelError
from yolino.datasets.files import FileDataset, Names, listed_names

_DECIMALS = 6


class ListedDataset(FileDataset):
    """The images of a benchmark that has a label file for each, and lists that name them.

    Where a list is given, as `names` or among the `labels`, the label files are those of the images in it:
    folders of 100,000 files need not be searched, and an image without labels is a mistake. Its names
    start from the root, or from the folder of the list.
    """

    default_class = "lane"
    suffix: ClassVar[str]
    """How the names of label files end."""

    @staticmethod
    @abstractmethod
    def label_name(image: str) -> str:
        """Gives the name of the label file of an image."""

    @staticmethod
    @abstractmethod
    def image_name(label: str) -> str:
        """Gives the name of the image of a label file, without suffix."""

    @staticmethod
    @abstractmethod
    def read_lines(path: Path) -> list[Float[np.ndarray, "_ 2"]]:
        """Gives the vertices of each lane of a label file, in pixels."""

    def read(self, path: Path) -> Iterator[Annotation | LabelError]:
        """Yields the lanes of one image, or those of all images in a list."""
        if not path.name.endswith(self.suffix):
            yield from self._read_listed(path)
        else:
            yield self._annotation(self.image_name(_below(path, self.root)), path)

    def _annotation(self, image: str, path: Path) -> Annotation:
        lines = self.read_lines(path)
        return Annotation(image, str(path), lines, (self.default_class,) * len(lines))

    def _find_files(self, labels: Names | None) -> list[Path]:
        if labels is not None or self.names is None:
            return super()._find_files(labels)
        if not self.names.is_file():
            raise FileNotFoundError(
                f"There is no list of names {self.names}: a text file, an image per line."
            )
        return [self.names]

    def _choose(self, annotations: Sequence[Annotation], names: Path, skip_broken: bool) -> list[Annotation]:
        if self.files == [names]:
            return list(annotations)
        return super()._choose(annotations, names, skip_broken)

    def _read_listed(self, path: Path) -> Iterator[Annotation | LabelError]:
        listed = list(listed_names(path))
        if not listed:
            raise LabelError(str(path), "is empty, but one image per line is needed")
        for number, name in listed:
            try:
                yield self._listed(name, path)
            except FileNotFoundError:
                file = self.root / self.label_name(name)
                yield LabelError(f"{path}, line {number}", f"lists {name}, which has no label file {file}")
            except LabelError as error:
                yield error
            except OSError as error:
                yield LabelError(f"{path}, line {number}", f"lists {name}, whose labels are lost ({error})")

    def _listed(self, name: str, path: Path) -> Annotation:
        """Gives the annotation of a name in the list `path`."""
        try:
            return self._annotation(name, self.root / self.label_name(name))
        except FileNotFoundError:
            file = path.parent / self.label_name(name)
            return self._annotation(_below(path.parent / name, self.root), file)


def pixel_numbers(vertices: Float[np.ndarray, "v 2"]) -> Float[np.ndarray, "v 2"]:
    """Gives the numbers of the pixels that have their centers at `vertices`, with few decimals if they do.

    Adding .5 to them gives the vertices back: exactly, or with an error of 1e-16 of a pixel near 0.
    """
    exact = vertices - 0.5
    short = np.round(exact, _DECIMALS)
    return np.where(short + 0.5 == vertices, short, exact)


def _below(path: Path, root: Path) -> str:
    return Path(os.path.relpath(path, root)).as_posix()


__all__ = ["ListedDataset", "listed_names", "pixel_numbers"]
