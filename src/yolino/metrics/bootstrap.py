"""How sure a score is: percentile bootstrap over the images, or over groups of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from yolino.metrics.metric import Metric

_DRAWS_AT_ONCE = 100


def bootstrap_intervals(
    metric: Metric,
    rng: np.random.Generator,
    *,
    groups: Sequence[str] | None = None,
    resamples: int = 1000,
    confidence: float = 0.95,
) -> dict[str, tuple[float, float]]:
    """Gives a confidence interval `(low, high)` of each score of `metric`, by name.

    The groups are drawn with replacement, as many as there are, `resamples` times, each with all of its
    images; the interval holds the middle `confidence` of the scores. Images of one drive are alike: without
    groups the interval says how the score varies with the images drawn, not with the place or the weather.

    Args:
        metric: A metric with its images.
        rng: Source of the draws.
        groups: Name of the group of each image (its clip, its drive), in the order in which they were added;
            None: each image is a group of its own.
        resamples: Number of draws.
        confidence: Part of the scores inside the interval, in (0, 1).

    Raises:
        ValueError: The metric has no image, or an argument is out of its range.
    """
    if not 0 < confidence < 1:
        raise ValueError(f"confidence must be between 0 and 1, got {confidence}.")
    if resamples < 1:
        raise ValueError(f"resamples must be at least 1, got {resamples}.")
    metric.require_images()
    if groups is not None and len(groups) != len(metric):
        raise ValueError(f"There are {len(groups)} groups, but one for each of the {len(metric)} images.")
    members = np.arange(len(metric)) if groups is None else np.unique(groups, return_inverse=True)[1]
    count = int(members.max()) + 1
    draws: dict[str, list[np.ndarray]] = {}
    for first in range(0, resamples, _DRAWS_AT_ONCE):
        many = min(_DRAWS_AT_ONCE, resamples - first)
        drawn = rng.multinomial(count, np.full(count, 1 / count), size=many).astype(np.float64)
        for name, values in metric.weighted(drawn[:, members]).items():
            draws.setdefault(name, []).append(values)
    tails = [(1 - confidence) / 2, (1 + confidence) / 2]
    intervals = {}
    for name, parts in draws.items():
        low, high = np.quantile(np.concatenate(parts), tails)
        intervals[name] = (float(low), float(high))
    return intervals


__all__ = ["bootstrap_intervals"]
