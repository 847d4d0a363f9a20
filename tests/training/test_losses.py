"""The terms equal their sums written out, and vanish where they must."""

import math

import numpy as np
import pytest
import torch

from yolino.model.network import Prediction
from yolino.model.representations import REPRESENTATIONS, CartesianPoints
from yolino.training.losses import SHORT_CELLS, Criterion, direction_loss
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


def random_scene(rng, name="po"):
    """Two images of six cells with up to four segments each, three predictors, two classes."""
    samples = []
    for _ in range(2):
        cells = np.repeat(np.arange(6), rng.integers(0, 5, 6))
        ends = rng.random((len(cells), 2, 2), dtype=np.float32)
        samples.append(CellTargets(cells, ends, rng.integers(0, 2, len(cells)), rng.random(6) < 0.2))
    raw = torch.from_numpy(rng.normal(size=(2, 6, 3, REPRESENTATIONS[name].num_params)).astype(np.float32))
    confidence, classes = (
        torch.from_numpy(rng.random((2, 6, 3, *more), dtype=np.float32)) for more in ((), (2,))
    )
    leaves = (REPRESENTATIONS[name]().activate(raw), confidence, classes)
    return Prediction(*(leaf.requires_grad_() for leaf in leaves)), collate(samples)


def as_printed(prediction, targets, matches, weights):
    """The paper's four terms, written out."""
    at = (matches.cells, matches.predictors)
    c = prediction.confidence.flatten(0, 1)
    free = ~targets.ignored.flatten()[:, None].expand_as(c)
    free = free.index_put(at, torch.tensor(False))
    m, f = torch.tensor(float(len(matches.cells))), free.sum().float()
    loc = CartesianPoints().distance(matches.encoded, prediction.params.flatten(0, 1)[at]).sum() / m
    resp, noresp = (c[at] - 1).square().sum() / m, (c.square() * free).sum() / f
    truth = torch.nn.functional.one_hot(targets.labels[matches.targets], 2)
    classes = (prediction.classes.flatten(0, 1)[at] - truth).square().sum() / m
    return torch.stack(
        [w * term for w, term in zip(weights, (loc, resp, noresp, classes), strict=True)]
    ).sum()


def test_without_options_the_loss_is_the_papers_bit_for_bit():
    weights = (2.0, 1.0, 3.0, 0.7)
    for seed in range(5):
        results = []
        for printed in (True, False):
            prediction, targets = random_scene(np.random.default_rng(seed))
            criterion = Criterion(
                CartesianPoints(), **dict(zip(("loc", "resp", "noresp", "classes"), weights, strict=True))
            )
            losses, matches = criterion(prediction, targets)
            total = as_printed(prediction, targets, matches, weights) if printed else losses.total
            total.backward()
            assert losses.direction.item() == 0
            results.append([total, *(leaf.grad for leaf in prediction)])
        assert all(torch.equal(a, b) for a, b in zip(*results, strict=True))


def segment(degrees, length=1.0):
    turn = math.radians(degrees)
    return torch.tensor([[[0.2, 0.3], [0.2 + length * math.cos(turn), 0.3 + length * math.sin(turn)]]])


@pytest.mark.parametrize(
    ("predicted", "true", "expected"),
    [
        (segment(0), segment(0), 0),
        (segment(0), segment(90), 1),
        (segment(170), segment(-10), 2),
        (segment(10, 0.3), segment(70, 0.8), 1 - 0.5),
        (segment(0, 0.0), segment(45), 1),  # no direction at all
        (segment(0, SHORT_CELLS / 4), segment(0), 1 - 1 / 4),
        (segment(0), segment(180, SHORT_CELLS / 2), 0),  # the truth is too short to have one
    ],
)
def test_the_direction_by_hand(predicted, true, expected):
    assert direction_loss(predicted, true).item() == pytest.approx(expected, abs=1e-6)


