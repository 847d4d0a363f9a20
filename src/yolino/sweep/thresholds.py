"""From which score on segments count: for the segments' own scores, and for the lines made of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from yolino.datasets import Dataset
from yolino.evaluate import point_radius
from yolino.inference import Predictor
from yolino.metrics import PointMetric
from yolino.postprocess.mapping import map_polylines, map_segments
from yolino.training.validation import THRESHOLDS
from yolino.tuning.candidates import gather
from yolino.tuning.objective import build_objective

TRIED = (*THRESHOLDS, 0.97, 0.99)  # small cells want more than training tries at each validation


class Thresholds(NamedTuple):
    """The lowest score that counts.

    Attributes:
        segments: With which the segments that the NMS leaves have the best point F1.
        lines: With which the lines are best: `accuracy - FP / 2 - FN / 2` of the TuSimple benchmark for its
            data, else their point F1.
    """

    segments: float
    lines: float


def choose_thresholds(predictor: Predictor, dataset: Dataset) -> Thresholds:
    """Gives the best of `TRIED` on labelled images; the network runs once for each.

    They differ: a line stays whole with segments that are rather false on their own. With one for both,
    networks that are sure of everything would look better or worse than they are.

    Args:
        predictor: The model; its own threshold does not matter.
        dataset: Labelled images, on which nothing else should be scored where that can be avoided.

    Raises:
        ValueError: An image is damaged.
        FileNotFoundError: An image is missing.
    """
    header = predictor.header
    images = gather(predictor, dataset, TRIED[0])
    objective = build_objective(None, header, dataset)
    every = np.ones((1, len(images)))
    f1, worth = [], []
    for threshold in TRIED:
        points = PointMetric(directed=header.directed and dataset.directed, radius=point_radius(header))
        lines = objective.make()
        for image in images:
            segments = predictor.nms(image.above(threshold))
            points.update(map_segments(segments, image.matrix), image.truth, image.size, image.ignore)
            image.score(lines, map_polylines(predictor.linker(segments), image.matrix))
        f1.append(points.compute()["f1"])
        worth.append(objective.values(lines, every)[0])
    return Thresholds(TRIED[int(np.argmax(f1))], TRIED[int(np.argmax(worth))])


__all__ = ["TRIED", "Thresholds", "choose_thresholds"]
