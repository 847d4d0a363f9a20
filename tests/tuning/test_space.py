from __future__ import annotations

import inspect
from dataclasses import replace
from typing import Any

import pytest

from yolino.header import Header
from yolino.inference.postprocessing import build_linker, build_nms
from yolino.postprocess import LINKERS
from yolino.tuning.space import SPACES, build_space


def test_every_linker_can_be_tuned() -> None:
    assert set(SPACES) == set(LINKERS)


@pytest.mark.parametrize("linker", SPACES)
def test_every_number_of_a_linker_is_in_its_space(linker: str) -> None:
    arguments = inspect.signature(LINKERS[linker]).parameters
    numbers = {name for name, one in arguments.items() if type(one.default) in (int, float)}
    tuned = {name.partition(".")[2] for name in SPACES[linker] if name.startswith("linker_options.")}
    # How short a stretch of another class may be shows in no metric of lines without classes.
    assert numbers - tuned <= {"min_class_cells"}
    assert tuned <= numbers


@pytest.mark.parametrize("linker", SPACES)
def test_every_value_is_allowed(linker: str, header: Header) -> None:
    plain = replace(header, postprocess={"linker": linker})
    space = build_space(plain)
    for i in range(len(space.names)):
        for at in range(len(space.values[i])):
            point = (*space.start[:i], at, *space.start[i + 1 :])
            changed = replace(plain, postprocess=space.postprocess(point))
            build_nms(changed)
            build_linker(changed)
            assert space.setting(point)[space.names[i]] == space.values[i][at]


@pytest.mark.parametrize("linker", SPACES)
def test_values_are_in_order_and_hold_the_start(linker: str, header: Header) -> None:
    given = {"threshold": 0.333, "linker": linker, "linker_options": {"min_length_cells": 7.7}}
    space = build_space(replace(header, postprocess=given))
    for values in space.values:
        assert list(values) == sorted(set(values))
    setting = space.setting(space.start)
    assert (setting["threshold"], setting["linker_options.min_length_cells"]) == (0.333, 7.7)
    assert setting["nms.epsilon"] == 0.02
    assert space.postprocess(space.start) == given


def test_only_what_changes_is_written(header: Header) -> None:
    given: dict[str, Any] = {
        "threshold": 0.5,
        "flip": True,
        "linker": "chain",
        "linker_options": {"min_score": 0.2},
    }
    space = build_space(replace(header, postprocess=given), only=("threshold", "nms.epsilon"))
    assert space.names == ("threshold", "nms.epsilon")
    point = (space.values[0].index(0.3), space.values[1].index(0.03))
    assert space.postprocess(point) == {**given, "threshold": 0.3, "nms": {"epsilon": 0.03}}
    assert "nms" not in given


def test_another_linker_begins_with_its_own_defaults(header: Header) -> None:
    given = {"linker": "chain", "linker_options": {"max_gap_cells": 9.0}, "nms": {"epsilon": 0.03}}
    space = build_space(replace(header, postprocess=given), linker="graph")
    assert space.setting(space.start)["linker_options.max_gap_cells"] == 2.0
    assert space.postprocess(space.start) == {
        "linker": "graph",
        "linker_options": {},
        "nms": {"epsilon": 0.03},
    }


def test_a_rule_that_is_off_stays_off(header: Header) -> None:
    given = {"linker": "tree", "linker_options": {"max_downward_cells": None}}
    assert "linker_options.max_downward_cells" not in build_space(replace(header, postprocess=given)).names
    with pytest.raises(ValueError, match="nothing to tune"):
        build_space(replace(header, postprocess=given), only=("linker_options.max_downward_cells",))


def test_the_lowest_threshold_is_that_of_all_settings(header: Header) -> None:
    assert build_space(header).lowest_threshold == 0.1
    assert build_space(replace(header, postprocess={"threshold": 0.02})).lowest_threshold == 0.02
    assert build_space(header, only=("nms.epsilon",)).lowest_threshold == 0.5


def test_mistakes_are_named(header: Header) -> None:
    with pytest.raises(ValueError, match="The linker 'chian' is unknown; known are tree, chain, graph"):
        build_space(header, linker="chian")
    with pytest.raises(ValueError, match=r"'nms.epsilom' is unknown; did you mean 'nms.epsilon'"):
        build_space(header, only=("nms.epsilom",))
