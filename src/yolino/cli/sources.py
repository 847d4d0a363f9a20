"""From what the user names (images, folders, globs) to image files, and to names for their results."""

from __future__ import annotations

import glob
import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from yolino.image import IMAGE_SUFFIXES


class Sources(NamedTuple):
    """What was found.

    Attributes:
        images: Image files, each once, in the order of the sources.
        problems: A sentence for each source that names nothing.
    """

    images: list[Path]
    problems: list[str]


def find_images(sources: Sequence[str], *, excluded: Path) -> Sources:
    """Gives the image files that `sources` name.

    A folder stands for all images in it and below, without hidden ones and those in `excluded` (earlier
    results). A file is taken whatever its suffix is, and so is a path that does not exist: reading it tells.

    Args:
        sources: Paths of images or folders, or globs (`**` goes through folders).
        excluded: Folder whose images are none.
    """
    images: dict[str, Path] = {}
    folders: dict[Path, str] = {}
    problems = []
    for source in sources:
        found = _expand(source, excluded.resolve())
        if not found:
            kind = "The folder" if Path(source).is_dir() else "The pattern"
            problems.append(f"{kind} {source} names no image ({', '.join(IMAGE_SUFFIXES)}).")
        for path in found:
            images.setdefault(real_path(path, folders), path)
    return Sources(list(images.values()), problems)


def real_path(path: Path, folders: dict[Path, str]) -> str:
    """Gives where a file really is, as `Path.resolve`; quickly for many files of few folders.

    Args:
        path: The file, which need not exist.
        folders: Where the folders are that were asked for before; grows.
    """
    if path.name in ("", "..") or path.is_symlink():
        return os.path.realpath(path)
    parent = path.parent
    if parent not in folders:
        folders[parent] = os.path.realpath(parent)
    return os.path.join(folders[parent], path.name)


def _expand(source: str, excluded: Path) -> list[Path]:
    path = Path(source)
    if path.is_dir():
        return _images_below(path, excluded)
    if path.exists() or not glob.has_magic(source):
        return [path]
    matches = sorted(map(Path, glob.glob(os.path.expanduser(source), recursive=True)))
    files = [match for match in matches if match.is_file() and match.suffix.lower() in IMAGE_SUFFIXES]
    if "**" in source:
        return files
    return files + [image for match in matches if match.is_dir() for image in _images_below(match, excluded)]


def _images_below(folder: Path, excluded: Path) -> list[Path]:
    found = []
    for parent, folders, names in os.walk(folder):
        folders[:] = sorted(
            name for name in folders if name[0] != "." and Path(parent, name).resolve() != excluded
        )
        found += [
            Path(parent, name)
            for name in sorted(names)
            if name[0] != "." and Path(name).suffix.lower() in IMAGE_SUFFIXES
        ]
    return found


def result_names(images: Sequence[Path]) -> list[str]:
    """Gives a name for the results of each image, each once: its stem; where several share it, with folders.

    The folders are those below the folder that the sharing images have in common. Images of one folder that
    differ in their suffix alone keep it.
    """
    names = [image.stem for image in images]
    folders: dict[Path, str] = {}
    for same in _shared(names):
        paths = [real_path(images[i], folders) for i in same]
        common = os.path.commonpath({os.path.dirname(path) for path in paths})
        below = [Path(path[len(common) :].lstrip(os.sep)) for path in paths]
        short = [path.with_name(path.stem).as_posix() for path in below]
        twins = {k for group in _shared(short) for k in group}
        for k, i in enumerate(same):
            names[i] = below[k].as_posix() if k in twins else short[k]
    for same in _shared(names):
        for count, i in enumerate(same, 1):
            names[i] += f"-{count}"
    return names


def _shared(names: Sequence[str]) -> list[list[int]]:
    """Gives the groups of indices whose names are the same where upper and lower case are."""
    groups: dict[str, list[int]] = {}
    for i, name in enumerate(names):
        groups.setdefault(name.casefold(), []).append(i)
    return [group for group in groups.values() if len(group) > 1]


__all__ = ["Sources", "find_images", "real_path", "result_names"]
