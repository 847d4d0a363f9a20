"""Classes of labels are found among those of a model by name, or by the kind of lane that they are."""

from __future__ import annotations

import pytest

from yolino.datasets.tusimple import CLASSES
from yolino.evaluate import label_map
from yolino.evaluate.kinds import KINDS


@pytest.mark.parametrize(
    ("labelled", "predicted", "expected"),
    [
        (("a", "b"), ("b", "c", "a"), [2, 0]),
        (("double dashed", "dashed"), ("dashed", "solid"), [0, 0]),
        (("double dashed", "dashed"), ("dashed", "double dashed"), [1, 0]),  # its own name goes first
        (("a", "b"), ("a",), None),
        (("continuous yellow",), ("dashed",), None),
        (("a",), (), None),
    ],
)
def test_each_label_gets_the_class_that_is_meant(labelled, predicted, expected):
    found = label_map(labelled, predicted)
    assert (None if found is None else found.tolist()) == expected


def test_all_lane_types_of_tusimple_are_known_to_the_model_of_lane_types():
    assert set(KINDS) < set(CLASSES)
    found = label_map(CLASSES, ("continuous", "dashed", "Botts' dots", "unknown"))
    assert found is not None
    assert found.tolist() == [0, 0, 1, 1, 2, 0, 3]
