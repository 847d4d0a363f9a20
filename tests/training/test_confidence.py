"""Each way to compare a confidence equals its formula, by hand and in plain Python."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from yolino.model.network import Prediction
from yolino.model.representations import CartesianPoints
from yolino.training.confidence import CONFIDENCES, FIT_CELLS, build_confidence, fit, focal
from yolino.training.losses import Criterion
from yolino.training.targets import CellTargets, collate

UNIT = st.floats(0, 1, width=32)


def scene():
    """One horizontal segment in the first of two cells; the gaps there are .2 and .4 cells."""
    ends = np.array([[[0.0, 0.5], [1.0, 0.5]]], np.float32)
    targets = collate([CellTargets(np.zeros(1, np.int64), ends, np.zeros(1, np.int64), np.zeros(2, bool))])
    params = torch.tensor([[[[0.0, 0.6, 1.0, 0.8], [0.0, 0.1, 1.0, 0.1]], [[0.5] * 4, [0.5] * 4]]])
    confidence = torch.tensor([[[0.7, 0.2], [0.1, 0.4]]])
    return Prediction(params, confidence, torch.zeros(1, 2, 2, 0)), targets


def entropy(c, target, weights):
    """Focal cross entropy of one predictor, with plain numbers."""
    above = weights[0] * target * math.log(max(c, 1e-12))
    below = weights[1] * (1 - target) * math.log(max(1 - c, 1e-7))
    return -(abs(target - c) ** 2) * (above + below)


def literal(name, confidence, responsible, gaps, own):
    """Both terms of a flat list of predictors, with plain numbers; `own` are the gaps of the responsible."""
    pairs = [], []
    own = iter(own)
    for c, answers, gap in zip(confidence, responsible, gaps, strict=True):
        target = 1.0 if answers else 0.0
        if name in ("quality", "quality_focal", "nearness") and answers:
            target = math.exp(-next(own) / 0.2)
        if name == "nearness" and not answers:
            target = math.exp(-gap / 0.2)
        penalty = (c - target) ** 2
        if name == "focal":
            penalty = entropy(c, target, (0.25, 0.75))
        if name == "quality_focal":
            penalty = entropy(c, target, (1, 1))
        pairs[answers].append(penalty)
    free, resp = pairs
    return sum(resp) / len(resp), sum(free) / len(resp if "focal" in name else free)


@pytest.mark.parametrize(
    ("name", "resp", "noresp"),
    [
        ("squared", 0.3**2, (0.2**2 + 0.1**2 + 0.4**2) / 3),
        # .25 * .3^2 * .35667 and .75 * (.2^2 * .22314 + .1^2 * .10536 + .4^2 * .51083), of one responsible
        ("focal", 0.0080252, 0.0687836),
        ("quality", (0.7 - math.exp(-1)) ** 2, (0.2**2 + 0.1**2 + 0.4**2) / 3),
        # (.7 - .36788)^2 * (.36788 * .35667 + .63212 * 1.20397), and as above without .75
        ("quality_focal", 0.0984209, 0.0917114),
        ("nearness", (0.7 - math.exp(-1)) ** 2, ((0.2 - math.exp(-2)) ** 2 + 0.1**2 + 0.4**2) / 3),
    ],
)
def test_by_hand(name, resp, noresp):
    losses, _ = Criterion(CartesianPoints(), confidence=name)(*scene())
    assert losses.resp.item() == pytest.approx(resp, rel=1e-4)
    assert losses.noresp.item() == pytest.approx(noresp, rel=1e-4)


@pytest.mark.parametrize("directed", [True, False])
@pytest.mark.parametrize("name", list(CONFIDENCES))
def test_equals_plain_numbers(name, directed):
    rng = np.random.default_rng(2)
    cells = np.repeat(np.arange(6), [0, 1, 2, 3, 4, 1])
    ends = rng.random((len(cells), 2, 2), dtype=np.float32)
    targets = collate([CellTargets(cells, ends, np.zeros(len(cells), np.int64), np.zeros(6, bool))])
    params, confidence = (torch.from_numpy(rng.random((1, 6, 3, *g), dtype=np.float32)) for g in ((4,), ()))
    criterion = Criterion(CartesianPoints(), directed=directed, confidence=name)
    losses, matches = criterion(Prediction(params, confidence, torch.zeros(1, 6, 3, 0)), targets)
    own, answers = {}, np.zeros((6, 3), bool)
    for truth, cell, k in zip(
        matches.encoded, matches.cells.tolist(), matches.predictors.tolist(), strict=True
    ):
        (x, y), (u, v) = (params[0, cell, k] - truth).view(2, 2).tolist()
        own[cell, k], answers[cell, k] = (math.hypot(x, y) + math.hypot(u, v)) / 2, True
    nearest = np.full((6, 3), np.inf)
    for (a, b), cell in zip(ends.tolist(), cells.tolist(), strict=True):
        for k in range(3):
            (x, y), (u, v) = params[0, cell, k].view(2, 2).tolist()
            ways = [(a, b), (b, a)][: 1 if directed else 2]
            gaps = [(math.dist((x, y), way[0]) + math.dist((u, v), way[1])) / 2 for way in ways]
            nearest[cell, k] = min(nearest[cell, k], *gaps)
    expected = literal(
        name,
        confidence.flatten().tolist(),
        answers.ravel().tolist(),
        nearest.ravel().tolist(),
        [own[place] for place in sorted(own)],
    )
    assert [losses.resp.item(), losses.noresp.item()] == pytest.approx(expected, rel=1e-4)


@given(target=UNIT, confidence=UNIT)
@pytest.mark.parametrize("name", list(CONFIDENCES))
def test_a_penalty_is_zero_at_its_target_and_nowhere_less(name, target, confidence):
    c, t = torch.tensor(confidence), torch.tensor(target)
    penalty = CONFIDENCES[name].penalty
    assert penalty(c, t).item() >= 0
    assert penalty(t, t).item() == 0
    half = penalty((c + t) / 2, t).item()
    assert half <= penalty(c, t).item() + 1e-7, "nearer costs more"


@pytest.mark.parametrize("name", list(CONFIDENCES))
def test_slopes_are_finite_and_point_to_the_target(name):
    penalty = CONFIDENCES[name].penalty
    for target in (0.0, 0.4, 1.0):
        raw = torch.tensor([-200.0, -20, -3, 0, 3, 20, 200], requires_grad=True)
        confidence = raw.sigmoid()
        penalty(confidence, target).sum().backward()
        assert torch.isfinite(raw.grad).all()
        toward = (confidence - target).sign() * raw.grad
        assert (toward >= 0).all()
        assert (toward[2:5][confidence[2:5] != target] > 0).all()
        edge = torch.tensor([0.0, 1e-30, 1.0], requires_grad=True)
        penalty(edge, target).sum().backward()
        assert torch.isfinite(edge.grad).all()


def test_without_power_focal_is_the_cross_entropy():
    c, t = torch.rand(50, generator=torch.Generator().manual_seed(0)), torch.arange(50) % 2
    expected = torch.nn.functional.binary_cross_entropy(c, t.float(), reduction="none")
    torch.testing.assert_close(focal(c, t.float(), weights=(1.0, 1.0), gamma=0.0), expected)


@pytest.mark.parametrize("name", list(CONFIDENCES))
def test_confidence_does_not_move_segments(name):
    prediction, targets = scene()
    leaves = [leaf.requires_grad_() for leaf in prediction]
    Criterion(CartesianPoints(), loc=0.0, confidence=name)(Prediction(*leaves), targets)[0].total.backward()
    assert leaves[0].grad.abs().max() == 0
    assert leaves[1].grad.abs().min() > 0


def test_fit_falls_with_the_gap():
    gaps = torch.tensor([0.0, FIT_CELLS, 2 * FIT_CELLS, torch.inf])
    assert fit(gaps).tolist() == pytest.approx([1, math.exp(-1), math.exp(-2), 0])


@pytest.mark.parametrize("name", list(CONFIDENCES))
def test_a_perfect_prediction_and_an_empty_image_cost_what_they_should(name):
    prediction, targets = scene()
    perfect = Prediction(
        torch.tensor([[[[0.0, 0.5, 1.0, 0.5], [1.0, 0.5, 0.0, 0.5]], [[0.5] * 4] * 2]]),
        torch.tensor([[[1.0, 0.0], [0.0, 0.0]]]),
        prediction.classes,
    )
    losses, _ = Criterion(CartesianPoints(), confidence=name)(perfect, targets)
    assert losses.total.item() == pytest.approx(0, abs=1e-4)
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
    losses, _ = Criterion(CartesianPoints(), confidence=name, direction=1.0, spare=0.1)(prediction, nothing)
    assert losses.total.item() == losses.noresp.item() > 0


def test_an_unknown_name_is_told_with_the_nearest():
    message = r"^loss\.confidence 'fokal' is unknown; did you mean 'focal'\? Known are squared, focal, "
    with pytest.raises(ValueError, match=message):
        build_confidence("fokal")
    with pytest.raises(ValueError, match=message):
        Criterion(CartesianPoints(), confidence="fokal")
