from __future__ import annotations

import pytest

from yolino.benchmark.measure import Measure

pytest.importorskip("torch", reason="the paper's network is built with torch")


def test_the_aims_of_a_gpu_are_those_of_the_fastest_engine() -> None:
    from yolino.benchmark.paper import gpu_aims

    found = {
        "a_fps": Measure("a", 900.0, "fps"),
        "b_fps": Measure("b", 1200.0, "fps"),
        "a_batch": Measure("a", 0.01, "ms"),
        "a_batch_whole": Measure("a", 0.125, "ms"),
        "b_batch_whole": Measure("b", 0.25, "ms"),
    }
    aims = {name: measure.to_dict() for name, measure in gpu_aims(found, 64).items()}
    assert (aims["best_fps"]["value"], aims["best_fps"]["met"]) == (1200.0, True)
    assert (aims["best_batches"]["value"], aims["best_batches"]["met"]) == (8000.0, True)
