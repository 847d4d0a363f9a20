"""What every dataset offers."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from yolino.types import Sample


@runtime_checkable
class Dataset(Protocol):
    """Annotated images by index.

    Attributes:
        classes: Names of the labels.
        directed: Whether the direction of a polyline means something.
    """

    classes: tuple[str, ...]
    directed: bool

    def __len__(self) -> int: ...

    def __getitem__(self, index: int, /) -> Sample: ...


__all__ = ["Dataset"]
