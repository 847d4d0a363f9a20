from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from yolino.datasets import TuSimple
from yolino.header import Header
from yolino.inference import load
from yolino.tuning import Options, facts, parameter_rows, score_rows, summary, tune, tuned_header
from yolino.tuning.candidates import Candidates
from yolino.tuning.run import choose
from yolino.tuning.space import Point, build_space
from yolino.tuning.trials import Trials
from yolino.types import Polylines

from .conftest import image_of
from .test_trials import trials_of

SEEN = (399.5, 879.5)
FEW = ("threshold", "linker_options.min_score")
WRONG = (100.0, 399.5, 879.5, 1100.0)


@pytest.fixture
def plain(header: Header) -> Header:
    return replace(header, size=(320, 640), postprocess={"threshold": 0.3, "linker": "chain"})


def only(trials: Trials, *names: str) -> Trials:
    space = build_space(trials.header, only=names)
    return Trials(trials.images, trials.header, space, trials.objective)


def test_the_threshold_between_right_and_wrong_is_found(plain: Header, images: list[Candidates]) -> None:
    trials = only(trials_of(plain, images), "threshold")
    best = trials.space.setting(choose(trials, np.arange(10), Options(), 0))
    assert 0.5 <= best["threshold"] <= 0.7


def test_either_of_two_scores_will_do_but_not_both_are_changed(
    plain: Header, images: list[Candidates]
) -> None:
    trials = only(trials_of(plain, images), *FEW)
    best = choose(trials, np.arange(10), Options(trials=60), 0)
    assert sum(a != b for a, b in zip(best, trials.space.start, strict=True)) == 1
    assert trials.value(best, np.ones(10)) == pytest.approx(1, abs=0.01)


def test_images_that_do_not_count_change_nothing(plain: Header, images: list[Candidates]) -> None:
    others = [image_of(f"other/{i}.jpg", (100.0, 0.2), (400.0, 0.9), truth=(100.0,)) for i in range(5)]
    groups = np.array([*range(10), *[-1] * 5])
    trials = only(trials_of(plain, images + others), "threshold")
    alone = only(trials_of(plain, images), "threshold")
    assert choose(trials, groups, Options(), 0) == choose(alone, np.arange(10), Options(), 0)


def test_the_order_of_the_searches_makes_no_odds(plain: Header, images: list[Candidates]) -> None:
    used, fresh = (only(trials_of(plain, images[:4]), *FEW) for _ in range(2))
    options = Options(trials=30)
    choose(used, np.arange(4), options, 1)
    assert choose(used, np.arange(4), options, 2) == choose(fresh, np.arange(4), options, 2)


def test_a_model_that_is_right_keeps_its_settings(
    tiny_model: Path, write_frames: Callable[..., TuSimple]
) -> None:
    shares: list[float] = []
    options = Options(only=FEW, folds=2)
    found = tune(load(tiny_model), write_frames(SEEN, SEEN, SEEN), options, share=shares.append)
    assert found.postprocess == load(tiny_model).header.postprocess
    assert parameter_rows(found) == []
    assert found.gain.value == found.crossed_gain.value == 0
    assert (found.images, found.blocks) == (3, 2)
    assert "keep what there is" in summary(found)[0]
    assert shares == sorted(shares)
    assert shares[-1] == 1


def test_lines_that_are_all_wrong_are_worth_dropping(
    tiny_model: Path, write_frames: Callable[..., TuSimple]
) -> None:
    """The model sees two lines of 4 cells, score .9; none is labelled in its place."""
    predictor = load(tiny_model)
    dataset = write_frames(*[(10.0 * i, 20.0 * i + 100) for i in range(4)])
    wanted = Options(only=("linker_options.min_length_cells",), folds=2)
    found = tune(predictor, dataset, wanted)
    assert found.before.value < found.after.value
    assert found.postprocess["linker_options"]["min_length_cells"] > 4
    (row,) = parameter_rows(found)
    assert row[0] == "linker_options.min_length_cells"
    assert row[3] == row[4] == f"{found.gain.value:+.4f}"
    assert found.crossed_gain.value == pytest.approx(found.gain.value)
    assert found.scores["after"]["fp"] == 0
    assert found.scores["before"]["fp"] == 1
    assert [row[0] for row in score_rows(found)] == ["objective", "accuracy", "fp", "fn", "fn strict"]
    assert "images of the same kind" in summary(found)[-1]


def test_the_new_header_says_what_it_was_tuned_on(
    tiny_model: Path, write_frames: Callable[..., TuSimple]
) -> None:
    predictor = load(tiny_model)
    found = tune(predictor, write_frames(SEEN, WRONG), Options(trials=5, folds=2, only=("threshold",)))
    header = tuned_header(predictor.header, found, "two frames")
    assert header.metrics["tuning"]["data"] == "two frames"
    assert header.metrics["before_tuning"] == predictor.header.metrics
    assert Header.from_json(header.to_json()) == header
    assert json.loads(json.dumps(facts(found, "x")))["images"] == 2


def test_the_same_seed_gives_the_same(tiny_model: Path, write_frames: Callable[..., TuSimple]) -> None:
    predictor, dataset = load(tiny_model), write_frames(SEEN, WRONG, SEEN[:1])
    first, again = (tune(predictor, dataset, Options(only=FEW, folds=3, seed=5)) for _ in range(2))
    assert (first.postprocess, first.crossed, first.changes) == (
        again.postprocess,
        again.crossed,
        again.changes,
    )


def test_mistakes_are_told(tiny_model: Path, write_frames: Callable[..., TuSimple]) -> None:
    with pytest.raises(ValueError, match="5 folds need as many images or more, but the dataset has 2: "):
        tune(load(tiny_model), write_frames(SEEN, SEEN))
    with pytest.raises(ValueError, match="trials is 0"):
        Options(trials=0)
    with pytest.raises(ValueError, match="folds is 1"):
        Options(folds=1)


def test_images_without_any_label_are_told(tiny_model: Path, write_frames: Callable[..., TuSimple]) -> None:
    with pytest.raises(ValueError, match="None of the 2 images has a labelled line"):
        tune(load(tiny_model), write_frames((), ()), Options(folds=2))


def test_the_labels_of_a_block_do_not_change_what_is_chosen_for_it(
    plain: Header, images: list[Candidates]
) -> None:
    """Other labels of the second half change the settings of the first half, but not their own."""
    groups, blocks = np.arange(10), np.repeat([0, 1], 5)
    no_lines = Polylines.from_list([])
    others = [replace(one, truth=no_lines) if i >= 5 else one for i, one in enumerate(images)]
    chosen: list[list[Point]] = []
    for these in (images, others):
        trials = only(trials_of(plain, these), "threshold")
        each = [np.where(blocks == block, -1, groups) for block in (0, 1)]
        chosen.append([choose(trials, one, Options(trials=30, folds=2), 1 + i) for i, one in enumerate(each)])
    assert chosen[0][1] == chosen[1][1]
    assert chosen[0][0] != chosen[1][0]
