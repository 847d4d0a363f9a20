"""The measured step is a training step, its parts add up, and without a GPU it says so."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("torch")

import torch

from yolino.benchmark.setup import Setup
from yolino.benchmark.training import NETWORKS, PARTS, _Step, measure_training
from yolino.model.network import Network


def step(tmp_path: Path) -> _Step:
    torch.manual_seed(0)
    return _Step(Network(**NETWORKS["default"]), Setup(tmp_path, quick=True), torch.device("cpu"))


def test_with_and_without_clocks_the_same_weights_are_learned(tmp_path: Path) -> None:
    clocked, plain = step(tmp_path), step(tmp_path)
    for _ in range(2):
        clocked()
        plain.plain()
    for a, b in zip(clocked.network.parameters(), plain.network.parameters(), strict=True):
        torch.testing.assert_close(a, b, atol=1e-5, rtol=1e-3)
    assert len(clocked.rows) == 2
    assert all(len(row) == len(PARTS) and min(row) >= 0 for row in clocked.rows)


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_without_a_gpu_the_section_says_so(tmp_path: Path) -> None:
    section = measure_training(Setup(tmp_path, device="cuda", quick=True))
    assert section.not_measured == "not measured: no GPU that torch can use"
    assert not section.measures
