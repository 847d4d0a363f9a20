"""Many images: threads that each do whole images, with the results in the order of the sources."""

from __future__ import annotations

import copy
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from yolino.image import as_rgb
from yolino.inference.engine import Engine, usable_cores
from yolino.io import read_image, read_reduced
from yolino.types import Output, Polylines

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from yolino.inference.predictor import Predictor

Item = TypeVar("Item")
Made = TypeVar("Made")

_AHEAD = 3  # items under way for each worker: a slow one keeps the others waiting only after so many
MOST = 16  # threads by default: Python's own part of the work lets no more run at once
_LOOK_S = 0.2  # Windows delivers no Ctrl-C to a thread that waits without end


@dataclass(frozen=True, eq=False)
class ImageResult:
    """What was found in one image of many.

    Attributes:
        source: The path or array, as it was given.
        size: `(height, width)` of the image; (0, 0) if it cannot be read.
        polylines: In pixels of the image; none if it cannot be read.
        error: Why the image cannot be read, a sentence; None if it can.
        milliseconds: How long each step took: "reading" and "predicting".
    """

    source: Path | str | NDArray[np.generic]
    size: tuple[int, int]
    polylines: Polylines
    error: str | None
    milliseconds: Mapping[str, float]


def stream(
    predictor: Predictor,
    sources: Iterable[Path | str | NDArray[np.generic]],
    *,
    workers: int | None = None,
    reduced: bool = False,
) -> Generator[ImageResult, None, None]:
    """Gives what `predictor` finds in each of many images, in their order, several at a time.

    Each worker thread reads an image, predicts it and takes the next one. A few images are under way at
    once, so the memory stays flat for any number of them and `sources` may be endless; it is iterated where
    the results are. An image that cannot be read gives a result with an `error`; what else fails is raised.
    When the results are no longer taken (`close`), the threads end after the images that they are at.

    On a processor this is fastest if the network is loaded for as many callers as there are cores:
    `yolino.load(streams=cores)`.

    Args:
        predictor: What finds the polylines. No more threads than its network was loaded for (`streams`) run
            it at once; the others read, or post-process, meanwhile. A linker of your own must bear that.
        sources: Paths of image files, or arrays as for `Predictor`.
        workers: Number of threads; by default one more than the network was loaded for, and at least as many
            as there are cores (up to 16).
        reduced: Whether a JPEG of at least twice the network's resolution is decoded at a half, a quarter or
            an eighth of its size, which takes half the time or less. The decoder then averages pixels in
            another way than the preprocessing: values that the network sees differ by .25 of 255 on average
            in photos and, at sharp edges, by up to 20. Lines just above a threshold may come or go.

    Raises:
        ValueError: If `workers` is not positive, or `sources` is a single path or image.
    """
    if isinstance(sources, str | Path) or (isinstance(sources, np.ndarray) and sources.ndim != 4):
        raise ValueError("sources is a single image, but a sequence is needed: give a list of them.")
    streams = predictor.engine.streams
    count = max(streams + 1, min(usable_cores(), MOST)) if workers is None else workers
    shared = limited(predictor, streams) if count > streams else predictor
    return in_order(_Detection(shared, reduced=reduced), sources, workers=count)


def limited(predictor: Predictor, streams: int) -> Predictor:
    """Gives the predictor for any number of threads, of which at most `streams` run its network at once."""
    shared = copy.copy(predictor)
    shared.engine = cast(Engine, _Turns(predictor.engine, streams))
    return shared


def in_order(
    work: Callable[[Item], Made], items: Iterable[Item], *, workers: int, ahead: int | None = None
) -> Generator[Made, None, None]:
    """Yields `work(item)` of each item in their order; several threads work at once.

    Args:
        work: Must bear several calls at once. An exception is raised in its turn and ends all.
        items: Iterated by the thread that takes the results, a few items before each result.
        workers: Number of threads.
        ahead: Number of items under way, at least `workers`; three for each worker by default.

    Raises:
        ValueError: If `workers` is not positive.
    """
    if workers < 1:
        raise ValueError(f"workers is {workers}, but must be at least 1.")
    return _in_order(work, iter(items), workers, max(ahead or _AHEAD * workers, workers))


def _in_order(
    work: Callable[[Item], Made], items: Iterator[Item], workers: int, ahead: int
) -> Generator[Made, None, None]:
    under_way: deque[Future[Made]] = deque()
    failure: Exception | None = None
    pool = ThreadPoolExecutor(workers, thread_name_prefix="yolino-worker")
    try:
        while True:
            try:
                under_way.append(pool.submit(work, next(items)))
            except StopIteration:
                break
            except Exception as error:  # raised after the results before it
                failure = error
                break
            while under_way and (len(under_way) >= ahead or under_way[0].done()):
                yield _taken(under_way.popleft())
        while under_way:
            yield _taken(under_way.popleft())
    finally:
        pool.shutdown(cancel_futures=True)
    if failure is not None:
        raise failure


def _taken(future: Future[Made]) -> Made:
    while not future.done():
        wait([future], timeout=_LOOK_S)
    return future.result()


class _Turns:
    """A network that lets so many threads in at once; the others wait.

    Args:
        engine: The network.
        streams: How many.
    """

    def __init__(self, engine: Engine, streams: int) -> None:
        self._engine, self._turns = engine, threading.BoundedSemaphore(streams)

    def __call__(self, batch: np.ndarray, /) -> Output:
        with self._turns:
            return self._engine(batch)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._engine, name)


class _Detection:
    """What a worker does with an image."""

    def __init__(self, predictor: Predictor, *, reduced: bool) -> None:
        self._predictor, self._reduced = predictor, reduced

    def __call__(self, source: Path | str | NDArray[np.generic]) -> ImageResult:
        start = time.perf_counter()
        try:
            image, reduction = self._read(source)
        except (ValueError, OSError, MemoryError) as error:
            taken = {"reading": (time.perf_counter() - start) * 1e3, "predicting": 0.0}
            return ImageResult(source, (0, 0), Polylines.from_list([]), explain(error, source), taken)
        begin = time.perf_counter()
        polylines = self._predictor(image)
        if reduction > 1:  # a power of two: exact
            polylines = polylines.with_vertices(polylines.vertices * reduction)
        taken = {"reading": (begin - start) * 1e3, "predicting": (time.perf_counter() - begin) * 1e3}
        size = (image.shape[0] * reduction, image.shape[1] * reduction)
        return ImageResult(source, size, polylines, None, taken)

    def _read(self, source: Path | str | NDArray[np.generic]) -> tuple[np.ndarray, int]:
        """Gives the pixels, and by how much they are reduced."""
        if not isinstance(source, str | Path):
            return as_rgb(source), 1
        if self._reduced:
            return read_reduced(source, self._predictor.preprocess.reduction)
        return read_image(source), 1


def explain(error: BaseException, source: object) -> str:
    """Gives the sentence about an image that cannot be read."""
    name = source if isinstance(source, str | Path) else "The image"
    return " ".join(str(error).split()) or f"{name} is too large for the memory."


__all__ = ["MOST", "ImageResult", "explain", "in_order", "limited", "stream"]
