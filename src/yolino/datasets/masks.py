"""Folders of masks (cracks, vessels, roads): a mask's lines become polylines.

A mask is an image of its image's size, with one value per pixel: 0 is background. Without `values`, all
other pixels are lines of one class. It belongs to the image of the same name (suffixes aside) at the mask's
path with one folder left out or called `images`: `masks/a.png` to `a.jpg` or `images/a.jpg`,
`train/masks/a.png` to `train/images/a.jpg`.

Masks are read when the dataset is made; lines are traced when a sample is asked for, and remembered.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from yolino.datasets.annotation import Annotation, LabelError
from yolino.datasets.files import FileDataset, Names
from yolino.datasets.mask_pixels import mask_to_polygons, read_classes, read_lines
from yolino.datasets.mask_writing import FOLDER, MasksWriter, check_meaning, read_meaning
from yolino.datasets.skeleton import mask_to_polylines
from yolino.image import IMAGE_SUFFIXES
from yolino.io import image_size

SUFFIXES = (".png", ".tif", ".tiff", ".bmp", ".gif", ".jpg", ".jpeg")
"""Suffixes of files that are taken for masks."""
# Vertices that are remembered, 64 MB of them.
_MEMORY = 1 << 22


@dataclass(frozen=True, eq=False)
class _Mask(Annotation):
    """An annotation whose lines are still in its mask."""

    file: Path = Path()
    found: Path = Path()


class Masks(FileDataset):
    """Images with masks of their lines; directions mean nothing.

    Args:
        root: Folder of images and masks.
        labels: Masks, folders of them or globs, absolute or below `root`; None: all images below
            `root/masks`, or with a `suffix`, all below `root` whose names end so.
        suffix: What the name of a mask (without `.png`) has more than its image's: `_mask`. Files without it
            are no masks.
        image_suffix: What the name of an image has more: masks `7_mask.png` of images `7_sat.jpg` have the
            `suffix` `_mask` and the `image_suffix` `_sat`.
        values: Names of the values in the masks, `{1: crack, 2: joint}`: the classes in this order. None:
            what `masks/values.json` says, as `MasksWriter` writes it; without that file, all pixels that are
            not 0 (of a JPEG: from 128 on) are lines of the class `line`.
        ignore_value: The value of regions where nothing is labelled.
        tolerance: Largest distance in pixels between skeleton and line (`mask_to_polylines`, as the next).
        spur: Length in pixels of branches that are cut off.
        min_length: Least length of a line with all that is connected to it, in pixels.
        holes: Number of pixels of a hole that is filled.
        directed: Whether the direction of a polyline means something: it has none.
        options: The other arguments of `FileDataset`.

    Raises:
        LabelError: A mask cannot be read, has a value without a name, or another size than its image.
    """

    patterns = tuple(f"{FOLDER}/**/*{suffix}" for suffix in SUFFIXES)
    writer = MasksWriter

    def __init__(  # noqa: PLR0913 (all are options that users name)
        self,
        root: str | Path,
        labels: Names | None = None,
        *,
        suffix: str = "",
        image_suffix: str = "",
        values: Mapping[Any, str] | None = None,
        ignore_value: int | None = None,
        tolerance: float | int = 1.0,
        spur: float | int = 8.0,
        min_length: float | int = 10.0,
        holes: int = 10,
        directed: bool = False,
        **options: Any,
    ) -> None:
        self.suffix, self.image_suffix = suffix, image_suffix
        if values is None:
            values, written = read_meaning(Path(root))
            ignore_value = written if ignore_value is None else ignore_value
        self.values = None if values is None else check_meaning(values, "values")
        self.ignore_value = ignore_value
        self._how = {"tolerance": float(tolerance), "spur": float(spur), "min_length": float(min_length)}
        self._holes = holes
        mask_to_polylines(np.zeros((1, 1), np.bool_), holes=holes, **self._how)  # checks the numbers
        self._traced: dict[Path, _Mask] = {}
        self._remembered = 0
        self._mask_of: dict[Path, Path] = {}
        super().__init__(root, labels, directed=directed, **options)

    def _find_files(self, labels: Names | None) -> list[Path]:
        """Gives the masks: all files whose names end with the suffix."""
        masks = self._find_masks(labels)
        self._all_masks = frozenset(masks)
        return masks

    def _find_masks(self, labels: Names | None) -> list[Path]:
        if labels is None and self.suffix:
            patterns = [f"**/*{self.suffix}{kind}" for kind in SUFFIXES]
            found = next((files for p in patterns if (files := sorted(self.root.glob(p)))), [])
            if not found:
                raise FileNotFoundError(
                    f"There are no masks like {' or '.join(patterns)} in {self.root}: name them in labels."
                )
            return found
        files = super()._find_files(labels)
        masks = [file for file in files if file.stem.endswith(self.suffix)]
        if not masks:
            raise FileNotFoundError(
                f"None of {len(files)} masks in {self.root} has a name that ends with {self.suffix}: "
                f"{files[0].name} has not."
            )
        return masks

    def read(self, path: Path) -> Iterator[Annotation | LabelError]:
        """Yields the annotation of a mask, still without lines."""
        size = self._check_pixels(path)
        candidates = self._candidates(path)
        image = next((file for place in candidates if (file := self._existing(place))), candidates[0])
        if image.is_file():
            self._check_image(path, image, size)
        try:
            name = image.relative_to(self.images or self.root).as_posix()
        except ValueError:
            name = image.name
        yield _Mask(name, str(path), size=size, file=path, found=image)

    def complete(self, annotation: Annotation) -> Annotation:
        """Gives the annotation with the lines and regions of its mask."""
        assert isinstance(annotation, _Mask)
        if annotation.file in self._traced:
            return self._traced[annotation.file]
        lines, names = [], []
        ignore: list[Any] = []
        for name, mask in self._masks(annotation.file):
            if name is None:
                ignore = mask_to_polygons(mask, self._how["tolerance"])
                continue
            traced = list(mask_to_polylines(mask, holes=self._holes, **self._how))
            lines += traced
            names += [name] * len(traced)
        full = replace(annotation, lines=tuple(lines), names=tuple(names), ignore=tuple(ignore))
        self._remembered += sum(map(len, lines)) + sum(map(len, ignore))
        if self._remembered <= _MEMORY:
            self._traced[annotation.file] = full
        return full

    def found_classes(self) -> tuple[str, ...]:
        """Gives the names of the values."""
        return (self.default_class,) if self.values is None else tuple(dict.fromkeys(self.values.values()))

    def _masks(self, path: Path) -> Iterator[tuple[str | None, np.ndarray]]:
        """Yields the name and the pixels of each class of a mask, and None with those to ignore."""
        if self.values is None and self.ignore_value is None:
            yield self.default_class, read_lines(path)
            return
        pixels = read_classes(path)
        if self.ignore_value is not None:
            yield None, pixels == self.ignore_value
        if self.values is None:
            yield self.default_class, (pixels != 0) & (pixels != self.ignore_value)
            return
        for name in dict.fromkeys(self.values.values()):
            yield name, np.isin(pixels, [value for value, other in self.values.items() if other == name])

    def _check_pixels(self, path: Path) -> tuple[int, int]:
        """Gives the size of a mask whose values are all known."""
        if self.values is None:
            _, mask = next(iter(self._masks(path)))
            return mask.shape
        pixels = read_classes(path)
        known = {0, self.ignore_value, *self.values}
        unknown = [value for value in np.unique(pixels).tolist() if value not in known]
        if unknown:
            given = ", ".join(f"{value}: {name}" for value, name in self.values.items())
            listed = ", ".join(map(str, unknown[:5])) + (" ..." if len(unknown) > 5 else "")
            raise LabelError(str(path), f"has the values {listed}, but only {given} have names: add them")
        height, width = pixels.shape
        return height, width

    def _check_image(self, path: Path, image: Path, size: tuple[int, int]) -> None:
        """Raises if the image has another size or another mask."""
        if self._mask_of.setdefault(image, path) != path:
            raise LabelError(str(path), f"belongs to the image {image}, but {self._mask_of[image]} does too")
        try:
            there = image_size(image)
        except ValueError as error:
            reason = str(error).removesuffix(".")
            raise LabelError(str(path), f"belongs to an image that cannot be read: {reason}") from None
        if there != size:
            raise LabelError(
                str(path),
                f"has {size[1]} x {size[0]} pixels (width x height), but its image {image} has "
                f"{there[1]} x {there[0]}, both must be the same",
            )

    def _candidates(self, path: Path) -> list[Path]:
        """Gives the places where the image of a mask may be, without suffix, the likeliest first."""
        stem = path.stem[: len(path.stem) - len(self.suffix)] + self.image_suffix
        try:
            folders = path.parent.relative_to(self.root).parts
        except ValueError:
            folders = (path.parent.name,)
        if self.images is not None:
            return [self.images.joinpath(*folders[i:], stem) for i in range(len(folders) + 1)]
        without = [(*folders[:i], *folders[i + 1 :]) for i in range(len(folders))]
        instead = [(*folders[:i], "images", *folders[i + 1 :]) for i in range(len(folders))]
        own = [(*folders, "images"), folders]
        return [self.root.joinpath(*parts, stem) for parts in (*without, *instead, *own)]

    def _existing(self, place: Path) -> Path | None:
        """Gives the image at a place, whatever its suffix; masks are no images."""
        for suffix in IMAGE_SUFFIXES:
            file = place.with_name(place.name + suffix)
            if file.is_file() and file not in self._all_masks:
                return file
        return None

    def _choose_classes(
        self, wanted: Sequence[str] | Mapping[str, str] | None
    ) -> tuple[tuple[str, ...], dict[str, int]]:
        classes, label_of = super()._choose_classes(wanted)
        if not set(label_of) & set(self.found_classes()):
            raise ValueError(
                f"None of the classes {', '.join(label_of)} is among those of the masks in {self.root}, "
                f"{', '.join(self.found_classes())}: rename them, {{old name: new name}}."
            )
        return classes, label_of

    def _image_path(self, one: Annotation) -> Path:
        assert isinstance(one, _Mask)
        return one.found


__all__ = ["SUFFIXES", "Masks", "MasksWriter"]
