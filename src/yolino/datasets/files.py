"""The base of all datasets that read label files: finding them, choosing classes and images, broken ones."""

from __future__ import annotations

import glob
import re
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any, ClassVar

from yolino.datasets.annotation import Annotation, LabelError
from yolino.datasets.writing import Writer
from yolino.image import IMAGE_SUFFIXES
from yolino.types import Polylines, Sample

Names = str | Path | Sequence[str | Path]
Progress = Callable[[Iterable[Any]], Iterable[Any]]
# The name is the first column, which may have spaces in it if it has the suffix of an image.
_FIRST_COLUMN = re.compile(rf"\S.*?(?:{'|'.join(map(re.escape, IMAGE_SUFFIXES))})(?=\s|$)|\S+", re.IGNORECASE)


class FileDataset(ABC):
    """Images with polylines from label files of one format.

    All label files are read when the dataset is made, so that a mistake shows before training begins; images
    are not opened.

    A subclass says where its label files lie (`patterns`) and what one of them holds (`read`).

    Args:
        root: Folder that everything else is relative to.
        labels: Label files, folders of them or globs, absolute or below `root`; None: where the format
            has them by convention (`patterns`).
        names: A text file with the name of an image per line, absolute or below `root`: only these are taken,
            in this order. `train.txt`, say.
        images: Folder of the images, absolute or below `root`; None: `root`, `root/images` and the folder of
            the label file are tried.
        classes: Names of the classes to take, in the order of their labels, or a mapping from names in the
            files to these (`{way: lane, link: lane}`); polylines of other names are left out and counted.
            None: all names that occur, sorted.
        directed: Whether the direction of a polyline means something.
        ignore: Names whose polygons are regions where nothing is labelled.
        skip_broken: Whether files, or parts of them, that cannot be read are left out and kept in `broken`;
            otherwise the first one raises.
        require_images: Whether to raise where an image is missing.
        progress: Wraps what is looped over while the files are read, to show a progress bar.

    Attributes:
        classes: Names of the labels.
        directed: Whether the direction of a polyline means something.
        annotations: What the files say, an entry per sample.
        broken: What could not be read.
        left_out: Number of polylines of each name that is not among the classes.

    Raises:
        FileNotFoundError: The root, a label file, the list of names or an image does not exist.
        LabelError: A label file cannot be read; file, place and reason are named.
        ValueError: There is nothing to read, or an argument is wrong.
    """

    patterns: ClassVar[tuple[str, ...]] = ()
    """Globs below the root; the first that finds something counts."""
    default_class: ClassVar[str] = "line"
    """Name of the only class of a format without names."""
    writer: ClassVar[type[Writer] | None] = None
    """What writes this format."""

    def __init__(
        self,
        root: str | Path,
        labels: Names | None = None,
        *,
        names: str | Path | None = None,
        images: str | Path | None = None,
        classes: Sequence[str] | Mapping[str, str] | None = None,
        directed: bool = True,
        ignore: Sequence[str] = ("ignore",),
        skip_broken: bool = False,
        require_images: bool = True,
        progress: Progress = iter,
    ) -> None:
        self.root = Path(root)
        if not self.root.is_dir():
            raise FileNotFoundError(f"There is no folder {root}: give the folder of the dataset.")
        self.names = None if names is None else self._below_root(names)
        self.images = None if images is None else self._below_root(images)
        self.directed, self.ignore = directed, tuple(ignore)
        self.broken: list[LabelError] = []
        self.files = self._find_files(labels)
        found = self._read_all(skip_broken, progress)
        self.annotations = found if self.names is None else self._choose(found, self.names, skip_broken)
        self._paths = [self._image_path(one) for one in self.annotations]
        if require_images:
            self._check_images(skip_broken)
        self.classes, self._label_of = self._choose_classes(classes)
        used = Counter(name for one in self.annotations for name in one.names)
        self.left_out = Counter({name: n for name, n in used.items() if name not in self._label_of})
        if used and len(self.left_out) == len(used):
            raise ValueError(
                f"None of the classes {', '.join(self.classes)} occurs in {self.root}; "
                f"its labels have {', '.join(sorted(used))}."
            )

    @abstractmethod
    def read(self, path: Path) -> Iterator[Annotation | LabelError]:
        """Yields what a label file says about each of its images.

        What cannot be read is raised where the whole file is lost, or yielded where the rest can go on.
        Names of images are relative to the root, to the folder of the label file, or just the file's name.
        """

    def complete(self, annotation: Annotation) -> Annotation:
        """Gives the annotation with all its lines; for formats where that takes too long to do at once."""
        return annotation

    def found_classes(self) -> tuple[str, ...]:
        """Gives the names of all classes that occur."""
        return tuple(sorted({name for one in self.annotations for name in one.names}))

    @property
    def image_paths(self) -> tuple[Path, ...]:
        """The image file of each sample, where it is or where it would be."""
        return tuple(self._paths)

    def __len__(self) -> int:
        return len(self.annotations)

    def __getitem__(self, index: int) -> Sample:
        one, path = self.complete(self.annotations[index]), self._paths[index]
        chosen = [i for i, name in enumerate(one.names) if name in self._label_of]
        polylines = Polylines.from_list(
            [one.lines[i] for i in chosen],
            [one.scores[i] for i in chosen] if len(one.scores) else None,
            [self._label_of[one.names[i]] for i in chosen],
        )
        return Sample(self._name(one, path), path, polylines, tuple(one.ignore), one.size)

    def __iter__(self) -> Iterator[Sample]:
        return (self[i] for i in range(len(self)))

    def _below_root(self, path: str | Path) -> Path:
        """Gives a path below the root; where there is nothing, the same one from the working directory."""
        below = self.root / path
        return Path(path) if not below.exists() and Path(path).exists() else below

    def _find_files(self, labels: Names | None) -> list[Path]:
        """Gives the label files in the order of their names."""
        if labels is None:
            for pattern in self.patterns:
                if found := sorted(self.root.glob(pattern)):
                    return found
            raise FileNotFoundError(
                f"There are no labels like {' or '.join(self.patterns)} in {self.root}: name the label files."
            )
        given = [labels] if isinstance(labels, str | Path) else labels
        if not given:
            raise ValueError("The list of label files is empty: name one, or give none to have them found.")
        return [path for name in given for path in self._expand(name)]

    def _expand(self, given: str | Path) -> list[Path]:
        """Gives the files that a file name, a folder or a glob stands for."""
        path = self._below_root(given)
        if path.is_file():
            return [path]
        if path.is_dir():
            names = sorted({PurePosixPath(pattern).name for pattern in self.patterns})
            found = sorted({file for name in names for file in path.rglob(name)})
        else:
            found = sorted(Path(file) for file in glob.glob(str(path), recursive=True))
        if not found:
            raise FileNotFoundError(f"There is no label file {path}.")
        return found

    def _read_all(self, skip_broken: bool, progress: Progress) -> list[Annotation]:
        annotations: list[Annotation] = []
        for one in progress(self._entries()):
            if isinstance(one, Annotation):
                annotations.append(one)
            elif skip_broken:
                self.broken.append(one)
            else:
                raise one
        return annotations

    def _entries(self) -> Iterator[Annotation | LabelError]:
        for path in self.files:
            try:
                for one in self.read(path):
                    yield replace(one, source=path) if isinstance(one, Annotation) else one
            except LabelError as error:
                yield error
            except (UnicodeDecodeError, OSError) as error:
                reason = getattr(error, "strerror", None) or "it is no text in UTF-8"
                yield LabelError(str(path), f"cannot be read ({reason})")

    def _choose(self, annotations: Sequence[Annotation], names: Path, skip_broken: bool) -> list[Annotation]:
        """Gives the annotations of the listed images, in the order of the list."""
        if not names.is_file():
            raise FileNotFoundError(f"There is no list of names {names}: a text file, an image per line.")
        by_key: dict[str, list[Annotation]] = {}
        for one in annotations:
            for key in _keys(one.image):
                by_key.setdefault(key, []).append(one)
        listed = list(listed_names(names))
        if not listed:
            raise ValueError(f"The list of names {names} is empty: one image per line is needed.")
        chosen = []
        by_file: dict[str, Annotation] | None = None
        for number, name in listed:
            matches = next((by_key[key] for key in _keys(name) if key in by_key), [])
            if len(matches) != 1:  # label files may name images by paths of another machine
                if by_file is None:
                    by_file = {self._name(one, self._image_path(one)): one for one in annotations}
                matches = [by_file[name]] if name in by_file else matches
            if len(matches) == 1:
                chosen.append(matches[0])
            elif matches:
                raise ValueError(
                    f"{names} lists {name}, which could be {matches[0].image} or "
                    f"{matches[1].image}: write the whole path below {self.root}."
                )
            else:
                reason = f"lists {name}, which has no labels in {self.root}"
                error = LabelError(f"{names}, line {number}", reason)
                if not skip_broken:
                    raise error
                self.broken.append(error)
        return chosen

    def _image_path(self, one: Annotation) -> Path:
        """Gives the file of the image, where it is or where it would be."""
        name = one.image.lstrip("/")
        for place in self._places(name, one.source.parent):
            if place.suffix.lower() in IMAGE_SUFFIXES:
                if place.is_file():
                    return place
            else:  # formats whose files do not name the image
                for suffix in IMAGE_SUFFIXES:
                    for ending in (suffix, suffix.upper()):
                        if (file := place.with_name(place.name + ending)).is_file():
                            return file
        return (self.images or self.root) / name

    def _places(self, name: str, beside: Path) -> Iterator[Path]:
        """Yields where an image may lie: under its whole name, then under ever shorter ends of it."""
        folders = [self.images] if self.images else [self.root, beside, self.root / "images"]
        return (folder / end for end in path_ends(name) for folder in folders)

    def _name(self, one: Annotation, path: Path) -> str:
        """Gives the path of the image below the root, or what of its name stays below it."""
        name = path.relative_to(self.root).as_posix() if path.is_relative_to(self.root) else one.image
        return "/".join(part for part in PurePosixPath(name.lstrip("/")).parts if part != "..")

    def _check_images(self, skip_broken: bool) -> None:
        kept = []
        for one, path in zip(self.annotations, self._paths, strict=True):
            if path.is_file():
                kept.append((one, path))
            elif skip_broken:
                self.broken.append(LabelError(one.where, f"names the image {path}, which does not exist"))
            else:
                raise FileNotFoundError(f"{one.where} names the image {path}, which does not exist.")
        self.annotations, self._paths = [one for one, _ in kept], [path for _, path in kept]

    def _choose_classes(
        self, wanted: Sequence[str] | Mapping[str, str] | None
    ) -> tuple[tuple[str, ...], dict[str, int]]:
        """Gives the names of the labels, and the label of each name in the files."""
        if wanted is None:
            found = self.found_classes() or (self.default_class,)
            return found, {name: i for i, name in enumerate(found)}
        pairs = wanted if isinstance(wanted, Mapping) else {name: name for name in wanted}
        if not pairs:
            raise ValueError("The list of classes is empty: name some, or give none to take all.")
        classes = tuple(dict.fromkeys(pairs.values()))
        return classes, {name: classes.index(label) for name, label in pairs.items()}


def listed_names(path: Path) -> Iterator[tuple[int, str]]:
    """Yields the number of each line of a list that is not empty, and the image that it names."""
    for number, line in enumerate(path.read_text(encoding="utf-8-sig").splitlines(), 1):
        if found := _FIRST_COLUMN.search(line):
            yield number, found[0].replace("\\", "/").lstrip("/")


def path_ends(name: str) -> Iterator[str]:
    """Yields a path with forward slashes, and what is left of it without the first folder, the second, ..."""
    parts = [part for part in PurePosixPath(name).parts if part not in ("/", "..")]
    return ("/".join(parts[i:]) for i in range(len(parts)))


def _keys(name: str) -> list[str]:
    """Gives the names under which an image is looked up, the strictest first."""
    path = PurePosixPath(name.lstrip("/"))
    stem = path.name.split(".")[0]
    return list(dict.fromkeys([str(path), str(path.with_suffix("")), str(path.parent / stem), stem]))


__all__ = ["FileDataset", "Names", "Progress", "listed_names", "path_ends"]
