"""Settings and how good they are; each is scored once, on all images."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from yolino.header import Header
from yolino.inference.postprocessing import build_linker, build_nms
from yolino.inference.predictor import DEFAULT_THRESHOLD
from yolino.metrics import Metric
from yolino.postprocess.mapping import map_polylines
from yolino.tuning.candidates import Candidates
from yolino.tuning.objective import Objective
from yolino.tuning.space import Point, Space
from yolino.types import Segments

_KEPT = 4  # results of the NMS, of as many settings of it: most steps change the linker alone


class Trials:
    """Scores settings on images.

    Args:
        images: What the network says about them.
        header: The model's.
        space: The settings.
        objective: What is to be large.
        done: Is told how many settings have been scored, after each.
    """

    def __init__(
        self,
        images: Sequence[Candidates],
        header: Header,
        space: Space,
        objective: Objective,
        *,
        done: Callable[[int], None] = lambda count: None,
    ) -> None:
        self.images, self.header, self.space, self.objective = images, header, space, objective
        self._done = done
        self._metrics: dict[Point, Metric] = {}
        self._merged: dict[str, list[Segments]] = {}

    def __len__(self) -> int:
        return len(self._metrics)

    def metric(self, point: Point) -> Metric:
        """Gives the metric of a setting over all images."""
        if point not in self._metrics:
            self._metrics[point] = self.crossed([point] * len(self.images))
            self._done(len(self))
        return self._metrics[point]

    def crossed(self, points: Sequence[Point]) -> Metric:
        """Gives the metric over all images, each with a setting of its own."""
        metric = self.objective.make()
        last: Point | None = None
        for i, (image, point) in enumerate(zip(self.images, points, strict=True)):
            if point != last:
                header = self._header(point)
                merged, linker, last = self._suppress(header), build_linker(header), point
            image.score(metric, map_polylines(linker(merged[i]), image.matrix))
        return metric

    def values(self, point: Point, weights: Float[np.ndarray, "b n"]) -> Float[np.ndarray, " b"]:
        """Gives the objective of a setting for choices of images: how often each counts."""
        return self.objective.values(self.metric(point), weights)

    def value(self, point: Point, weights: Float[np.ndarray, " n"]) -> float:
        """Gives the objective of a setting for one choice of images."""
        return float(self.values(point, weights[None])[0])

    def error(self, one: Point, other: Point, groups: Int[np.ndarray, " n"]) -> float:
        """Gives the standard error of the difference between two settings (jackknife over groups of images).

        Args:
            one: A setting.
            other: Another.
            groups: Group of each image; -1: the image does not count.
        """
        names = np.unique(groups[groups >= 0])
        without = ((groups[None] >= 0) & (groups[None] != names[:, None])).astype(np.float64)
        if len(names) < 2:
            return 0.0
        apart = self.values(one, without) - self.values(other, without)
        return float(np.sqrt((len(names) - 1) * np.mean((apart - apart.mean()) ** 2)))

    def _header(self, point: Point) -> Header:
        return replace(self.header, postprocess=self.space.postprocess(point))

    def _suppress(self, header: Header) -> list[Segments]:
        """Gives what the NMS leaves of each image."""
        threshold = header.postprocess.get("threshold", DEFAULT_THRESHOLD)
        key = repr((threshold, sorted(header.postprocess.get("nms", {}).items())))
        if key not in self._merged:
            while len(self._merged) >= _KEPT:
                del self._merged[next(iter(self._merged))]
            nms = build_nms(header)
            self._merged[key] = [nms(image.above(threshold)) for image in self.images]
        self._merged[key] = self._merged.pop(key)  # the last one used goes last
        return self._merged[key]


__all__ = ["Trials"]
