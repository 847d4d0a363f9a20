"""Tuning: the network once for each image, then many settings, and what they are worth on other images."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from yolino.datasets import Dataset
from yolino.datasets.grouping import group_names
from yolino.inference import Predictor
from yolino.metrics import Metric
from yolino.tuning.candidates import Progress, gather
from yolino.tuning.folds import group_images, split_blocks
from yolino.tuning.objective import Objective, build_objective
from yolino.tuning.search import Search, replaced, simplify
from yolino.tuning.space import Number, Point, build_space
from yolino.tuning.trials import Trials

_DRAWS = 1000  # of the bootstrap
_TAILS = (0.025, 0.975)
Share = Callable[[float], None]


@dataclass(frozen=True)
class Options:
    """How to tune.

    Attributes:
        objective: A name in `OBJECTIVES`; None: `lanes` for TuSimple, else `f1`.
        linker: A name in `LINKERS`; None: the model's.
        only: Names of the parameters to change; all by default.
        trials: Settings that one search scores at most.
        folds: Blocks of images; each is scored with what the others were tuned to.
        groups: How images are grouped by their names, see `yolino.datasets.grouping.group_names`.
        seed: Of everything random.
    """

    objective: str | None = None
    linker: str | None = None
    only: Sequence[str] = ()
    trials: int = 400
    folds: int = 5
    groups: str = "auto"
    seed: int = 0

    def __post_init__(self) -> None:
        if self.trials < 1:
            raise ValueError(f"trials is {self.trials}, but must be at least 1.")
        if self.folds < 2:
            raise ValueError(f"folds is {self.folds}, but must be at least 2.")
        group_names((), self.groups)  # says now what is wrong with it


@dataclass(frozen=True)
class Estimate:
    """A number and its 95 % interval (bootstrap over groups of images)."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Change:
    """One parameter.

    Attributes:
        name: As in the header's post-processing: `nms.epsilon`.
        before: Its value.
        after: Its new value.
        alone: What the objective gains if only this one is changed.
        share: What the objective loses if only this one is not changed.
    """

    name: str
    before: Number
    after: Number
    alone: float
    share: float


@dataclass(frozen=True)
class Tuning:
    """What tuning found.

    Attributes:
        objective: What was made large.
        postprocess: The header's new post-processing.
        changes: All parameters, changed or not.
        scores: All scores of the metric `before`, `after` and `crossed`.
        before: The objective with the settings of the model.
        after: With the new ones, on the images that they were chosen on: too good.
        gain: The difference.
        crossed: The objective where each block of images has the settings that the others were tuned to.
        crossed_gain: The difference to `before`: what to expect on other images of this kind.
        images: Number of images.
        blocks: Number of blocks.
        settings: Number of settings that were scored.
    """

    objective: Objective
    postprocess: Mapping[str, Any]
    changes: Sequence[Change]
    scores: Mapping[str, Mapping[str, float]]
    before: Estimate
    after: Estimate
    gain: Estimate
    crossed: Estimate
    crossed_gain: Estimate
    images: int
    blocks: int
    settings: int


def tune(
    predictor: Predictor,
    dataset: Dataset,
    options: Options | None = None,
    *,
    progress: Progress = iter,
    share: Share = lambda done: None,
) -> Tuning:
    """Chooses threshold, NMS and linker parameters on labelled images, and tells what that is worth.

    The network runs once for each image. The settings are searched as `Search` says; then changes that give
    less than two standard errors are taken back (`simplify`). The same is done again without each block of
    images, which is scored with the settings found: that estimates what tuning gives on new images.

    Args:
        predictor: The model; its settings are the start.
        dataset: Labelled images.
        options: How to tune.
        progress: Wraps the indices of images while the network runs, to show a progress bar.
        share: Is told the share of the search that is done, 0..1.

    Raises:
        ValueError: The dataset has too few images for the folds, or no labelled line, an image is damaged, or
            an option is not allowed.
        FileNotFoundError: An image is missing.
    """
    options = Options() if options is None else options
    space = build_space(predictor.header, linker=options.linker, only=options.only)
    objective = build_objective(options.objective, predictor.header, dataset)
    if len(dataset) < options.folds:
        raise ValueError(
            f"{options.folds} folds need as many images or more, but the dataset has {len(dataset)}: label "
            "more images, or take fewer folds."
        )
    images = gather(predictor, dataset, space.lowest_threshold, progress=progress)
    if not any(len(image.truth) for image in images):
        raise ValueError(
            f"None of the {len(images)} images has a labelled line, so finding nothing would be best: take "
            "images with labels."
        )
    groups = group_images([image.name for image in images], options.groups)
    blocks = split_blocks(groups, options.folds)
    total = options.trials * (1 + options.folds)
    trials = Trials(images, predictor.header, space, objective, done=lambda n: share(min(n / total, 1.0)))
    best = choose(trials, groups, options, 0)
    crossed = _cross(trials, groups, blocks, options)
    share(1.0)
    return _sum_up(trials, best, crossed, groups, options)


