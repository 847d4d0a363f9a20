"""Which images belong together (a clip, a drive, a region), by their names."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import PurePosixPath

CONTAINERS = frozenset(
    {"camera", "cameras", "color", "data", "frames", "image", "images", "img", "imgs", "jpeg", "jpegimages"}
    | {"jpg", "photos", "pictures", "png", "pngs", "raw", "rgb", "samples", "test", "tiles", "train"}
    | {"training", "val", "valid", "validation"}
)
"""Folders that hold images of any origin; one of these, in lower case, is no clip."""
_REGEX = "regex:"


def group_names(names: Sequence[str], by: str = "auto") -> list[str]:
    """Gives the group of each image.

    Args:
        names: Names of images: paths with forward slashes.
        by: `image` (each is a group), `folder` (the folder that holds it), a number n (the first n folders of
            its path: driver, drive), `regex:...` (the first group of the expression, or all that it matches,
            anywhere in the name), or `auto`: the folder without the `CONTAINERS` at its end, and where
            nothing is left of it, the image.

    Raises:
        ValueError: `by` is none of these, or the expression is wrong or does not match a name.
    """
    return [*map(grouping(by), names)]


def grouping(by: str) -> Callable[[str], str]:
    """Gives the function from the name of an image to its group, see `group_names`.

    Raises:
        ValueError: `by` is no such grouping; or, when it is called, the expression does not match the name.
    """
    group = _of_bare_name(by)
    return lambda name: group(name.lstrip("/"))


def _of_bare_name(by: str) -> Callable[[str], str]:
    if by == "image":
        return lambda name: name
    if by == "folder":
        return lambda name: str(PurePosixPath(name).parent)
    if by == "auto":
        return _clip
    if by.isdecimal() and int(by) > 0:
        return lambda name: "/".join(PurePosixPath(name).parts[:-1][: int(by)]) or "."
    if by.startswith(_REGEX):
        return _by_expression(by.removeprefix(_REGEX))
    raise ValueError(
        f"The grouping {by!r} is unknown; use auto, image, folder, a number of folders like 2, or regex: and "
        "an expression."
    )


def _clip(name: str) -> str:
    folders = list(PurePosixPath(name).parts[:-1])
    while folders and folders[-1].lower() in CONTAINERS:
        folders.pop()
    return "/".join(folders) or name


def _by_expression(expression: str) -> Callable[[str], str]:
    try:
        pattern = re.compile(expression)
    except re.error as error:
        raise ValueError(f"{expression!r} is no regular expression: {error}.") from None

    def group(name: str) -> str:
        if (found := pattern.search(name)) is None:
            raise ValueError(
                f"The expression {expression!r} does not match {name}: make it match all images."
            )
        return str((found[1] if pattern.groups else found[0]) or "")

    return group


__all__ = ["CONTAINERS", "group_names", "grouping"]
