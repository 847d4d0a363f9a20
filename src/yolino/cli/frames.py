"""Options that say how cells are cut: their size, and the frame they are cut in."""

from __future__ import annotations

from typing import Annotated, Any

import typer

Strides = Annotated[
    list[int], typer.Option("--stride", min=1, metavar="PIXELS", help="Edge of the cells; may be repeated.")
]
Size = Annotated[
    tuple[int, int] | None,
    typer.Option(
        "--size", metavar="HEIGHT WIDTH", help="Input of the network.", show_default="the image's size"
    ),
]
Fit = Annotated[
    str, typer.Option("--fit", metavar="bottom|stretch|letterbox", help="How images are fitted to the input.")
]


def frame_arguments(size: tuple[int, int] | None, fit: str) -> dict[str, Any]:
    """Gives the arguments that say in which frame cells are cut.

    Raises:
        ValueError: The size or the fit is wrong.
    """
    if size is None:
        return {}
    from yolino.geometry import fit_matrix

    fit_matrix((1, 1), size, fit)  # says now what is wrong with them
    return {"size": size, "matrix": lambda image: fit_matrix(image, size, fit)}


__all__ = ["Fit", "Size", "Strides", "frame_arguments"]
