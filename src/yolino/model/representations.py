"""Line representations: how the parameters g describe a directed segment in its cell (paper, Sec. 3).

Every representation works on tensors in cell units (the cell is the unit square) and is one class with

* `num_params`: how many numbers g has,
* `to_border`: whether its segments start and end on the border of the cell,
* `activate`: raw network output -> g,
* `encode` / `decode`: end points `(start, end)` -> g and back,
* `distance`: the paper's d(g, g^).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor


class Representation(ABC):
    """What matching, losses and decoding need to know of a line representation."""

    num_params: ClassVar[int]
    to_border: ClassVar[bool]

    @abstractmethod
    def activate(self, raw: Float[Tensor, "*shape g"]) -> Float[Tensor, "*shape g"]:
        """Squashes the raw network output into the range of g."""

    @abstractmethod
    def encode(self, endpoints: Float[Tensor, "*shape 2 2"]) -> Float[Tensor, "*shape g"]:
        """Gives g of the segments with these end points, in cell units."""

    @abstractmethod
    def decode(self, params: Float[Tensor, "*shape g"]) -> Float[Tensor, "*shape 2 2"]:
        """Gives the end points, in cell units, of the segments g; inverts `encode`."""

    @abstractmethod
    def distance(
        self, a: Float[Tensor, "*#shape g"], b: Float[Tensor, "*#shape g"]
    ) -> Float[Tensor, "*#shape"]:
        """Gives the paper's distance d(g, g^) between segments; the leading axes broadcast."""


def _pairs(params: Float[Tensor, "*shape 4"]) -> Float[Tensor, "*shape 2 2"]:
    """Splits four numbers into two pairs."""
    pairs: Tensor = params.unflatten(-1, (2, 2))  # type: ignore[no-untyped-call]
    return pairs


