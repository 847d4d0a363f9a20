"""A whole scene: windows are read ahead, segments kept, then one NMS and one linking go over all."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from yolino.inference.predictor import Predictor
from yolino.inference.scene_store import Chunk, SceneStore
from yolino.inference.views import Box, Pixels, Raster, view
from yolino.inference.windows import Window, WindowPlan
from yolino.types import Polylines, Segments

_CHUNK_WINDOWS = 64
_CHUNK_SECONDS = 10.0


class Failure(NamedTuple):
    """A window that cannot be read.

    Attributes:
        box: What it shows of the scene, `(left, top, right, bottom)` in its pixels.
        reason: Why.
    """

    box: Box
    reason: str


class Scan(NamedTuple):
    """What became of the windows.

    Attributes:
        windows: How many the scene has.
        resumed: Of these, done by an earlier run.
        empty: Of the others, how many show no valid pixel; the network did not run for them.
        failures: Those that cannot be read.
    """

    windows: int
    resumed: int
    empty: int
    failures: list[Failure]


def scan(
    predictor: Predictor,
    raster: Raster,
    store: SceneStore,
    *,
    advance: Callable[[int], None] = lambda _: None,
) -> Scan:
    """Goes over all windows of a scene that are not in the store yet, and adds their segments to it.

    When it is interrupted, what is done up to then is in the store.

    Args:
        predictor: The model; its fit is "window".
        raster: The scene.
        store: Where segments are kept.
        advance: Is told how many windows were done, again and again.

    Raises:
        ValueError: The network gives something else than its header says.
        OSError: The store cannot be written.
    """
    plan = predictor.plan(raster.size)
    done = store.done
    todo = [index for index in range(len(plan)) if index not in done]
    writer = _ChunkWriter(store)
    result = Scan(len(plan), len(done), 0, [])
    try:
        for indices, views in _read_ahead(predictor, raster, plan, todo):
            shown = [(i, v) for i, v in zip(indices, views, strict=True) if isinstance(v, Pixels)]
            result.failures.extend(v for v in views if isinstance(v, Failure))
            empty = [i for i, v in zip(indices, views, strict=True) if v is None]
            result = result._replace(empty=result.empty + len(empty))
            found: list[Segments] = []
            if shown:
                windows = [plan[i] for i, _ in shown]
                found = predictor.detect_windows([pixels for _, pixels in shown], windows)
            writer.add([*empty, *(i for i, _ in shown)], found)
            advance(len(indices))
    finally:
        writer.flush()
    return result


def link(predictor: Predictor, raster: Raster, store: SceneStore) -> Polylines:
    """Gives the polylines of a scene in its pixels, from the segments of all its windows."""
    return predictor.link([chunk.segments for chunk in store.chunks], raster.size)


class _ChunkWriter:
    """Gathers windows and adds them to the store in chunks, so that little is lost and files are few."""

    def __init__(self, store: SceneStore) -> None:
        self._store = store
        self._windows: list[int] = []
        self._found: list[Segments] = []
        self._since = time.monotonic()

    def add(self, windows: list[int], found: list[Segments]) -> None:
        self._windows += windows
        self._found += found
        if len(self._windows) >= _CHUNK_WINDOWS or time.monotonic() - self._since > _CHUNK_SECONDS:
            self.flush()

    def flush(self) -> None:
        if self._windows:
            self._store.add(Chunk(np.array(self._windows, np.int64), _concatenate(self._found)))
        self._windows, self._found, self._since = [], [], time.monotonic()


def _concatenate(parts: list[Segments]) -> Segments:
    if not parts:
        return Segments(np.zeros((0, 2, 2)))
    shares = [part.probabilities for part in parts if part.probabilities is not None]
    return Segments(
        np.concatenate([part.endpoints for part in parts]),
        np.concatenate([part.scores for part in parts]),
        probabilities=np.concatenate(shares) if shares else None,
    )


_Seen = Pixels | Failure | None


def _read_ahead(
    predictor: Predictor, raster: Raster, plan: WindowPlan, todo: list[int]
) -> Iterator[tuple[list[int], list[_Seen]]]:
    """Yields batches of windows with what they show: a `Failure` if it cannot be read, None for no data.

    The next batch is read while the one given is worked on; one thread reads, as GDAL wants it.
    """
    count, header = predictor.windows_per_run, predictor.header
    batches = [todo[i : i + count] for i in range(0, len(todo), count)]

    def read(indices: list[int]) -> list[_Seen]:
        return [_see(raster, plan[i], header.size, header.scale) for i in indices]

    with ThreadPoolExecutor(1, "yolino-scene") as pool:
        coming = pool.submit(read, batches[0]) if batches else None
        for number, batch in enumerate(batches):
            assert coming is not None
            views = coming.result()
            coming = pool.submit(read, batches[number + 1]) if number + 1 < len(batches) else None
            yield batch, views


def _see(raster: Raster, window: Window, size: tuple[int, int], scale: float) -> _Seen:
    try:
        pixels = view(raster, window, size, scale)
    except ValueError as error:
        corners = (window.left, window.top, window.left + size[1], window.top + size[0])
        limits = (raster.size[1], raster.size[0]) * 2
        left, top, right, bottom = (
            int(min(max(corner / scale, 0), limit)) for corner, limit in zip(corners, limits, strict=True)
        )
        return Failure((left, top, right, bottom), str(error))
    return None if pixels.valid is not None and not pixels.valid.any() else pixels


__all__ = ["Failure", "Scan", "link", "scan"]
