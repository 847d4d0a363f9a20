"""What holds for every metric of `METRICS`."""

from __future__ import annotations

import math

import numpy as np
import pytest

from yolino.metrics import METRICS, SumMetric, bootstrap_intervals
from yolino.types import Polylines

SIZE = (720, 1280)


def lanes(*columns: float) -> Polylines:
    """Lanes from the bottom of the image to the top, labelled 0, 1, 0, ..."""
    lines = [[[x, 720], [x + 40, 400], [x + 60, 100]] for x in columns]
    return Polylines.from_list(lines, labels=[i % 2 for i in range(len(lines))])


IMAGES = [
    (lanes(100, 500, 900), lanes(105, 500, 905)),
    (lanes(100, 900), lanes(100, 400, 900)),
    (lanes(100, 300, 600), lanes(130, 600)),
    (lanes(), lanes(600)),
    (lanes(600), lanes()),
]


@pytest.fixture(params=METRICS)
def name(request: pytest.FixtureRequest) -> str:
    return request.param


def scores_of(name: str, *images: tuple[Polylines, Polylines]) -> dict[str, float]:
    metric = METRICS[name]()
    for prediction, truth in images:
        metric.update(prediction, truth, SIZE)
    return metric.compute()


def test_perfect_is_one(name: str) -> None:
    for truth in (lanes(600), lanes(100, 300, 500), lanes(100, 300, 500, 700, 900)):
        assert scores_of(name, (truth, truth))[METRICS[name].headline] == 1


def test_all_wrong_is_zero(name: str) -> None:
    assert scores_of(name, (lanes(200), lanes(900)))[METRICS[name].headline] <= 0.2


def test_empty_sides_are_defined(name: str) -> None:
    headline = METRICS[name].headline
    assert scores_of(name, (lanes(), lanes(600)))[headline] <= 0.2
    assert scores_of(name, (lanes(600), lanes()))[headline] == 0
    for images in [(lanes(), lanes())], [IMAGES[3]], [IMAGES[4]], IMAGES[3:]:
        assert all(math.isfinite(score) for score in scores_of(name, *images).values())


def test_the_order_of_the_images_does_not_matter(name: str) -> None:
    assert scores_of(name, *IMAGES) == pytest.approx(scores_of(name, *IMAGES[::-1]), rel=1e-12)


def test_the_order_of_the_lines_does_not_matter(name: str) -> None:
    rng = np.random.default_rng(4)
    expected = scores_of(name, *IMAGES)
    for _ in range(5):
        shuffled = [tuple(side[rng.permutation(len(side))] for side in image) for image in IMAGES]
        assert scores_of(name, *shuffled) == pytest.approx(expected, rel=1e-12)  # type: ignore[arg-type]


def test_scores_have_the_headline_and_lie_between_0_and_1(name: str) -> None:
    scores = scores_of(name, *IMAGES)
    assert METRICS[name].headline in scores
    assert all(type(score) is float and 0 <= score <= 1 for score in scores.values())


def test_before_the_first_image_there_is_no_score(name: str) -> None:
    with pytest.raises(ValueError, match=r"call update\(\) first"):
        METRICS[name]().compute()


def test_weights_count_images_as_often(name: str) -> None:
    metric = METRICS[name]()
    for prediction, truth in IMAGES:
        metric.update(prediction, truth, SIZE)
    often = np.array([[1, 1, 1, 1, 1], [2, 0, 1, 0, 3], [0, 1, 0, 0, 0]])
    weighted = metric.weighted(often.astype(np.float64))
    for row, counts in enumerate(often):
        images = [image for image, count in zip(IMAGES, counts, strict=True) for _ in range(count)]
        expected = scores_of(name, *images)
        assert {key: float(values[row]) for key, values in weighted.items()} == pytest.approx(expected)


def test_sums_of_parts_are_the_whole(name: str) -> None:
    metric = METRICS[name]()
    if not isinstance(metric, SumMetric):
        return  # a ranking is no sum
    for prediction, truth in IMAGES:
        metric.update(prediction, truth, SIZE)
    parts = metric.rows[:2].sum(axis=0) + metric.rows[2:].sum(axis=0)
    assert {k: float(v) for k, v in metric.scores(parts).items()} == pytest.approx(metric.compute())


def test_a_region_that_covers_all_leaves_nothing(name: str) -> None:
    if name == "tusimple":
        return  # the benchmark knows no such regions and says so
    metric = METRICS[name]()
    everything = np.array([[-10.0, -10.0], [1290.0, -10.0], [1290.0, 730.0], [-10.0, 730.0]])
    metric.update(lanes(100, 500), lanes(900), SIZE, [everything])
    assert metric.compute()[METRICS[name].headline] == 1


def test_intervals_hold_the_scores(name: str) -> None:
    metric = METRICS[name]()
    for prediction, truth in IMAGES:
        metric.update(prediction, truth, SIZE)
    intervals = bootstrap_intervals(metric, np.random.default_rng(0), resamples=200)
    for key, score in metric.compute().items():
        low, high = intervals[key]
        assert low <= score <= high
