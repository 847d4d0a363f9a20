"""Loops in two tiers: plain Python, which begins at once, or machine code, which numba makes and keeps.

Kernels are compiled at their first call, so a program that has much to do needs to do nothing. Where little
is ahead, `expected` says so: to load compiled kernels takes longer than to run them some times as Python, and
to compile them, once after an installation, much longer. Both tiers compute the same, to the last bit.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import logging
import math
import os
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, ClassVar, overload

import numpy as np

Kernel = Callable[..., Any]

TIERS = ("auto", "compiled", "interpreted")
VARIABLE = "YOLINO_KERNELS"
# Candidate segments, of all images together, that plain Python is done with (at about .1 ms each) in the time
# to load compiled kernels (1.5 s), or in half the time to compile them; and those of a usual image.
FEW_LOADED, FEW_COMPILED, USUAL = 15_000, 150_000, 700
# What predicting calls, by name because packages above are no matter of this one: NMS, then the linkers, of
# which a model has one. With them the kernels that they call are on disk, too.
ROOTS = ("merging:suppress", "graph:_link", "chain:_link", "tree:_link")

_log = logging.getLogger(__name__)


def _read_choice() -> str:
    """Gives what `YOLINO_KERNELS` says.

    Raises:
        ValueError: It is no tier.
    """
    choice = os.environ.get(VARIABLE) or TIERS[0]
    if choice not in TIERS:
        raise ValueError(f"{VARIABLE} is {choice!r}, but must be one of {', '.join(TIERS)}.")
    return choice


class _Claim:
    """What a block wants, as the number of candidates that plain Python may still do; below 0, none."""

    def __init__(self, left: float | int) -> None:
        self.left = left


_BUDGETS = {"compiled": -math.inf, "interpreted": math.inf}


class _State:
    """What all threads share."""

    choice = _read_choice()
    interpreted = choice == "interpreted"  # all that a call reads; follows from the claims
    claims: ClassVar[list[_Claim]] = []  # of the blocks that have not ended, in any order


class _Thread(threading.local):
    """What each thread has: whether it is inside an interpreted kernel."""

    inside = False


_thread, _lock = _Thread(), threading.RLock()


class _Kernel:
    """A function in the tier in use. It looks like a dispatcher to numba, so compiled kernels may call it."""

    def __init__(self, function: Kernel, *, inline: bool) -> None:
        functools.update_wrapper(self, function)
        self.py_func = function
        self.targetoptions = {"inline": "always" if inline else "never"}
        self._dispatcher: Any = None

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        if _State.interpreted:
            return self._interpret(*arguments, **named)
        return (self._dispatcher or self.dispatcher)(*arguments, **named)

    def _interpret(self, *arguments: Any, **named: Any) -> Any:
        if _thread.inside:
            return self.py_func(*arguments, **named)
        _thread.inside = True
        try:
            with np.errstate(all="ignore"):  # machine code says nothing, either
                return self.py_func(*arguments, **named)
        finally:
            _thread.inside = False

    @property
    def dispatcher(self) -> Any:
        """Numba's: for each kind of arguments it loads what is on disk, or compiles."""
        with _lock:
            if self._dispatcher is None:
                from numba import njit

                named = _copy(self.py_func, f"{self.py_func.__qualname__}.{self.fingerprint[:12]}")
                compile_one = njit(cache=True, error_model="numpy", nogil=True, **self.targetoptions)
                self._dispatcher = compile_one(named)
        return self._dispatcher

    def __reduce__(self) -> str:
        """Pickles the name, as of a function; else it would be that of `py_func`, which is another object."""
        return self.py_func.__qualname__

    @functools.cached_property
    def fingerprint(self) -> str:
        """Names the code of the kernel and of all kernels that become part of it.

        Numba looks for a change only in the file of a kernel itself. With this in its name on disk, a kernel
        is compiled again when one that it calls has changed.
        """
        parts = [repr(self.targetoptions)]
        for code in _codes(self.py_func.__code__):
            parts += [code.co_code.hex(), *(repr(c) for c in code.co_consts if not isinstance(c, CodeType))]
            for value in map(self.py_func.__globals__.get, code.co_names):
                if isinstance(value, _Kernel) and value is not self:
                    parts.append(value.fingerprint)
                elif isinstance(value, int | float | str | tuple | np.generic):
                    parts.append(repr(value))
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()

    @property
    def _numba_type_(self) -> Any:
        return self.dispatcher._numba_type_


