"""Loops that are compiled to machine code, by numba, and kept on disk."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, overload

from numba import njit

Kernel = Callable[..., Any]


@overload
def compiled(function: Kernel, /) -> Kernel: ...
@overload
def compiled(*, inline: bool = False) -> Callable[[Kernel], Kernel]: ...
def compiled(
    function: Kernel | None = None, /, *, inline: bool = False
) -> Kernel | Callable[[Kernel], Kernel]:
    """Marks a function of plain arrays and numbers to be compiled.

    It computes as numpy does (a division by zero gives an infinity) and other threads run meanwhile.

    Args:
        function: The function.
        inline: Whether it becomes part of the functions that call it.
    """
    compile_one: Callable[[Kernel], Kernel] = njit(
        cache=True, error_model="numpy", nogil=True, inline="always" if inline else "never"
    )
    return compile_one if function is None else compile_one(function)


__all__ = ["Kernel", "compiled"]
