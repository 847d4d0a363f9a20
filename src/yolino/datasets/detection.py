"""Which format is it? The names of the files tell, and where they do not, the first keys in them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

BY_NAME = {
    "tusimple": ("label_data*.json",),
    "culane": ("list/*.txt", "*.lines.txt", "*/*.lines.txt", "*/*/*.lines.txt"),
    "curvelanes": ("labels/*.lines.json", "*/labels/*.lines.json", "*.lines.json"),
    "cvat": ("annotations.xml",),
    "geojson": ("labels/*.geojson", "labels/**/*.geojson", "*.geojson", "**/*.geojson"),
    "argoverse2": ("map/log_map_archive_*.json", "*/map/log_map_archive_*.json"),
}
"""Globs below the folder that tell a format; the first that finds a file counts."""
_JSON = ("*.json", "annotations/*.json", "labels/*.json", "**/*.json")
_MASKS = ("masks/*.png", "masks/*.tif", "masks/*.tiff", "masks/*.bmp")
_PEEK = 2**22


def detect_format(path: Path) -> str:
    """Gives the format of a label file, or of the label files in a folder: a name in `DATASETS`.

    Raises:
        FileNotFoundError: There is no such file or folder.
        ValueError: It is none of the known formats.
    """
    if path.is_file():
        return _of_file(path)
    if not path.is_dir():
        raise FileNotFoundError(f"There is no file or folder {path}.")
    for name, patterns in BY_NAME.items():
        if any(next(path.glob(pattern), None) is not None for pattern in patterns):
            return name
    if next(path.glob("*.xml"), None) is not None:
        return "cvat"
    for pattern in _JSON:
        if (file := min(path.glob(pattern), default=None)) is not None:
            return _of_file(file)
    if any(next(path.glob(pattern), None) is not None for pattern in _MASKS):
        return "masks"
    raise ValueError(
        f"{path} holds no labels of a known layout: write a data.yaml there, beginning with `format:`, "
        "or name the format."
    )


def _of_file(path: Path) -> str:
    for name, patterns in BY_NAME.items():
        if any(path.match(pattern) for pattern in patterns):
            return name
    if path.suffix.lower() == ".xml":
        return "cvat"
    found = _of_json(path) if path.suffix.lower() in (".json", ".jsonl") else None
    if found is None:
        raise ValueError(f"{path} is no label file of a known format: name the format.")
    return found


def _of_json(path: Path) -> str | None:
    """Gives the format of a JSON file by its keys."""
    with path.open(encoding="utf-8-sig", errors="replace") as stream:
        line = stream.readline(_PEEK)
        first = _parse(line)
        document = first if first is not None else _parse(line + stream.read())
    if isinstance(document, list):
        return "labelstudio" if document and isinstance(document[0], dict) else None
    if not isinstance(document, dict):
        return None
    for name, keys in _KEYS.items():
        if keys <= document.keys():
            return name
    return None


_KEYS = {
    "tusimple": {"raw_file", "lanes"},
    "labelme": {"shapes"},
    "coco": {"images", "annotations"},
    "results": {"image", "polylines"},
    "curvelanes": {"Lines"},
    "geojson": {"features"},
}


def _parse(text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None


__all__ = ["BY_NAME", "detect_format"]
