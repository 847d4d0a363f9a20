"""What the benchmark compares with computes the same."""

from __future__ import annotations

import numpy as np
import pytest

from yolino.benchmark.baselines.loop_linker import link_in_loops
from yolino.benchmark.baselines.loop_points import match_in_a_loop
from yolino.benchmark.linking import recovered
from yolino.benchmark.scenes import (
    converging_lanes,
    noisy_candidates,
    true_segments,
)
from yolino.metrics.points import match_points
from yolino.postprocess.nms import NMS
from yolino.types import Polylines, Segments


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


@pytest.mark.parametrize("count", [3, 60, 700])
def test_the_nms_on_scikit_learn_gives_the_same(rng, count):
    pytest.importorskip("sklearn")
    from yolino.benchmark.baselines.sklearn_nms import nms_with_sklearn, sklearn_clusters

    candidates = noisy_candidates(rng, count)
    reverse = Segments(candidates.endpoints[:, ::-1], candidates.scores * 0.9)
    both = Segments(
        np.concatenate([candidates.endpoints, reverse.endpoints]),
        np.concatenate([candidates.scores, reverse.scores]),
    )
    nms, found = NMS(16.0), nms_with_sklearn(both, 16.0)
    assert nms.clusters(both).tolist() == sklearn_clusters(both, 16.0).tolist()
    assert np.allclose(nms(both).endpoints, found.endpoints, atol=1e-6)
    assert np.allclose(nms(both).scores, found.scores)


def test_the_loop_over_points_finds_the_same(rng):
    truth = converging_lanes(rng, (320, 640), 4, nearest=0.1)
    prediction = truth.with_vertices(truth.vertices + rng.normal(0, 4, truth.vertices.shape))
    match = match_points(prediction, truth, (320, 640))
    hit = match_in_a_loop(match.prediction, match.truth, match.radius)
    assert hit.tolist() == match.true_positives.tolist()
    assert 0 < hit.sum() < len(hit)


def test_the_loops_of_the_matching_find_the_same(rng):
    torch = pytest.importorskip("torch")
    from yolino.benchmark.baselines.loop_matching import match_cell_by_cell, match_pair_by_pair
    from yolino.benchmark.training import _pairs, _targets
    from yolino.model.representations import CartesianPoints
    from yolino.training.matching import match

    targets, params = _targets(rng, 2, (64, 128)), torch.rand(2, 32, 2, 4)
    ours = _pairs(match(params, targets, CartesianPoints()))
    assert len(ours) > 10
    assert ours == match_pair_by_pair(params, targets, CartesianPoints())
    assert ours == match_cell_by_cell(params, targets, CartesianPoints())


def test_the_loop_linker_links_lanes_that_stay_apart(rng):
    lanes = converging_lanes(rng, (320, 640), 3, nearest=0.4)
    segments = true_segments(lanes, (320, 640), 16)
    found = link_in_loops(segments[rng.permutation(len(segments))], 16.0)
    assert recovered(lanes, found, (320, 640)) > 0.9


def test_recovered_length_counts_a_lane_once_and_only_by_its_own_polylines():
    lanes = Polylines.from_list([[[10, 0], [10, 100]], [[50, 0], [50, 100]]])
    half = [[10, 0], [10, 50]]
    assert recovered(lanes, lanes, (100, 100)) == 1
    assert recovered(lanes, Polylines.from_list([half, half]), (100, 100)) == pytest.approx(0.27, abs=0.01)
    assert recovered(lanes, Polylines.from_list([]), (100, 100)) == 0
    across = Polylines.from_list([[[0, 50], [30, 50]]])
    assert recovered(lanes, across, (100, 100)) == pytest.approx(0.04, abs=0.01)
