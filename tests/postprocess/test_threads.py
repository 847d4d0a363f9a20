"""NMS and linkers keep nothing between calls: threads may share them."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from yolino.postprocess import LINKERS, NMS
from yolino.types import Polylines, Segments


@pytest.mark.parametrize("name", LINKERS)
def test_two_threads_get_what_one_gets(name: str, noisy: Callable[[int, int], Segments]) -> None:
    nms, linker = NMS(16.0), LINKERS[name](16.0, min_length_cells=0.0)
    scenes = [noisy(seed, 5 + 7 * (seed % 40)) for seed in range(120)]

    def run(scene: Segments) -> tuple[Segments, Polylines]:
        merged = nms(scene)
        return merged, linker(merged)

    alone = [run(scene) for scene in scenes]
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(run, scenes))
    for one, two in zip(alone, together, strict=True):
        for value, twin in zip(one, two, strict=True):
            for field, array in vars(value).items():
                np.testing.assert_array_equal(array, vars(twin)[field])
