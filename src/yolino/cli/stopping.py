"""Ctrl-C (or `kill`) as a wish to stop soon, with what was begun brought to its end."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType

_KINDS = (signal.SIGINT, signal.SIGTERM)


class Stop:
    """Whether the run is to end.

    Attributes:
        number: The signal that came; 0 before one did.
    """

    def __init__(self) -> None:
        self.number = 0

    @property
    def exit_code(self) -> int:
        """What shells expect of a command that a signal ended."""
        return 128 + self.number


@contextlib.contextmanager
def stopped_by_signals() -> Iterator[Stop]:
    """Lets the first Ctrl-C in the block only be noted; a second one ends the program at once."""
    stop = Stop()
    if threading.current_thread() is not threading.main_thread():  # Python lets no other set handlers
        yield stop
        return
    before = {kind: signal.getsignal(kind) or signal.SIG_DFL for kind in _KINDS}

    def restore() -> None:
        for kind in _KINDS:
            signal.signal(kind, before[kind])

    def note(number: int, frame: FrameType | None) -> None:
        stop.number = number
        restore()

    for kind in _KINDS:
        if before[kind] is not signal.SIG_IGN:  # a command in the background of a shell
            signal.signal(kind, note)
    try:
        yield stop
    finally:
        restore()


__all__ = ["Stop", "stopped_by_signals"]