def test_the_direction_equals_differences_of_angles():
    rng = np.random.default_rng(1)
    a, b = (torch.from_numpy(rng.uniform(-0.2, 1.2, (60, 2, 2)).astype(np.float32)) for _ in range(2))
    expected = 0.0
    for (start, end), (u, v) in zip(a.tolist(), b.tolist(), strict=True):
        lengths = [math.dist(start, end), math.dist(u, v)]
        turn = math.atan2(end[1] - start[1], end[0] - start[0]) - math.atan2(v[1] - u[1], v[0] - u[0])
        if lengths[1] >= SHORT_CELLS:
            expected += 1 - math.cos(turn) * min(lengths[0] / SHORT_CELLS, 1)
    assert direction_loss(a, b).item() == pytest.approx(expected, rel=1e-5)
    flipped = direction_loss(a.flip(-1), b.flip(-1)), direction_loss(a.flip(-2), b.flip(-2))
    assert [f.item() for f in flipped] == pytest.approx([expected] * 2, rel=1e-5)


@pytest.mark.parametrize("name", list(REPRESENTATIONS))
def test_the_direction_of_nothing_has_a_finite_slope(name):
    representation = REPRESENTATIONS[name]()
    truth = torch.tensor([[[0.0, 0.5], [1.0, 0.5]], [[0.5, 0.5], [0.5, 0.5]], [[0.0, 0.0], [0.0, 0.0]]])
    for value in (0.0, 0.25, 0.5, 1.0):
        params = torch.full((3, representation.num_params), value, requires_grad=True)
        segments = representation.decode(params)
        segments.retain_grad()
        direction_loss(segments, truth).backward()
        assert torch.isfinite(params.grad).all()
        assert segments.grad.abs().max() <= 1 / SHORT_CELLS


def test_the_direction_adds_its_share():
    prediction, targets = scene()
    losses, _ = Criterion(CartesianPoints(), direction=3.0)(prediction, targets)
    assert losses.direction.item() == pytest.approx(1 - 1 / math.hypot(1, 0.3))
    plain, _ = Criterion(CartesianPoints())(prediction, targets)
    assert losses.total.item() == pytest.approx(plain.total.item() + 3 * losses.direction.item())


def test_an_undirected_line_may_be_predicted_backwards():
    prediction, targets = scene()
    back = prediction._replace(params=prediction.params.roll(2, dims=-1))
    directions = [
        Criterion(CartesianPoints(), directed=directed, direction=1.0)(back, targets)[0].direction.item()
        for directed in (True, False)
    ]
    assert directions == pytest.approx([1, 1 - 1 / math.hypot(1, 0.3)])  # directed, the point answers


def test_free_predictors_near_a_label_are_spared():
    prediction, targets = scene()
    params = prediction.params.clone()
    params[0, 0, 1] = torch.tensor([0.0, 0.8, 1.0, 0.9])  # free, .35 cells from the label of its cell
    prediction = prediction._replace(params=params)
    for spare, free in [
        (0.0, [0.2, 0.1, 0.4]),
        (0.34, [0.2, 0.1, 0.4]),
        (0.36, [0.1, 0.4]),
        (9.0, [0.1, 0.4]),
    ]:
        losses, _ = Criterion(CartesianPoints(), spare=spare)(prediction, targets)
        assert losses.noresp.item() == pytest.approx(np.square(free).mean())
    assert losses.resp.item() == pytest.approx(0.3**2)


def test_several_share_one_segment():
    prediction, targets = scene()
    losses, matches = Criterion(CartesianPoints())(prediction, targets, 2)
    assert matches.predictors.tolist() == [0, 1]
    assert losses.loc.item() == pytest.approx((0.3 + 0.5 + math.hypot(1, 0.5)) / 2)
    assert losses.resp.item() == pytest.approx((0.3**2 + 0.8**2) / 2)
    assert losses.noresp.item() == pytest.approx((0.1**2 + 0.4**2) / 2)