def choose(trials: Trials, groups: Int[np.ndarray, " n"], options: Options, stream: int) -> Point:
    """Gives the setting that is chosen on images.

    Args:
        trials: Scores the settings.
        groups: Group of each image; -1: it does not count.
        options: How to search.
        stream: Number of the search, each with random numbers of its own.
    """
    start, weights = trials.space.start, (groups >= 0).astype(np.float64)
    # Also counts what an earlier search has scored: what is found does not depend on the other searches.
    seen: dict[Point, float] = {}

    def value(point: Point) -> float:
        if point not in seen:
            seen[point] = trials.value(point, weights)
        return seen[point]

    rng = np.random.default_rng([options.seed, stream])
    best = Search(trials.space, value, lambda: len(seen), options.trials, rng)(start)
    return simplify(best, start, value, lambda one, other: trials.error(one, other, groups))


def _cross(
    trials: Trials, groups: Int[np.ndarray, " n"], blocks: Int[np.ndarray, " n"], options: Options
) -> Metric:
    """Gives the metric where each block has the setting that was chosen on the others."""
    points = [trials.space.start] * len(groups)
    for block in range(options.folds):
        chosen = choose(trials, np.where(blocks == block, -1, groups), options, 1 + block)
        points = [chosen if own == block else point for own, point in zip(blocks, points, strict=True)]
    return trials.crossed(points)


def _sum_up(
    trials: Trials, best: Point, crossed: Metric, groups: Int[np.ndarray, " n"], options: Options
) -> Tuning:
    space, objective = trials.space, trials.objective
    start = space.start
    rng = np.random.default_rng(options.seed)
    count = int(groups.max()) + 1
    drawn = rng.multinomial(count, np.full(count, 1 / count), size=_DRAWS).astype(np.float64)
    weights = np.concatenate([np.ones((1, len(groups))), drawn[:, groups]])
    before, after, other = (
        objective.values(metric, weights) for metric in (trials.metric(start), trials.metric(best), crossed)
    )
    return Tuning(
        objective=objective,
        postprocess=space.postprocess(best),
        changes=_changes(trials, best),
        scores={
            "before": trials.metric(start).compute(),
            "after": trials.metric(best).compute(),
            "crossed": crossed.compute(),
        },
        before=_estimate(before),
        after=_estimate(after),
        gain=_estimate(after - before),
        crossed=_estimate(other),
        crossed_gain=_estimate(other - before),
        images=len(trials.images),
        blocks=options.folds,
        settings=len(trials),
    )


def _estimate(values: Float[np.ndarray, " b"]) -> Estimate:
    """Gives the first value with the interval of the others."""
    low, high = np.quantile(values[1:], _TAILS)
    return Estimate(float(values[0]), float(low), float(high))


def _changes(trials: Trials, best: Point) -> list[Change]:
    space, everything = trials.space, np.ones(len(trials.images))
    start = space.start

    def value(point: Point) -> float:
        return trials.value(point, everything)

    return [
        Change(
            name,
            space.values[i][start[i]],
            space.values[i][best[i]],
            value(replaced(start, i, best[i])) - value(start),
            value(best) - value(replaced(best, i, start[i])),
        )
        for i, name in enumerate(space.names)
    ]


__all__ = ["Change", "Estimate", "Options", "Tuning", "choose", "tune"]
