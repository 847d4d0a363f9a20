from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from yolino.datasets import TuSimple
from yolino.evaluate import evaluate
from yolino.header import Header
from yolino.inference import Predictor, load
from yolino.metrics import METRICS
from yolino.tuning.candidates import Candidates, gather
from yolino.tuning.objective import OBJECTIVES, build_objective
from yolino.tuning.space import build_space
from yolino.tuning.trials import Trials

from .conftest import Made


@pytest.fixture
def plain(header: Header) -> Header:
    return replace(header, size=(320, 640), postprocess={"threshold": 0.3, "linker": "chain"})


def trials_of(header: Header, images: list[Candidates], objective: str = "f1") -> Trials:
    return Trials(images, header, build_space(header), build_objective(objective, header, Made()))


def test_a_setting_is_scored_as_yolino_evaluate_does(
    tiny_model: Path, write_frames: Callable[..., TuSimple]
) -> None:
    dataset = write_frames((399.5, 879.5), (399.5,), (100.0,))
    predictor = load(tiny_model)
    space = build_space(predictor.header)
    images = gather(predictor, dataset, space.lowest_threshold)
    lanes = Trials(images, predictor.header, space, build_objective(None, predictor.header, dataset))
    points = Trials(images, predictor.header, space, build_objective("f1", predictor.header, dataset))
    i = space.names.index("linker_options.min_length_cells")
    for at in (space.start[i], len(space.values[i]) - 1):
        point = (*space.start[:i], at, *space.start[i + 1 :])
        header = replace(predictor.header, postprocess=space.postprocess(point))
        wanted = evaluate(Predictor(predictor.engine, header), dataset).scores
        found = lanes.metric(point).compute()
        assert [found[name] for name in ("accuracy", "fp", "fn")] == pytest.approx(
            [wanted[name] for name in ("accuracy", "fp", "fn")]
        )
        assert points.metric(point).compute()["f1"] == pytest.approx(wanted["f1"])
        value = wanted["accuracy"] - wanted["fp"] / 2 - wanted["fn"] / 2
        assert lanes.value(point, np.ones(3)) == pytest.approx(value)


def test_a_threshold_counts_as_in_the_predictor(images: list[Candidates]) -> None:
    assert len(images[0].above(0.4)) == 40
    assert len(images[0].above(0.5)) == 20
    scores = np.array([np.float32(0.3)], np.float64)
    one = replace(images[0], segments=type(images[0].segments)(np.zeros((1, 2, 2)), scores))
    assert len(one.above(0.3)) == 1


def test_each_setting_is_scored_once(plain: Header, images: list[Candidates]) -> None:
    counts: list[int] = []
    space = build_space(plain)
    objective = trials_of(plain, images).objective
    trials = Trials(images, plain, space, objective, done=counts.append)
    other = (space.start[0] + 1, *space.start[1:])
    assert trials.metric(space.start) is trials.metric(space.start)
    trials.metric(other)
    assert counts == [1, 2]
    assert len(trials) == 2


def test_many_settings_of_the_nms_are_forgotten_and_found_again(
    plain: Header, images: list[Candidates]
) -> None:
    trials, again = trials_of(plain, images), trials_of(plain, images)
    points = [(at, *trials.space.start[1:]) for at in range(8)]
    first = [trials.value(point, np.ones(10)) for point in points]
    assert [again.value(point, np.ones(10)) for point in reversed(points)] == first[::-1]


def test_each_image_may_have_a_setting_of_its_own(plain: Header, images: list[Candidates]) -> None:
    """A threshold of .6 leaves the wrong lines out: half of the images have precision 1, the others 1/2."""
    trials = trials_of(plain, images)
    high = (trials.space.values[0].index(0.6), *trials.space.start[1:])
    crossed = trials.crossed([trials.space.start] * 5 + [high] * 5).compute()
    assert crossed["precision"] == pytest.approx(2 / 3, abs=0.01)
    assert trials.metric(high).compute()["precision"] == pytest.approx(1)


def test_the_standard_error_is_that_of_the_literal_jackknife(plain: Header, images: list[Candidates]) -> None:
    images = [replace(one, segments=one.segments[: 20 + 2 * i]) for i, one in enumerate(images)]
    trials = trials_of(plain, images)
    high = (trials.space.values[0].index(0.6), *trials.space.start[1:])
    groups = np.array([0, 0, 0, 1, 1, 2, 3, -1, 3, 3])
    apart = []
    for group in range(4):
        kept = [one for one, own in zip(images, groups, strict=True) if own not in (-1, group)]
        small, ones = trials_of(plain, kept), np.ones(len(kept))
        apart.append(small.value(trials.space.start, ones) - small.value(high, ones))
    wanted = np.sqrt(3 / 4 * np.sum((np.array(apart) - np.mean(apart)) ** 2))
    assert wanted > 0.01
    assert trials.error(trials.space.start, high, groups) == pytest.approx(wanted)
    assert trials.error(trials.space.start, trials.space.start, groups) == 0
    assert trials.error(trials.space.start, high, np.zeros(10, np.int64)) == 0


@pytest.mark.parametrize("name", OBJECTIVES)
def test_what_is_perfect_has_the_largest_objective(
    name: str, plain: Header, images: list[Candidates]
) -> None:
    trials = trials_of(plain, images, name)
    high = (trials.space.values[0].index(0.6), *trials.space.start[1:])
    assert trials.value(high, np.ones(10)) == pytest.approx(1, abs=0.05)
    if name not in ("accuracy", "chamfer", "frechet"):  # wrong lines of low score do not lower these
        assert trials.value(trials.space.start, np.ones(10)) < 0.9


def test_every_metric_but_that_of_classes_can_be_chosen() -> None:
    assert set(METRICS) - {"tusimple", "points", "classes"} <= set(OBJECTIVES)


def test_the_objective_follows_the_data(header: Header, write_frames: Callable[..., TuSimple]) -> None:
    assert build_objective(None, header, write_frames((400.0,))).name == "lanes"
    assert build_objective(None, header, Made()).name == "f1"
    with pytest.raises(ValueError, match="'acuracy' is unknown; did you mean 'accuracy'"):
        build_objective("acuracy", header, Made())
