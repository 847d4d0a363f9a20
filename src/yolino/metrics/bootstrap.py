"""How sure a score is: percentile bootstrap over the images."""

from __future__ import annotations

import numpy as np

from yolino.metrics.metric import Metric


def bootstrap_intervals(
    metric: Metric, rng: np.random.Generator, *, resamples: int = 1000, confidence: float = 0.95
) -> dict[str, tuple[float, float]]:
    """Gives a confidence interval `(low, high)` of each score of `metric`, by name.

    The images are drawn with replacement, as many as there are, `resamples` times; the interval holds the
    middle `confidence` of the scores. Images of one drive are alike, so the interval says how the score
    varies with the images drawn, not with the place or the weather.

    Args:
        metric: A metric with its images.
        rng: Source of the draws.
        resamples: Number of draws.
        confidence: Part of the scores inside the interval, in (0, 1).

    Raises:
        ValueError: The metric has no image, or an argument is out of its range.
    """
    if not 0 < confidence < 1:
        raise ValueError(f"confidence must be between 0 and 1, got {confidence}.")
    if resamples < 1:
        raise ValueError(f"resamples must be at least 1, got {resamples}.")
    rows = metric.rows
    n = len(rows)
    sums = np.stack([rng.multinomial(n, np.full(n, 1 / n)) @ rows for _ in range(resamples)])
    tails = [(1 - confidence) / 2, (1 + confidence) / 2]
    intervals = {}
    for name, values in metric.scores(sums).items():
        low, high = np.quantile(values, tails)
        intervals[name] = (float(low), float(high))
    return intervals
