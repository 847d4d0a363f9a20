"""Every representation inverts itself, measures what the paper says, and trains."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from yolino.model.representations import REPRESENTATIONS, BorderPositions, CartesianPoints, EulerAngles

unit = st.floats(0, 1, width=32)


def border_point(way: float) -> tuple[float, float]:
    """Walks clockwise from the top-left corner: the slow twin of `BorderPositions.decode`."""
    side, rest = divmod(4 * (way % 1.0), 1.0)
    return [(rest, 0.0), (1.0, rest), (1 - rest, 1.0), (0.0, 1 - rest)][int(side) % 4]


@pytest.fixture(params=list(REPRESENTATIONS))
def representation(request):
    return REPRESENTATIONS[request.param]()


@given(a=unit, b=unit, c=unit, d=unit)
def test_decode_inverts_encode(a, b, c, d):
    for representation in (cls() for cls in REPRESENTATIONS.values()):
        ends = [border_point(a), border_point(b)] if representation.to_border else [(a, b), (c, d)]
        endpoints = torch.tensor([ends], dtype=torch.float64)
        again = representation.decode(representation.encode(endpoints))
        torch.testing.assert_close(again, endpoints, atol=1e-6, rtol=0)


def test_all_four_sides_and_corners_survive(representation):
    points = [(0.3, 0), (1, 0.3), (0.3, 1), (0, 0.3), (0, 0), (1, 0), (1, 1), (0, 1)]
    pairs = torch.tensor([(s, e) for s in points for e in points if s != e], dtype=torch.float32)
    torch.testing.assert_close(representation.decode(representation.encode(pairs)), pairs, atol=1e-5, rtol=0)


def test_the_distance_is_a_symmetric_one_and_zero_on_itself(representation):
    torch.manual_seed(0)
    a, b = (representation.activate(torch.randn(50, representation.num_params)) for _ in range(2))
    torch.testing.assert_close(representation.distance(a, b), representation.distance(b, a))
    assert representation.distance(a, a).abs().max() == 0
    assert (representation.distance(a, b) > 0).all()


def test_distances_broadcast(representation):
    g = representation.num_params
    a, b = torch.rand(7, 3, 1, g), torch.rand(7, 1, 8, g)
    assert representation.distance(a, b).shape == (7, 3, 8)


def test_gradients_are_finite_even_on_a_perfect_prediction(representation):
    raw = torch.randn(20, representation.num_params, requires_grad=True)
    params = representation.activate(raw)
    representation.distance(params.detach(), params).sum().backward()
    assert torch.isfinite(raw.grad).all()
    raw.grad = None
    representation.decode(representation.activate(raw)).square().sum().backward()
    assert torch.isfinite(raw.grad).all()


def test_gradient_descent_reaches_any_target(representation):
    torch.manual_seed(1)
    points = torch.tensor(
        [[border_point(a), border_point(b)] for a, b in np.random.default_rng(0).random((30, 2))]
    )
    target = representation.encode(points.float())
    raw = torch.randn(30, representation.num_params, requires_grad=True)
    optimizer = torch.optim.Adam([raw], lr=0.05)
    for step in range(800):
        for group in optimizer.param_groups:
            group["lr"] = 0.05 * (1 - step / 800)
        optimizer.zero_grad()
        representation.distance(target, representation.activate(raw)).sum().backward()
        optimizer.step()
    decoded = representation.decode(representation.activate(raw))
    assert (decoded - points).abs().max() < 0.03


def test_equation_1_by_hand():
    a, b = torch.tensor([0.0, 0.0, 1.0, 1.0]), torch.tensor([0.3, 0.4, 1.0, 0.0])
    assert CartesianPoints().distance(a, b).item() == pytest.approx(0.5 + 1.0)


def test_equation_2_wraps_around():
    distance = BorderPositions().distance
    assert distance(torch.tensor([0.95, 0.5]), torch.tensor([0.05, 0.25])).item() == pytest.approx(0.1 + 0.25)


def test_equation_3_is_the_mean_squared_error():
    a = torch.tensor([1.0, 0.0, 0.0, 1.0])
    assert EulerAngles().distance(a, -a).item() == pytest.approx((4 + 0 + 0 + 4) / 4)


@pytest.mark.parametrize(
    ("way", "point"),
    [
        (0.0, (0, 0)),
        (0.125, (0.5, 0)),
        (0.25, (1, 0)),
        (0.375, (1, 0.5)),
        (0.625, (0.5, 1)),
        (0.875, (0, 0.5)),
    ],
)
def test_border_positions_run_clockwise_from_the_top_left_corner(way, point):
    decoded = BorderPositions().decode(torch.tensor([way, way]))
    assert decoded[0].tolist() == pytest.approx(point)


def test_euler_angles_start_at_the_downward_axis_and_do_not_mirror():
    encode = EulerAngles().encode
    down_then_right = torch.tensor([[0.5, 1.0], [1.0, 0.5]])
    assert encode(down_then_right).tolist() == pytest.approx([1, 0, 0, 1], abs=1e-6)  # 0 and pi / 2
    corner = encode(torch.tensor([[1.0, 1.0], [0.0, 1.0]]))
    assert math.degrees(math.atan2(corner[1], corner[0])) == pytest.approx(45)
    assert math.degrees(math.atan2(corner[3], corner[2])) == pytest.approx(-45)


def test_the_activation_of_1d_is_continuous_over_the_corner():
    near = BorderPositions().activate(torch.tensor([-1e-3, 1e-3]))
    gap = BorderPositions().distance(near[:1].repeat(2), near[1:].repeat(2)) / 2
    assert gap.item() == pytest.approx(2e-3, abs=1e-6)
    assert (near >= 0).all()
    assert (near < 1).all()


def test_po_reaches_the_borders():
    reached = CartesianPoints().activate(torch.tensor([-6.0, -2.0, 2.0, 6.0]))
    assert reached[0] < 0
    assert reached[-1] > 1
