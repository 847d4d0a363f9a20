"""Images of labels that were made in another folder or on another machine: their paths begin elsewhere."""

from __future__ import annotations

from pathlib import Path

from yolino.datasets.files import FileDataset, path_ends


def find_end(dataset: FileDataset, image: str, beside: Path) -> str | None:
    """Gives the path below the root where as much as possible of the end of an image's path leads to a file.

    So `/home/me/data/a/1.jpg` is found as `data/a/1.jpg`, `a/1.jpg` or `1.jpg`, whichever is there first. For
    files in a folder that is not below the root, it is the path below that folder.

    Args:
        dataset: Its folders are tried: `images`, or else the root, `images` in it and `beside`.
        image: The path, with forward slashes.
        beside: Folder of the label file.
    """
    folders = [dataset.images] if dataset.images else [dataset.root, beside, dataset.root / "images"]
    for end in path_ends(image):
        for folder in folders:
            if (folder / end).is_file():
                below = dataset.images is None and folder.is_relative_to(dataset.root)
                return (folder.relative_to(dataset.root) / end).as_posix() if below else end
    return None


__all__ = ["find_end"]
