"""Validation scores segments and lines apart, each at the threshold that is best for it."""

from __future__ import annotations

import numpy as np
import pytest

from yolino.config import Postprocess
from yolino.metrics import PointMetric
from yolino.training.validation import THRESHOLDS, Validation
from yolino.types import Polylines, Segments

SIZE = (320, 320)


def scene(rng: np.random.Generator | None = None) -> tuple[Segments, Polylines]:
    """A line of twelve segments, the middle two of a low score, and false ones apart from it, also low."""
    steps = np.array([[40.0, 300 - 16 * i] for i in range(13)])
    true = np.stack([steps[:-1], steps[1:]], axis=1)
    false = np.array([[[x, y], [x, y - 16.0]] for x in range(100, 300, 40) for y in range(60, 300, 48)])
    scores = np.where(np.isin(np.arange(12), (5, 6)), 0.35, 0.9)
    scores = np.concatenate([scores, np.full(len(false), 0.35)])
    if rng is not None:
        scores = rng.random(len(scores))
    return Segments(np.concatenate([true, false]), scores), Polylines.from_list([steps])


def board(**options: float) -> Validation:
    chain = Postprocess(linker="chain", linker_options=options)
    return Validation(chain, 16.0, directed=True)


def test_the_threshold_of_the_model_is_that_of_the_best_lines() -> None:
    validation = board(max_gap_cells=0.0, min_length_cells=8.0)
    validation.add(*scene(), SIZE)
    found = validation.scores()
    assert (found["threshold"], found["line_f1"]) == (0.1, pytest.approx(1.0))
    # Two of twelve segments are missing: recall 10 / 12, and nothing is wrong.
    assert (found["precision"], found["recall"]) == (1.0, pytest.approx(10 / 12, abs=0.02))
    assert found["f1"] == pytest.approx(2 * found["recall"] / (1 + found["recall"]))


def test_without_any_line_the_segments_decide() -> None:
    validation = board(min_length_cells=99.0)
    validation.add(*scene(), SIZE)
    found = validation.scores()
    assert (found["line_f1"], found["threshold"]) == (0.0, 0.4)


def test_each_score_is_the_best_of_all_thresholds() -> None:
    validation, rng = board(), np.random.default_rng(0)
    images = [scene(rng) for _ in range(3)]
    for image in images:
        validation.add(*image, SIZE)
    segment_f1, line_f1 = [], []
    for threshold in THRESHOLDS:
        segments, lines = PointMetric(directed=True), PointMetric(directed=True)
        for found, truth in images:
            merged = validation.nms(found[found.scores >= threshold])
            segments.update(merged, truth, SIZE, ())
            lines.update(validation.linker(merged), truth, SIZE, ())
        segment_f1.append(segments.compute()["f1"])
        line_f1.append(lines.compute()["f1"])
    found = validation.scores()
    assert found["f1"] == max(segment_f1)
    assert found["line_f1"] == max(line_f1)
    assert found["threshold"] == THRESHOLDS[int(np.argmax(line_f1))]
    assert len(set(line_f1)) > 3
