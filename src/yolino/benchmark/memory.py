"""How much memory a call takes, whoever allocates it: numpy, compiled kernels or a network's engine."""

from __future__ import annotations

import ctypes
import gc
import sys
from collections.abc import Callable
from pathlib import Path

_STATUS, _RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")
_RESET_PEAK = "5"
_KIBI, _MEGA = 1024, 1e6


def peak_megabytes(run: Callable[[], object]) -> float | None:
    """Gives the most memory that the process held during a call, less what it held before, in megabytes.

    The system counts it (resident memory, on Linux), so it includes what tracemalloc cannot see: compiled
    kernels, OpenCV, the engine of a network. Memory that was freed before is given back to the system first,
    else the call would take it again without being noticed. It is exact to some tenths of a megabyte.

    Args:
        run: What to call, once.

    Returns:
        The megabytes, or None where the system does not tell.
    """
    if sys.platform != "linux" or not _RESET.exists():
        return None
    gc.collect()
    _give_back()
    _RESET.write_text(_RESET_PEAK)
    before = _kibibytes("VmRSS")
    run()
    return max(_kibibytes("VmHWM") - before, 0) * _KIBI / _MEGA


def _give_back() -> None:
    """Hands free memory to the system, where the C library can do that."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def _kibibytes(name: str) -> int:
    lines = _STATUS.read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(name))


__all__ = ["peak_megabytes"]
