"""The made-up input is what it is said to be."""

from __future__ import annotations

import math

import numpy as np
import pytest

from yolino.benchmark.scenes import (
    as_output,
    converging_lanes,
    heaped_candidates,
    noisy_candidates,
    true_segments,
)
from yolino.postprocess.nms import NMS


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def test_lanes_meet_in_one_point_and_become_segments(rng):
    lanes = converging_lanes(rng, (320, 640), 5)
    assert len(lanes) == 5
    assert np.allclose([line[-1] for line in lanes], next(iter(lanes))[-1])
    assert all(line[0, 1] == 320 for line in lanes)
    assert np.allclose(true_segments(lanes, (320, 640), 16).lengths.max(), 16 * math.sqrt(2), atol=6)


@pytest.mark.parametrize("count", [10, 100, 2000])
def test_candidates_are_as_many_as_asked_for_and_form_clusters(rng, count):
    candidates = noisy_candidates(rng, count)
    assert len(candidates) == count
    assert len(NMS(16.0)(candidates)) < count


def test_a_heap_is_one_cluster_of_neighbors(rng):
    heap = heaped_candidates(rng, 200)
    assert NMS(16.0, min_samples=200).clusters(heap).tolist() == [0] * 200


def test_a_made_up_output_holds_the_candidates_above_the_threshold(rng):
    candidates = noisy_candidates(rng, 30)
    output = as_output(candidates, 100, 0.7, 3)
    above = output.scores[0] >= 0.7
    assert above.sum() == 30
    assert np.allclose(output.endpoints[0][above], candidates.endpoints, atol=1e-4)
    assert output.probabilities is not None
    assert output.probabilities.shape == (1, 100, 3)
