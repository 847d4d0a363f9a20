from __future__ import annotations

import numpy as np
import pytest

from yolino.datasets.texture import crop, noise, sample


@pytest.mark.parametrize("slope", [0.0, 1.0, 2.0])
def test_noise_is_normalized_read_only_and_continues_over_its_border(slope: float) -> None:
    tile = noise(slope, 128)
    assert abs(tile.mean()) < 0.05
    assert 0.9 < tile.std() < 1.05
    assert not tile.flags.writeable
    inner = np.abs(np.diff(tile, axis=1)).mean()
    border = np.abs(tile[:, 0] - tile[:, -1]).mean()
    assert border < 2 * inner


def test_steeper_noise_is_smoother() -> None:
    rough, smooth = (np.abs(np.diff(noise(slope, 128), axis=0)).mean() for slope in (0.0, 2.0))
    assert smooth < 0.2 * rough


@pytest.mark.parametrize("size", [(3, 5), (128, 128), (300, 70)])
def test_a_crop_has_its_size_and_repeats_the_tile(size: tuple[int, int]) -> None:
    part = crop(1.0, size, np.random.default_rng(0), tile=128)
    assert part.shape == size
    if size[0] > 128:
        assert np.array_equal(part[128:256], part[:128])


def test_sample_equals_indexing_with_wrap() -> None:
    tile = noise(0.5, 64)
    rng = np.random.default_rng(1)
    column = rng.uniform(-500, 500, (7, 9)).astype(np.float32)
    row = rng.uniform(0, 500, (7, 1)).astype(np.float32)
    expected = tile[row.astype(int) % 64, column.astype(int) % 64]
    assert np.array_equal(sample(tile, column, row), expected)
