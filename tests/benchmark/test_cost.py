from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from yolino.benchmark import roofline
from yolino.benchmark.cost import Cost, cost_of
from yolino.benchmark.setup import Setup
from yolino.inference.engine_openvino import import_openvino

openvino = import_openvino()
ops = openvino.opset13
NO_PADS = ([0, 0], [0, 0])


def _saved(path: Path, given: Any, result: Any) -> Path:
    openvino.save_model(openvino.Model([result], [given]), path, compress_to_fp16=False)
    return path


def _weights(*shape: int) -> Any:
    return ops.constant(np.ones(shape, np.float32))


def test_a_convolution_counted_by_hand(tmp_path: Path) -> None:
    given = ops.parameter([-1, 3, 8, 8], np.float32)
    path = _saved(
        tmp_path / "a.xml", given, ops.convolution(given, _weights(4, 3, 3, 3), [2, 2], *NO_PADS, [1, 1])
    )
    # 3x3 places of the output, at each of them each of the 108 weights once: multiplied and added.
    assert cost_of(path) == Cost(108, 2 * 108 * 9)


def test_a_depthwise_convolution_counted_by_hand(tmp_path: Path) -> None:
    given = ops.parameter([-1, 4, 5, 6], np.float32)
    weights = _weights(4, 1, 1, 3, 3)
    path = _saved(tmp_path / "a.xml", given, ops.group_convolution(given, weights, [1, 1], *NO_PADS, [1, 1]))
    assert cost_of(path) == Cost(36, 2 * 36 * 3 * 4)


def test_a_transposed_convolution_counts_the_places_of_its_input(tmp_path: Path) -> None:
    given = ops.parameter([-1, 4, 3, 5], np.float32)
    path = _saved(
        tmp_path / "a.xml", given, ops.convolution_backprop_data(given, _weights(4, 2, 2, 2), [2, 2])
    )
    assert cost_of(path) == Cost(32, 2 * 32 * 15)


def test_a_matrix_product_counted_by_hand(tmp_path: Path) -> None:
    given = ops.parameter([-1, 6, 7], np.float32)
    path = _saved(tmp_path / "a.xml", given, ops.matmul(given, _weights(7, 5), False, False))
    assert cost_of(path) == Cost(35, 2 * 6 * 7 * 5)


def test_the_packaged_model_costs_what_torch_counts() -> None:
    torch = pytest.importorskip("torch", reason="torch counts the operations")
    from torch.utils.flop_counter import FlopCounterMode

    from yolino.benchmark.training import NETWORKS
    from yolino.inference.loading import model_path
    from yolino.model.network import Network

    network = Network(**NETWORKS["default"]).eval()
    with FlopCounterMode(display=False) as counter, torch.no_grad():
        network(torch.zeros(1, 3, 320, 640))
    cost = cost_of(model_path("default"))
    assert cost.operations == counter.get_total_flops()
    assert 0.98 < cost.parameters / sum(p.numel() for p in network.parameters()) < 1


def test_the_roofline_names_every_precision(tmp_path: Path) -> None:
    section = roofline.measure(Setup(tmp_path, quick=True, repeats=1, seconds=0.0))
    assert list(section.measures) == [*roofline.precisions_here(), "memory"]
    assert all(float(measured.value or 0) > 0 for measured in section.measures.values())
    assert set(roofline.peaks(Setup(tmp_path, quick=True, repeats=1))) == set(roofline.precisions_here())


@pytest.mark.parametrize("precision", roofline.precisions_here())
def test_a_matrix_product_is_one(precision: str) -> None:
    product = roofline.matrix_product(precision, 32, 1)
    first = np.array(next(iter(product().values())))  # type: ignore[attr-defined]
    assert first.shape == (32, 32)
    assert np.isfinite(first).all()
