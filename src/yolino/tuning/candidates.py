"""What the network says about each image, and the labels: all that a setting needs to be scored."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from yolino.datasets import Dataset, TuSimple
from yolino.datasets.tusimple import Record, polylines_to_record
from yolino.evaluate.worst import pixels_of
from yolino.inference import Predictor
from yolino.metrics import Metric, TuSimpleMetric
from yolino.types import Polylines, Segments

Progress = Callable[[Sequence[int]], Iterable[int]]


@dataclass(frozen=True, eq=False)
class Candidates:
    """One image.

    Attributes:
        name: Name of the image.
        size: `(height, width)` of the image.
        truth: The labels, in pixels of the image.
        ignore: Polygons in pixels inside which nothing is scored.
        segments: What the network gives, in pixels of its input.
        matrix: From there to pixels of the image.
        record: Its record in the TuSimple benchmark, None elsewhere.
    """

    name: str
    size: tuple[int, int]
    truth: Polylines
    ignore: Sequence[Float[np.ndarray, "_ 2"]]
    segments: Segments
    matrix: Float[np.ndarray, "3 3"]
    record: Record | None = None

    def above(self, threshold: float) -> Segments:
        """Gives the segments with at least the threshold, as `Predictor` compares it."""
        return self.segments[self.segments.scores >= np.float32(threshold)]

    def score(self, metric: Metric, lines: Polylines) -> None:
        """Adds the image with these polylines, in its pixels, to a metric. Classes do not count."""
        if self.record is not None and isinstance(metric, TuSimpleMetric):
            rows = self.record["h_samples"]
            found = polylines_to_record(self.record["raw_file"], lines, rows, size=self.size)
            metric.update_lanes(found["lanes"], self.record["lanes"], rows)
            return
        metric.update(_without_classes(lines), _without_classes(self.truth), self.size, self.ignore)


def gather(
    predictor: Predictor, dataset: Dataset, threshold: float, *, progress: Progress = iter
) -> list[Candidates]:
    """Gives what the network says about each image, with labels; it runs once for each.

    Args:
        predictor: The model; its own threshold, NMS and linker do not matter.
        dataset: Labelled images.
        threshold: Lowest score of the segments that are kept.
        progress: Wraps the indices that are looped over, to show a progress bar.

    Raises:
        ValueError: An image is damaged.
        FileNotFoundError: An image is missing.
    """
    seer = Predictor(
        predictor.engine,
        predictor.header,
        threshold=threshold,
        flip=predictor.flip,
        batch_size=1,
        overlap=predictor.overlap,
    )
    found = []
    for index in progress(range(len(dataset))):
        sample = dataset[index]
        image = pixels_of(sample)
        segments, matrix = seer.detect(image)
        record = dataset.record(index) if isinstance(dataset, TuSimple) else None
        size = (image.shape[0], image.shape[1])
        labels = (sample.polylines, sample.ignore)
        found.append(Candidates(sample.name, size, *labels, segments, matrix, record))
    return found


def _without_classes(lines: Polylines) -> Polylines:
    return Polylines(lines.vertices, lines.offsets, lines.scores)


__all__ = ["Candidates", "Progress", "gather"]
