"""Steps that overlap: each in a thread of its own, with short queues between them, order kept."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

_LOOK_S = 0.2  # how often a waiting thread looks around; nothing waits for that in the usual case
_JOIN_S = 5.0
_NOTHING = object()


class Step(NamedTuple):
    """One step of the work.

    Attributes:
        name: Name for the timing.
        work: Makes the result from that of the step before; runs in one thread, so it may have a state.
    """

    name: str
    work: Callable[[Any], Any]


class Pipeline:
    """Sends the items of a source through steps that overlap, and yields the results in order.

    Every queue holds a few items: where a step is slow, those before it wait. A step that fails ends the run;
    its exception is raised where the results are taken, after all results before it.

    Args:
        source: Yields the items; iterated in a thread of its own.
        steps: What is done with each item, at least one.
        depth: Items in a queue.
        latest: Whether an item of the source that nobody had time for gives way to a newer one (cameras).

    Raises:
        ValueError: If there is no step or no room in the queues.
    """

    def __init__(
        self, source: Iterable[Any], steps: Sequence[Step], *, depth: int = 2, latest: bool = False
    ) -> None:
        if not steps or depth < 1:
            raise ValueError(
                f"A pipeline needs a step and queues of at least 1, got {len(steps)} and {depth}."
            )
        self.seconds: dict[str, float] = {"reading": 0.0, **{step.name: 0.0 for step in steps}}
        self._source, self._stopped = source, False
        self._channels = [Channel(1 if latest else depth, latest=latest)]
        self._channels += [Channel(depth) for _ in steps]
        self._threads = [threading.Thread(target=self._read, name="yolino-reading", daemon=True)]
        for i, step in enumerate(steps):
            thread = threading.Thread(
                target=self._run, args=(i, step), name=f"yolino-{step.name}", daemon=True
            )
            self._threads.append(thread)

    @property
    def dropped(self) -> int:
        """How many items of the source gave way to newer ones."""
        return self._channels[0].dropped

    def __iter__(self) -> Iterator[Any]:
        """Yields the results in the order of the source; once."""
        for thread in self._threads:
            thread.start()
        try:
            while (package := self._channels[-1].get()) is not None:
                if package.error is not None:
                    raise package.error
                yield package.item
        finally:
            self.close()

    def stop(self) -> None:
        """Begins with no more items; those under way are finished. May be called by a signal handler."""
        self._stopped = True  # and no lock is taken: the thread that is interrupted may hold it

    def close(self) -> None:
        """Ends all threads; what is under way is lost."""
        self._stopped = True
        for channel in self._channels:
            channel.close()
        for thread in self._threads:
            if thread.is_alive():
                thread.join(_JOIN_S)

    def _read(self) -> None:
        items = iter(self._source)
        try:
            while True:
                start = time.perf_counter()
                item = next(items, _NOTHING)
                self.seconds["reading"] += time.perf_counter() - start
                if item is _NOTHING or self._stopped or not self._channels[0].put(Package(item)):
                    break
        except BaseException as error:
            self._channels[0].put(Package(None, error))
        finally:
            if isinstance(items, Generator):  # which gives its source back, in the thread that used it
                items.close()
            self._channels[0].end()

    def _run(self, index: int, step: Step) -> None:
        before, after = self._channels[index], self._channels[index + 1]
        stopped = (lambda: self._stopped) if index == 0 else None
        while (package := before.get(stopped)) is not None:
            if package.error is None:
                package = self._work(step, package.item)
            if not after.put(package) or package.error is not None:
                break
        before.close()
        after.end()

    def _work(self, step: Step, item: Any) -> Package:
        start = time.perf_counter()
        try:
            return Package(step.work(item))
        except BaseException as error:
            return Package(None, error)
        finally:
            self.seconds[step.name] += time.perf_counter() - start


class Package(NamedTuple):
    """What goes through the queues: an item, or the exception that ended the run."""

    item: Any
    error: BaseException | None = None


class Channel:
    """A short queue between two threads that either of them can end.

    Args:
        depth: How many packages fit.
        latest: Whether a full queue gives its oldest package away instead of waiting.
    """

    def __init__(self, depth: int, *, latest: bool = False) -> None:
        self.dropped = 0
        self._depth, self._latest = depth, latest
        self._packages: deque[Package] = deque()
        self._changed = threading.Condition()
        self._ended = self._closed = False

    def put(self, package: Package) -> bool:
        """Adds a package, waiting for room; False if nobody wants any more."""
        with self._changed:
            while len(self._packages) >= self._depth and not (self._latest or self._closed):
                self._changed.wait(_LOOK_S)
            if self._closed:
                return False
            if len(self._packages) >= self._depth and package.error is None:
                self._packages.popleft()
                self.dropped += 1
            self._packages.append(package)
            self._changed.notify_all()
            return True

    def get(self, stopped: Callable[[], bool] | None = None) -> Package | None:
        """Gives the next package, waiting for it; None if there is none any more.

        Args:
            stopped: Tells that no more is wanted, so that a source which hangs keeps nobody waiting.
        """
        with self._changed:
            wanted = True
            while not (self._packages or self._ended or self._closed) and wanted:
                self._changed.wait(_LOOK_S)
                wanted = stopped is None or not stopped()
            if self._closed or not self._packages or (stopped is not None and stopped()):
                return None
            package = self._packages.popleft()
            self._changed.notify_all()
            return package

    def end(self) -> None:
        """Says that no package will come any more; those that are there can still be taken."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def close(self) -> None:
        """Throws away what is there; nobody waits any more."""
        with self._changed:
            self._closed = True
            self._packages.clear()
            self._changed.notify_all()


__all__ = ["Channel", "Package", "Pipeline", "Step"]
