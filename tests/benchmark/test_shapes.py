"""Scenes of all shapes, and segments that are as good as they say."""

from __future__ import annotations

import numpy as np
import pytest

from yolino.benchmark.shapes import QUALITIES, SIZE, STRIDE, Quality, segments_of, shapes
from yolino.geometry import distance_to_segments


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(11)


def test_scenes_are_the_same_for_the_same_seed_and_inside_the_picture(rng: np.random.Generator) -> None:
    a, b = shapes(rng), shapes(np.random.default_rng(11))
    np.testing.assert_array_equal(a.vertices, b.vertices)
    assert len(a) >= 8
    assert a.vertices.min() >= 0
    assert a.vertices.max() <= max(SIZE) + 2


def test_perfect_segments_lie_on_the_lines(rng: np.random.Generator) -> None:
    lines = shapes(rng)
    segments = segments_of(lines, QUALITIES["perfect"], rng)
    inside = (segments.midpoints > 0).all(axis=1)
    assert distance_to_segments(segments.endpoints[inside].reshape(-1, 2), lines.endpoints).max() < 1e-6
    assert (segments.scores == 1).all()


def test_qualities_lose_move_and_add_segments(rng: np.random.Generator) -> None:
    lines = shapes(rng)
    perfect = len(segments_of(lines, Quality("all"), rng))
    assert len(segments_of(lines, Quality("half", lost=0.5), rng)) == pytest.approx(perfect / 2, rel=0.2)
    cluttered = segments_of(lines, Quality("more", clutter=0.5), rng)
    assert len(cluttered) == perfect + round(0.5 * perfect)
    assert (cluttered.scores < 1).sum() == round(0.5 * perfect)
    moved = segments_of(lines, Quality("off", jitter_cells=0.2), rng)
    distances = distance_to_segments(moved.endpoints.reshape(-1, 2), lines.endpoints)
    assert 0.05 * STRIDE < distances.mean() < 0.2 * STRIDE
    turned = segments_of(lines, Quality("turned", turn=0.2), rng)
    assert distance_to_segments(turned.midpoints, lines.endpoints).max() < 3
