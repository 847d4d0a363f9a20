"""A COCO-style document: its lists and entries checked, the lines and polygons of its fields."""

from __future__ import annotations

from collections.abc import Container
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from yolino.datasets.annotation import LabelError, check_points, parse_json

Vertices = Float[np.ndarray, "_ 2"]
Entry = dict[str, Any]
_LARGEST = 1e300


def load(path: Path) -> dict[str, list[Any]]:
    """Gives the lists of a document: `images`, `annotations` and `categories`; their entries are not checked.

    Raises:
        LabelError: It is no such document.
    """
    document = parse_json(path.read_bytes(), str(path))
    if not isinstance(document, dict):
        raise LabelError(str(path), f"holds a {type(document).__name__}, but an object with images is needed")
    lists = {"categories": [], **document}
    for key in ("images", "annotations", "categories"):
        if not isinstance(lists.get(key), list):
            raise LabelError(str(path), f"lacks the list of {key}")
    return lists


def category_names(categories: list[Any], where: str) -> dict[object, str]:
    """Gives the name of each category by its id.

    Raises:
        LabelError: A category has no id or name, or the id of another.
    """
    names: dict[object, str] = {}
    for index, one in enumerate(categories):
        if not (isinstance(one, dict) and _is_id(one.get("id")) and isinstance(one.get("name"), str)):
            raise LabelError(
                f"{where}, categories[{index}]", f'is {one!r:.80}, but {{"id": 1, "name": "lane"}} is needed'
            )
        if one["id"] in names:
            raise LabelError(
                f"{where}, categories[{index}]", f"has the id {one['id']!r} of an earlier category"
            )
        names[one["id"]] = one["name"]
    return names


def check_image(image: Any, where: str, known: Container[object]) -> None:
    """Checks an entry of `images`.

    Raises:
        LabelError: It has no id or no file name, or its id is among the `known`.
    """
    if not isinstance(image, dict) or not _is_id(image.get("id")):
        raise LabelError(where, f'is {image!r:.80}, but {{"id": 1, "file_name": "a.jpg"}} is needed')
    if not isinstance(image.get("file_name"), str) or not image["file_name"]:
        raise LabelError(where, f"has the file_name {image.get('file_name')!r:.80}, but the image is needed")
    if image["id"] in known:
        raise LabelError(where, f"has the id {image['id']!r} of an earlier image")


def size_of(image: Entry) -> tuple[int, int] | None:
    """Gives `(height, width)` of an image, None where they are not stated."""
    height, width = image.get("height"), image.get("width")
    if type(height) is int and type(width) is int and height > 0 and width > 0:
        return height, width
    return None


def check_entry(entry: Any, path: str, index: int, images: Container[object]) -> str:
    """Gives what to call an entry of `annotations`: by its id, or by its index without one.

    Raises:
        LabelError: It is no object, or its image is not among the `images`.
    """
    if not isinstance(entry, dict):
        raise LabelError(f"{path}, annotations[{index}]", f"is {entry!r:.80}, but an object is needed")
    part = f"annotation {entry['id']}" if "id" in entry else f"annotations[{index}]"
    image = entry.get("image_id")
    if not _is_id(image) or image not in images:
        raise LabelError(f"{path}, {part}", f"has the image_id {image!r:.80}, which no image has")
    return part


def category_of(entry: Entry, categories: dict[object, str], where: str, *, default: str) -> str:
    """Gives the name of an annotation's category, or the default.

    Raises:
        LabelError: There is no such category.
    """
    category = entry.get("category_id")
    if category is None:
        return default
    if not _is_id(category) or category not in categories:
        raise LabelError(where, f"has the category_id {category!r:.80}, which no category has")
    return categories[category]


def score_of(entry: Entry, where: str) -> float:
    """Gives the score of an annotation, 1 without one.

    Raises:
        LabelError: It is no finite number.
    """
    score = 1.0 if entry.get("score") is None else entry["score"]
    if type(score) not in (int, float) or not abs(score) <= _LARGEST:
        raise LabelError(where, f"has the score {score!r:.80}, but a finite number is needed")
    return float(score)


def shapes(value: Any, where: str, *, least: int = 1) -> list[Vertices]:
    """Gives the polylines or polygons of a field: flat, as points, or several of either.

    Raises:
        LabelError: It is none of them, or one has fewer than `least` points.
    """
    if not isinstance(value, list):
        raise LabelError(where, f"is {value!r:.80}, but a list of numbers is needed")
    if all(isinstance(item, list) for item in value):
        points = all(len(item) == 2 and not isinstance(item[0], list) for item in value)
        if not points:
            return [_shape(item, where, least) for item in value if item]
    return [_shape(value, where, least)] if value else []


def _shape(value: list[Any], where: str, least: int) -> Vertices:
    if isinstance(value[0], list):
        return check_points(value, where, least=least)
    if len(value) % 2:
        raise LabelError(where, f"has {len(value)} numbers, but pairs of x and y are needed")
    return check_points(list(zip(value[::2], value[1::2], strict=True)), where, least=least)


def regions(entry: Entry, where: str) -> list[Vertices]:
    """Gives the polygons of an annotation's segmentation, or its box if it has nothing else.

    Raises:
        LabelError: It has neither, or a run-length code.
    """
    polygons, box = entry.get("segmentation"), entry.get("bbox")
    if isinstance(polygons, dict):
        raise LabelError(where, "has a run-length segmentation, but polygons [[x1, y1, ...], ...] are needed")
    if polygons:
        return shapes(polygons, f"{where}, segmentation", least=3)
    if entry.get("polyline") is not None or not isinstance(box, list) or len(box) != 4:
        raise LabelError(where, "is to be ignored, but has no segmentation [[x1, y1, ...], ...]")
    corner, extent = check_points([box[:2], box[2:]], f"{where}, bbox")
    return [corner + extent * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])]


def _is_id(value: object) -> bool:
    return type(value) in (int, float, str)  # some tools write 1.0


__all__ = [
    "Entry",
    "Vertices",
    "category_names",
    "category_of",
    "check_entry",
    "check_image",
    "load",
    "regions",
    "score_of",
    "shapes",
    "size_of",
]
