"""Section `nms`: the NMS beside the same NMS on scikit-learn."""

from __future__ import annotations

import numpy as np

from yolino.benchmark.clock import race
from yolino.benchmark.measure import (
    TRUE,
    Measure,
    Section,
    Target,
    at_least,
    lacking,
    milliseconds,
    missing,
    ratio,
)
from yolino.benchmark.scenes import STRIDE, heaped_candidates, noisy_candidates
from yolino.benchmark.setup import Setup
from yolino.postprocess.nms import NMS
from yolino.types import Segments

_TARGETS = {100: 80, 500: 100, 2000: 80, 10_000: 30}
_HEAP, _HEAP_TARGET = 4000, 4
ABOUT = (
    "The whole NMS from segments to merged segments. The other one has the same coordinates, radius, "
    "weights and means, written with numpy arrays around scikit-learn's DBSCAN with its defaults (a k-d "
    "tree; one core, as ours). Candidates lie around converging lanes, about five to each piece of a "
    "lane, a tenth is clutter; in the heap all lie in one radius."
)


def measure(setup: Setup) -> Section:
    """Times both at several numbers of candidates, and compares what they find."""
    cases: dict[str, tuple[str, Segments, Target]] = {}
    for count, wanted in ({40: 80} if setup.quick else _TARGETS).items():
        cases[str(count)] = (f"{count} candidates", noisy_candidates(setup.rng, count), at_least(wanted))
    heap = heaped_candidates(setup.rng, 40 if setup.quick else _HEAP)
    cases["heap"] = (f"{len(heap)} candidates in one radius", heap, at_least(_HEAP_TARGET))
    measures: dict[str, Measure] = {}
    for name, (title, segments, target) in cases.items():
        for key, measured in _case(setup, title, segments, target).items():
            measures[f"{key}_{name}"] = measured
    return Section("NMS beside scikit-learn", ABOUT, measures)


def _case(setup: Setup, title: str, segments: Segments, target: Target) -> dict[str, Measure]:
    """Gives the measures of one set of candidates."""
    nms = NMS(float(STRIDE))
    titles = {
        "ours": f"{title}: yolino",
        "sklearn": f"{title}: scikit-learn",
        "speedup": f"{title}: yolino is faster",
        "identical": f"{title}: same clusters and segments",
    }
    if why := lacking("sklearn"):
        times = race({"ours": lambda: nms(segments)}, **setup.pace)
        return {
            "ours": milliseconds(titles["ours"], times["ours"]),
            "sklearn": missing(titles["sklearn"], "ms", None, why),
            "speedup": missing(titles["speedup"], "x", target, why),
            "identical": missing(titles["identical"], "", TRUE, why),
        }
    from yolino.benchmark.baselines.sklearn_nms import nms_with_sklearn, sklearn_clusters

    times = race(
        {"ours": lambda: nms(segments), "sklearn": lambda: nms_with_sklearn(segments, float(STRIDE))},
        **setup.pace,
    )
    same = np.array_equal(nms.clusters(segments), sklearn_clusters(segments, float(STRIDE)))
    same = same and _alike(nms(segments), nms_with_sklearn(segments, float(STRIDE)))
    return {
        "ours": milliseconds(titles["ours"], times["ours"]),
        "sklearn": milliseconds(titles["sklearn"], times["sklearn"]),
        "speedup": ratio(titles["speedup"], times["sklearn"], times["ours"], target),
        "identical": Measure(titles["identical"], same, target=TRUE),
    }


def _alike(a: Segments, b: Segments) -> bool:
    """Tells whether both are the same segments in the same order, to a millionth of a pixel."""
    return (
        len(a) == len(b)
        and np.allclose(a.endpoints, b.endpoints, rtol=0, atol=1e-6)
        and np.allclose(a.scores, b.scores)
    )


__all__ = ["measure"]
