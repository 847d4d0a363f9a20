"""What a model file says about the steps after its network, as objects: views, NMS, linker."""

from __future__ import annotations

from collections.abc import Callable

from yolino.header import Header
from yolino.inference.rotations import QUARTERS
from yolino.types import Polylines, Segments

Suppressor = Callable[[Segments], Segments]
Linker = Callable[[Segments], Polylines]

DEFAULT_LINKER = "graph"


def build_quarters(header: Header) -> tuple[int, ...]:
    """Gives how far each view of a window is turned, in quarters.

    Raises:
        ValueError: The model does not see windows, or they are no squares and cannot be turned by a quarter.
    """
    rotations = header.postprocess.get("rotations", 1)
    if rotations > 1 and header.fit != "window":
        raise ValueError(f"The header's rotations are {rotations}, but only windows are turned.")
    if rotations == 4 and header.size[0] != header.size[1]:
        raise ValueError(f"The header's rotations are 4, but windows of {header.size} are no squares: use 2.")
    return QUARTERS[rotations]


def build_flip(header: Header, flip: bool | None = None) -> bool:
    """Gives whether the network also sees the mirrored image.

    Args:
        header: What the model file says about itself.
        flip: What the caller wants; the header's by default.

    Raises:
        ValueError: The model sees windows, which are turned instead.
    """
    flip = bool(header.postprocess.get("flip", False)) if flip is None else flip
    if flip and header.fit == "window":
        raise ValueError(
            f'flip is true, but the model {header.name} has the fit "window", with which windows are turned '
            "(rotations) and nothing is mirrored: leave flip out."
        )
    return flip


def build_nms(header: Header) -> Suppressor:
    """Gives the NMS that the header describes, for the cells of its network."""
    from yolino.postprocess import NMS

    arguments = {"directed": header.directed, **header.postprocess.get("nms", {})}
    try:
        return NMS(float(header.stride), **arguments)
    except TypeError as error:
        raise ValueError(f"The header's nms does not fit NMS: {error}.") from error


def build_linker(header: Header) -> Linker:
    """Gives the linker that the header describes, for the cells of its network."""
    from yolino.postprocess import LINKERS

    name = header.postprocess.get("linker", DEFAULT_LINKER)
    if name not in LINKERS:
        # A name is never imported from a model file: that would run code which its author chose.
        raise ValueError(
            f"The model's linker {name!r} is unknown; known are {', '.join(LINKERS)}. "
            "Give your own to yolino.load(model, linker=...)."
        )
    arguments = {"directed": header.directed, **header.postprocess.get("linker_options", {})}
    try:
        linker: Linker = LINKERS[name](float(header.stride), **arguments)
    except TypeError as error:
        raise ValueError(f"The header's linker_options do not fit the linker {name!r}: {error}.") from error
    return linker


__all__ = [
    "DEFAULT_LINKER",
    "Linker",
    "Suppressor",
    "build_flip",
    "build_linker",
    "build_nms",
    "build_quarters",
]
