"""The four terms equal their sums written out, and vanish where they must."""

import numpy as np
import pytest
import torch

from yolino.model.network import Prediction
from yolino.model.representations import CartesianPoints
from yolino.training.losses import Criterion
from yolino.training.targets import CellTargets, collate


def scene():
    """Two cells, two predictors; one segment, in cell 0."""
    ends = np.array([[[0.0, 0.5], [1.0, 0.5]]], np.float32)
    targets = collate([CellTargets(np.zeros(1, np.int64), ends, np.array([1]), np.zeros(2, bool))])
    params = torch.tensor([[[[0.0, 0.5, 1.0, 0.8], [0.0, 0.0, 0.0, 0.0]], [[0.5] * 4, [0.5] * 4]]])
    confidence = torch.tensor([[[0.7, 0.2], [0.1, 0.4]]])
    classes = torch.tensor([0.25, 0.75]).expand(1, 2, 2, 2)
    return Prediction(params, confidence, classes), targets


def test_each_term_by_hand():
    losses, matches = Criterion(CartesianPoints(), loc=2.0, resp=3.0, noresp=5.0, classes=7.0)(*scene())
    assert matches.predictors.tolist() == [0]
    assert losses.loc.item() == pytest.approx(0.3)  # Eq. 4
    assert losses.resp.item() == pytest.approx(0.3**2)  # Eq. 5
    assert losses.noresp.item() == pytest.approx((0.2**2 + 0.1**2 + 0.4**2) / 3)  # Eq. 6, mean of the free
    assert losses.classes.item() == pytest.approx(0.25**2 + 0.25**2)  # Eq. 7
    expected = 2 * losses.loc + 3 * losses.resp + 5 * losses.noresp + 7 * losses.classes
    assert losses.total.item() == pytest.approx(expected.item())


def test_ignored_cells_do_not_count_as_free():
    prediction, targets = scene()
    targets = targets._replace(ignored=torch.tensor([[False, True]]))
    losses, _ = Criterion(CartesianPoints())(prediction, targets)
    assert losses.noresp.item() == pytest.approx(0.2**2)


def test_a_perfect_prediction_costs_nothing():
    prediction, targets = scene()
    perfect = Prediction(
        torch.tensor([[[[0.0, 0.5, 1.0, 0.5], [0.0] * 4], [[0.0] * 4, [0.0] * 4]]]),
        torch.tensor([[[1.0, 0.0], [0.0, 0.0]]]),
        torch.tensor([0.0, 1.0]).expand(1, 2, 2, 2),
    )
    assert Criterion(CartesianPoints())(perfect, targets)[0].total.item() == 0
    assert Criterion(CartesianPoints())(prediction, targets)[0].total.item() > 0


def test_an_image_without_lines_only_punishes_confidence():
    nothing = collate(
        [
            CellTargets(
                np.zeros(0, np.int64),
                np.zeros((0, 2, 2), np.float32),
                np.zeros(0, np.int64),
                np.zeros(2, bool),
            )
        ]
    )
    losses, _ = Criterion(CartesianPoints())(scene()[0], nothing)
    assert losses.loc.item() == losses.resp.item() == losses.classes.item() == 0
    assert losses.noresp.item() == pytest.approx((0.7**2 + 0.2**2 + 0.1**2 + 0.4**2) / 4)


def test_gradients_reach_every_output():
    prediction, targets = scene()
    leaves = [t.clone().requires_grad_() for t in prediction]
    Criterion(CartesianPoints())(Prediction(*leaves), targets)[0].total.backward()
    assert all(leaf.grad is not None and leaf.grad.abs().sum() > 0 for leaf in leaves)