def _codes(code: CodeType) -> Iterator[CodeType]:
    """Yields the code of a function and of what is defined in it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def _copy(function: Kernel, name: str) -> Kernel:
    """Gives the function under another name, by which numba keeps it on disk."""
    copy = FunctionType(
        function.__code__,
        function.__globals__,
        function.__name__,
        function.__defaults__,
        function.__closure__,
    )
    copy.__module__, copy.__doc__, copy.__qualname__ = function.__module__, function.__doc__, name
    return copy


@overload
def compiled(function: Kernel, /) -> Kernel: ...
@overload
def compiled(*, inline: bool = False) -> Callable[[Kernel], Kernel]: ...
def compiled(
    function: Kernel | None = None, /, *, inline: bool = False
) -> Kernel | Callable[[Kernel], Kernel]:
    """Marks a function of plain arrays and numbers to be compiled.

    It computes as numpy does (a division by zero gives an infinity) and other threads run meanwhile. As plain
    Python it must give the same: it neither divides Python's own numbers by zero nor counts on integers that
    overflow.

    Args:
        function: The function.
        inline: Whether it becomes part of the functions that call it.
    """
    mark = functools.partial(_Kernel, inline=inline)
    return mark if function is None else mark(function)


@contextmanager
def expected(images: int) -> Iterator[bool]:
    """Says how much is ahead in the block; gives whether kernels are compiled for it.

    They are, unless plain Python is done with so few images before compiled kernels would be loaded, or made
    where none are kept on disk; see also `reconsider`. Where another block has them compiled already, they
    are for this one, too. The environment variable `YOLINO_KERNELS`, "compiled" or "interpreted", decides
    otherwise.
    """
    affordable = FEW_LOADED if "numba" in sys.modules or are_kept() else FEW_COMPILED
    with _lock:
        others = bool(_State.claims) and not _State.interpreted
        many = others or images * USUAL > affordable
        named = "compiled" if many and _State.choice == "auto" else _State.choice
        claim = _enter(_BUDGETS.get(named, float(affordable)))
        machine_code = not _State.interpreted
    try:
        yield machine_code
    finally:
        _leave(claim)


def reconsider(candidates: int) -> None:
    """Counts the candidates of an image; compiles from now on if they were too many for plain Python.

    So nobody waits much longer than with the better tier, whatever the images show. Nobody knows to which of
    several blocks an image belongs: it counts for all of them, and when one has had too many, kernels are
    compiled for the others, too, because the wait is the same.
    """
    with _lock:
        if not _State.interpreted:
            return
        for claim in _State.claims:
            claim.left -= candidates
        if all(claim.left >= 0 for claim in _State.claims):
            return
        for claim in _State.claims:
            if claim.left < math.inf:
                claim.left = -math.inf
        _settle()
    if not are_kept():
        _log.warning("There are so many segments that kernels are compiled now, which can take a minute.")


@contextmanager
def tier(name: str) -> Iterator[None]:
    """Runs kernels in the tier "compiled" or "interpreted" in the block, in all threads.

    Of several blocks at a time, in whichever threads, one that wants them compiled decides.
    """
    claim = _enter(_BUDGETS[name])
    try:
        yield
    finally:
        _leave(claim)


def _enter(left: float | int) -> _Claim:
    claim = _Claim(left)
    with _lock:
        _State.claims.append(claim)
        _settle()
    return claim


def _leave(claim: _Claim) -> None:
    """Takes away a claim, whichever others began or ended meanwhile."""
    with _lock:
        _State.claims.remove(claim)
        _settle()


def _settle() -> None:
    """Chooses the tier: interpreted while all claims want it; without claims, the default."""
    wishes = [claim.left >= 0 for claim in _State.claims]
    _State.interpreted = all(wishes) if wishes else _State.choice == "interpreted"


def are_kept() -> bool:
    """Gives whether compiled kernels of this version are on disk.

    A guess from the names of files: numba knows for sure, but loads slowly.
    """
    folders = tuple(_folders())
    nms, *linkers = (_is_kept(_root(name), folders) for name in ROOTS)
    return nms and any(linkers)


def _root(name: str) -> _Kernel:
    module, _, function = name.partition(":")
    kernel: _Kernel = getattr(importlib.import_module(f"yolino.postprocess.{module}"), function)
    return kernel


def _is_kept(kernel: _Kernel, folders: Iterable[Path]) -> bool:
    """Gives whether numba's index of a kernel as it is now is there.

    Its time says nothing: numba compares the content of the source file, which may be older or younger.
    """
    line, (major, minor) = kernel.py_func.__code__.co_firstlineno, sys.version_info[:2]
    name = f"*.{kernel.fingerprint[:12]}-{line}.py{major}{minor}*.nbi"
    return any(True for folder in folders for _ in folder.glob(name))


def _folders() -> Iterator[Path]:
    """Yields the folders where numba may keep the kernels of predicting."""
    named = os.environ.get("NUMBA_CACHE_DIR")
    home = Path.home()  # for a package whose folder cannot be written
    users = (Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache"), home / "Library/Caches")
    if not named:
        yield Path(__file__).parent / "postprocess" / "__pycache__"
    for place in (Path(named),) if named else (user / "numba" for user in users):
        yield from place.glob("postprocess_*")


__all__ = ["TIERS", "VARIABLE", "Kernel", "are_kept", "compiled", "expected", "reconsider", "tier"]
