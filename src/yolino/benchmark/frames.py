"""One frame through a predictor, with a clock between its steps."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from yolino.benchmark.scenes import as_output, noisy_candidates
from yolino.inference import Engine, Predictor
from yolino.types import Output

STEPS = {
    "preprocess": "preprocess: crop, resize",
    "network": "network",
    "threshold": "threshold, to segments",
    "nms": "NMS",
    "linking": "linking and spline",
    "mapping": "back to the image",
}
CANDIDATES = 500
# Frames of a turn, as in a video: the first one brings weights and code back into the processor's caches.
ROW = 6


class _Clocked:
    """Calls a step of the predictor and notes when it began and ended."""

    def __init__(self, step: Callable[[Any], Any], clock: list[float]) -> None:
        self._step, self._clock = step, clock

    def __call__(self, value: Any, /) -> Any:
        self._clock.append(perf_counter())
        result = self._step(value)
        self._clock.append(perf_counter())
        return result


class _ClockedEngine(_Clocked):
    """Does the same for the network; once it has run, it may hand on an output that was made up."""

    def __init__(self, engine: Engine, clock: list[float], instead: Output | None) -> None:
        super().__init__(engine, clock)
        self.header, self._instead = engine.header, instead
        self.name, self.device, self.precision = engine.name, engine.device, engine.precision
        self.streams = engine.streams

    def __call__(self, value: Any, /) -> Any:
        result = super().__call__(value)
        return result if self._instead is None else self._instead


class ClockedFrame:
    """The whole way of one image through a predictor; each call adds a row to `rows`.

    Args:
        predictor: The steps.
        image: RGB pixels.
        instead: What the post-processing gets in place of the network's output.

    Attributes:
        rows: Seconds of each step (the order of `STEPS`), a row for each call.
    """

    def __init__(
        self, predictor: Predictor, image: UInt8[np.ndarray, "h w 3"], instead: Output | None = None
    ) -> None:
        self.rows: list[Float[np.ndarray, " 6"]] = []
        self._clock: list[float] = []
        self._image = image
        self._predictor = Predictor(
            _ClockedEngine(predictor.engine, self._clock, instead),
            predictor.header,
            threshold=predictor.threshold,
            nms=_Clocked(predictor.nms, self._clock),
            linker=_Clocked(predictor.linker, self._clock),
        )

    def __call__(self) -> None:
        """Runs it once."""
        self._clock.clear()
        start = perf_counter()
        self._predictor(self._image)
        stop = perf_counter()
        steps = np.diff([start, *self._clock, stop])
        steps[4] += steps[5]  # from the end of the NMS to the start of the linker
        self.rows.append(np.delete(steps, 5))


def made_up_output(predictor: Predictor, rng: np.random.Generator) -> Output:
    """Gives an output of the predictor's network with 500 candidates (fewer, if it is small) around lanes."""
    header = predictor.header
    cells = (header.size[0] // header.stride) * (header.size[1] // header.stride)
    count = min(CANDIDATES, cells * header.predictors // 2)
    candidates = noisy_candidates(rng, count, size=header.size, stride=header.stride)
    return as_output(candidates, cells * header.predictors, predictor.threshold, len(header.classes))


def bare_network(
    predictor: Predictor, image: UInt8[np.ndarray, "h w 3"], *, count: int = 1
) -> Callable[[], object]:
    """Gives the network alone, on the input that the image makes, `count` times."""
    batch = np.repeat(predictor.preprocess(image)[0][None], count, axis=0)
    return lambda: predictor.engine(batch)


def whole_batch(
    predictor: Predictor, image: UInt8[np.ndarray, "h w 3"], count: int, instead: Output | None = None
) -> Callable[[], object]:
    """Gives the whole way of a batch of the image through a predictor.

    Args:
        predictor: The steps.
        image: RGB pixels.
        count: Images in the batch.
        instead: What the post-processing gets for each image in place of the network's output.
    """
    several = None if instead is None else _repeat(instead, count)
    engine = _ClockedEngine(predictor.engine, [], several)
    batched = Predictor(engine, predictor.header, threshold=predictor.threshold, batch_size=count)
    images = [image] * count
    return lambda: batched(images)


def _repeat(output: Output, count: int) -> Output:
    shares = output.probabilities
    return Output(
        np.repeat(output.endpoints, count, axis=0),
        np.repeat(output.scores, count, axis=0),
        None if shares is None else np.repeat(shares, count, axis=0),
    )


__all__ = ["CANDIDATES", "ROW", "STEPS", "ClockedFrame", "bare_network", "made_up_output", "whole_batch"]