def stretched_sigmoid(raw: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """Squashes into (-0.2, 1.2), so that targets at exactly 0 and 1 lie where the slope is not yet flat."""
    return 1.4 * torch.sigmoid(raw) - 0.2


class CartesianPoints(Representation):
    """Po: unbound Cartesian points `(x_s, y_s, x_e, y_e)` anywhere in the cell."""

    num_params = 4
    to_border = False

    def activate(self, raw: Float[Tensor, "*shape 4"]) -> Float[Tensor, "*shape 4"]:
        """Squashes with a sigmoid stretched beyond the borders of the cell."""
        return stretched_sigmoid(raw)

    def encode(self, endpoints: Float[Tensor, "*shape 2 2"]) -> Float[Tensor, "*shape 4"]:
        """Flattens start and end point."""
        return endpoints.flatten(-2)

    def decode(self, params: Float[Tensor, "*shape 4"]) -> Float[Tensor, "*shape 2 2"]:
        """Splits g into start and end point."""
        return _pairs(params)

    def distance(
        self, a: Float[Tensor, "*#shape 4"], b: Float[Tensor, "*#shape 4"]
    ) -> Float[Tensor, "*#shape"]:
        """Sums the Euclidean distances of the start and of the end points (paper, Eq. 1)."""
        distance: Tensor = torch.linalg.vector_norm(_pairs(a - b), dim=-1).sum(-1)
        return distance


class BorderPositions(Representation):
    """1D: positions `(g_s, g_e)` of both ends on the border, clockwise from top left, in [0, 1)."""

    num_params = 2
    to_border = True

    def activate(self, raw: Float[Tensor, "*shape 2"]) -> Float[Tensor, "*shape 2"]:
        """Wraps around the border: continuous over the corner, slope 1 everywhere."""
        return torch.remainder(raw, 1.0)

    def encode(self, endpoints: Float[Tensor, "*shape 2 2"]) -> Float[Tensor, "*shape 2"]:
        """Projects each end point to the nearest side and measures its way along the border."""
        x, y = endpoints.clamp(0.0, 1.0).unbind(-1)
        ways = torch.stack([x, 1 + y, 3 - x, 4 - y], dim=-1) / 4  # along top, right, bottom and left side
        gaps = torch.stack([y, 1 - x, 1 - y, x], dim=-1)
        way = ways.gather(-1, gaps.argmin(-1, keepdim=True)).squeeze(-1)
        return torch.remainder(way, 1.0)

    def decode(self, params: Float[Tensor, "*shape 2"]) -> Float[Tensor, "*shape 2 2"]:
        """Walks along the border; each coordinate is a trapezoid of the way walked."""
        way = 4 * params
        x = (1.5 - (way - 1.5).abs()).clamp(0.0, 1.0)
        y = (1.5 - (way - 2.5).abs()).clamp(0.0, 1.0)
        return torch.stack([x, y], dim=-1)

    def distance(
        self, a: Float[Tensor, "*#shape 2"], b: Float[Tensor, "*#shape 2"]
    ) -> Float[Tensor, "*#shape"]:
        """Sums the circular distances of both ends along the border (paper, Eq. 2)."""
        gap = (a - b).abs()
        return torch.minimum(gap, (1 - gap).abs()).sum(-1)


class EulerAngles(Representation):
    """Eu: `(cos a, sin a, cos b, sin b)`, the angles between the image's y-axis and the rays to both ends."""

    num_params = 4
    to_border = True

    def activate(self, raw: Float[Tensor, "*shape 4"]) -> Float[Tensor, "*shape 4"]:
        """Normalizes each (cos, sin) pair to the unit circle."""
        pairs = _pairs(raw)
        return (pairs / pairs.square().sum(-1, keepdim=True).add(1e-6).sqrt()).flatten(-2)

    def encode(self, endpoints: Float[Tensor, "*shape 2 2"]) -> Float[Tensor, "*shape 4"]:
        """Gives cosine and sine of the angle from the downward y-axis towards x, at the cell center."""
        ray = endpoints - 0.5
        ray = ray / torch.linalg.vector_norm(ray, dim=-1, keepdim=True).clamp_min(1e-6)
        distance: Tensor = ray.flip(-1).flatten(-2)  # (x, y) = (sin, cos)
        return distance

    def decode(self, params: Float[Tensor, "*shape 4"]) -> Float[Tensor, "*shape 2 2"]:
        """Follows each ray from the cell center to the border of the cell."""
        ray = _pairs(params).flip(-1)
        return 0.5 + 0.5 * ray / ray.abs().amax(-1, keepdim=True).clamp_min(1e-6)

    def distance(
        self, a: Float[Tensor, "*#shape 4"], b: Float[Tensor, "*#shape 4"]
    ) -> Float[Tensor, "*#shape"]:
        """Gives the mean squared error of the four components (paper, Eq. 3, read as its text says)."""
        return (a - b).square().mean(-1)


class MidpointDirection(Representation):
    """Md: midpoint and extent `(m_x, m_y, e_x, e_y)` with the extent from start to end."""

    num_params = 4
    to_border = False

    def activate(self, raw: Float[Tensor, "*shape 4"]) -> Float[Tensor, "*shape 4"]:
        """Squashes the midpoint like Po and the extent into (-1.2, 1.2)."""
        return torch.cat([stretched_sigmoid(raw[..., :2]), 1.2 * torch.tanh(raw[..., 2:])], dim=-1)

    def encode(self, endpoints: Float[Tensor, "*shape 2 2"]) -> Float[Tensor, "*shape 4"]:
        """Gives midpoint and extent."""
        start, end = endpoints.unbind(-2)
        return torch.cat([(start + end) / 2, end - start], dim=-1)

    def decode(self, params: Float[Tensor, "*shape 4"]) -> Float[Tensor, "*shape 2 2"]:
        """Steps half the extent back and forth from the midpoint."""
        middle, extent = params[..., :2], params[..., 2:]
        return torch.stack([middle - extent / 2, middle + extent / 2], dim=-2)

    def distance(
        self, a: Float[Tensor, "*#shape 4"], b: Float[Tensor, "*#shape 4"]
    ) -> Float[Tensor, "*#shape"]:
        """Sums the Euclidean distances of the midpoints and of the extents."""
        distance: Tensor = torch.linalg.vector_norm(_pairs(a - b), dim=-1).sum(-1)
        return distance


REPRESENTATIONS: dict[str, type[Representation]] = {
    "po": CartesianPoints,
    "1d": BorderPositions,
    "eu": EulerAngles,
    "md": MidpointDirection,
}
