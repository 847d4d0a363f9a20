"""The loader that is measured is the one that trains."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")

from yolino.benchmark import loading
from yolino.benchmark.loading import jpeg_batches, jpeg_files
from yolino.benchmark.setup import Setup
from yolino.training.loaders import Batches


def test_batches_are_those_of_training_and_the_cache_changes_nothing(tmp_path: Path) -> None:
    setup = Setup(tmp_path, quick=True)
    files = jpeg_files(setup)
    plain, cached = (
        jpeg_batches(setup, files, "gentle", batch=2, workers=0, cached=cached) for cached in (False, True)
    )
    assert isinstance(plain, Batches)
    assert len(plain) == 3
    for a, b in zip(plain, cached, strict=True):
        assert a.images.shape == (2, 3, 320, 640)
        assert np.array_equal(a.images.numpy(), b.images.numpy())
        assert len(a.targets.cells) > 50
    assert list((tmp_path / "decoded").glob("*.npy"))


def test_the_rate_counts_from_the_first_batch(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([5.0, 5.5, 6.0, 7.5])  # when batches are done

    batches = Batches([0] * 64, batch_size=16)  # type: ignore[arg-type]
    monkeypatch.setattr(loading, "perf_counter", lambda: next(clock))
    assert loading._rate(batches) == 3 * 16 / 2.5
