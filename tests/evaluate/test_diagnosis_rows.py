from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yolino.evaluate.diagnosis_rows import CAUSES, lost_in_image, lost_rows
from yolino.metrics.tusimple import score_image

ROWS = list(range(100, 220, 10))
NONE = -2


def losses(line: list[float], label: list[float]) -> dict[str, float]:
    """Gives the number of rows by cause."""
    ((values,), _) = lost_rows([line], [label], ROWS)
    return {name: round(value * len(ROWS)) for name, value in zip(CAUSES, values, strict=True) if value}


def column(first: int, last: int, x: float = 300.0) -> list[float]:
    """Gives a lane from row `first` to row `last` (indices, from the top, both included)."""
    return [x if first <= i <= last else NONE for i in range(len(ROWS))]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (column(2, 8), {}),
        (column(4, 8), {"ends_early": 2}),
        (column(1, 8), {"ends_late": 1}),
        (column(2, 5), {"begins_late": 3}),
        (column(2, 11), {"begins_early": 3}),
        (column(3, 9), {"ends_early": 1, "begins_early": 1}),
        ([*column(2, 3)[:4], *column(6, 8)[4:]], {"gap": 2}),
        ([*column(2, 5)[:6], *column(6, 8, x=340.0)[6:]], {"beside_middle": 1, "beside_near": 2}),
        ([*column(2, 3, x=340.0)[:4], *column(4, 8)[4:]], {"beside_far": 2}),
    ],
)
def test_each_wrong_row_has_its_cause(line: list[float], expected: dict[str, int]) -> None:
    assert losses(line, column(2, 8)) == expected


def test_a_label_without_any_line_has_no_line() -> None:
    (values, partners) = lost_rows([], [column(2, 8)], ROWS)
    assert partners.tolist() == [-1]
    assert values[0, 0] == 1  # by the benchmark's rules: even none agrees with nothing
    values, partners = lost_rows([column(2, 8, x=900.0)], [column(2, 8)], ROWS)
    assert partners.tolist() == [-1]
    assert values[0] == pytest.approx([7 / 12] + [0] * 9)


def test_each_label_is_compared_to_its_own_line() -> None:
    _, partners = lost_rows(
        [column(0, 9, x=700.0), column(0, 9)], [column(0, 8), column(0, 8, x=705.0)], ROWS
    )
    assert partners.tolist() == [1, 0]


def test_no_labels_lose_nothing() -> None:
    values, partners = lost_rows([column(0, 5)], [], ROWS)
    assert values.shape == (0, len(CAUSES))
    assert len(partners) == 0


lane = st.lists(st.sampled_from([NONE, 100.0, 118.0, 125.0, 400.0, 415.0, 430.0]), min_size=12, max_size=12)
lanes = st.lists(lane, min_size=1, max_size=4)


@given(lanes, lanes)
def test_the_losses_add_up_to_what_the_benchmark_takes_off(
    found: list[list[float]], labelled: list[list[float]]
) -> None:
    values, _ = lost_rows(found, labelled, ROWS)
    assert (values >= 0).all()
    if len(found) <= len(labelled) + 2:
        accuracy = score_image(found, labelled, ROWS).accuracy
        assert 1 - values.sum(axis=1).mean() == pytest.approx(accuracy)


@given(st.lists(lane, max_size=8), st.lists(lane, max_size=5))
def test_the_causes_of_any_image_add_up(found: list[list[float]], labelled: list[list[float]]) -> None:
    values = lost_in_image(found, labelled, ROWS)
    assert (values >= 0).all()
    assert 1 - values.sum() == pytest.approx(score_image(found, labelled, ROWS).accuracy)


def test_the_reach_grows_with_the_slope_of_the_label() -> None:
    """A label at 45 degrees: 20 px / cos(45 degrees) = 28.3 px."""
    label = [300.0 + 10 * i for i in range(12)]
    assert lost_rows([[x + 27 for x in label]], [label], ROWS)[0].sum() == 0
    assert np.count_nonzero(lost_rows([[x + 29 for x in label]], [label], ROWS)[0]) == 1
