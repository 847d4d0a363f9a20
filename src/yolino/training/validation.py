"""What validation measures: segments and the lines made of them, at several thresholds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from yolino.config import Postprocess
from yolino.metrics import PointMetric
from yolino.postprocess import LINKERS, NMS
from yolino.types import Polylines, Segments

# Validation tries these scores; the one with the best lines goes into the model file.
THRESHOLDS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)


class Validation:
    """Scores segments after the NMS, and their polylines, with the paper's point metric.

    The thresholds with the best segments and with the best lines differ: the best segments are the few surest
    ones, from which the linker makes lines with holes.

    Args:
        postprocess: That of the experiment.
        stride: Side of a cell in pixels.
        directed: Whether lines have a direction.
    """

    def __init__(self, postprocess: Postprocess, stride: float, *, directed: bool) -> None:
        arguments: dict[str, Any] = {"directed": directed}
        self.nms = NMS(stride, **{**arguments, **postprocess.nms})
        self.linker: Callable[[Segments], Polylines] = LINKERS[postprocess.linker](
            stride, **{**arguments, **postprocess.linker_options}
        )
        self.segments = {threshold: PointMetric(directed=directed) for threshold in THRESHOLDS}
        self.lines = {threshold: PointMetric(directed=directed) for threshold in THRESHOLDS}

    def add(
        self, segments: Segments, truth: Polylines, size: tuple[int, int], ignore: Sequence[Any] = ()
    ) -> None:
        """Adds an image.

        Args:
            segments: What the network gives, above the lowest of the thresholds, in pixels of its input.
            truth: The labels, there.
            size: `(height, width)` of the input.
            ignore: Polygons inside which nothing is scored.
        """
        for threshold in THRESHOLDS:
            found = self.nms(segments[segments.scores >= threshold])
            self.segments[threshold].update(found, truth, size, ignore)
            self.lines[threshold].update(self.linker(found), truth, size, ignore)

    def scores(self) -> dict[str, float]:
        """Gives the scores by name.

        Returns:
            `threshold` is that with the best `line_f1`; `f1`, `precision` and `recall` are those of the
            segments, at the threshold that is best for them.
        """
        segments = {threshold: metric.compute() for threshold, metric in self.segments.items()}
        lines = {threshold: metric.compute()["f1"] for threshold, metric in self.lines.items()}
        best = max(THRESHOLDS, key=lambda threshold: segments[threshold]["f1"])
        chosen = max(THRESHOLDS, key=lambda threshold: (lines[threshold], segments[threshold]["f1"]))
        found = {name: float(segments[best][name]) for name in ("f1", "precision", "recall")}
        return {"threshold": chosen, **found, "line_f1": float(lines[chosen])}


__all__ = ["THRESHOLDS", "Validation"]
