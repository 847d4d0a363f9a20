"""What a network costs on any machine: parameters, and floating-point operations of one image."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

from yolino.inference.engine_openvino import openvino_core

_PRODUCTS = {
    "Convolution",
    "GroupConvolution",
    "ConvolutionBackpropData",
    "GroupConvolutionBackpropData",
    "MatMul",
}
_TRANSPOSED = {"ConvolutionBackpropData", "GroupConvolutionBackpropData"}


class Cost(NamedTuple):
    """What one image costs.

    Attributes:
        parameters: Numbers in the weights of convolutions and matrix products.
        operations: Multiplications and additions of these, each counted as one.
    """

    parameters: int
    operations: int


def cost_of(path: Path) -> Cost:
    """Gives what the network in a model file costs, counted in its graph for one image of its input size.

    Biases, activations and pooling are left out, as usual: they are a percent of the rest.

    Args:
        path: An exported model (.onnx or .xml).
    """
    model = openvino_core().read_model(path)
    _, *rest = model.inputs[0].partial_shape
    model.reshape({0: [1, *(edge.get_length() for edge in rest)]})
    parameters, operations = 0, 0
    for node in model.get_ops():
        if node.get_type_name() in _PRODUCTS:
            weights = tuple(node.input(1).get_shape())
            parameters += math.prod(weights)
            operations += 2 * _multiplications(node, weights)
    return Cost(parameters, operations)


def _multiplications(node: Any, weights: tuple[int, ...]) -> int:
    """Gives the multiplications of a convolution or a matrix product with `weights`.

    Each number of a convolution's weights meets each place of the output (of a transposed one: of the input)
    once.
    """
    if node.get_type_name() == "MatMul":
        return math.prod(map(int, [*node.output(0).get_shape(), list(node.input(0).get_shape())[-1]]))
    seen = node.input(0) if node.get_type_name() in _TRANSPOSED else node.output(0)
    batch, _, *places = map(int, seen.get_shape())
    return math.prod([*weights, *places, batch])


__all__ = ["Cost", "cost_of"]
