"""Section `linkers`: what each linker makes of perfect, noisy and incomplete segments of all shapes."""

from __future__ import annotations

from collections.abc import Callable

from yolino.benchmark.clock import race
from yolino.benchmark.measure import Measure, Section, at_least, milliseconds, percent
from yolino.benchmark.setup import Setup
from yolino.benchmark.shapes import QUALITIES, SHAPES, SIZE, STRIDE, Quality, segments_of, shapes
from yolino.metrics.points import PointMetric
from yolino.metrics.topo import TopoMetric
from yolino.postprocess import LINKERS
from yolino.postprocess.nms import NMS
from yolino.types import Polylines, Segments

_SCENES = 20
_RADIUS = 0.8 * STRIDE
_BEST = "graph"
_TARGETS = {"perfect": 95, "noisy": 90}
ABOUT = (
    f"{_SCENES} made-up scenes of {SIZE[0]}x{SIZE[1]} px, each with {', '.join(dict.fromkeys(SHAPES))}, cut "
    f"into cells of {STRIDE} px; NMS, then each linker with its defaults (tree: for all directions). Points: "
    f"F1 of the paper's metric with direction, within {_RADIUS:g} px. TOPO: F1 of what can be reached from "
    f"where, within {_RADIUS:g} px. Count: polylines found per true one; the graph linker cuts lines where "
    "others branch off."
)


def measure(setup: Setup) -> Section:
    """Measures all linkers on the same segments of each quality."""
    linkers: dict[str, Callable[[Segments], Polylines]] = {
        name: linker(float(STRIDE), **({"max_downward_cells": None} if name == "tree" else {}))
        for name, linker in LINKERS.items()
    }
    measures: dict[str, Measure] = {}
    for key, quality in QUALITIES.items():
        scenes = _scenes(setup, quality)
        for name, linker in linkers.items():
            measures |= _compare(f"{key}_{name}", f"{quality.title}, {name}", linker, scenes)
    found = [segments for _, segments in _scenes(setup, QUALITIES["noisy"])]
    times = race({name: _bind(linker, found[0]) for name, linker in linkers.items()}, **setup.pace)
    for name in linkers:
        measures[f"time_{name}"] = milliseconds(f"{name}: linking of {len(found[0])} segments", times[name])
    return Section("What linkers make of segments", ABOUT, measures)


def _scenes(setup: Setup, quality: Quality) -> list[tuple[Polylines, Segments]]:
    """Gives the lines of each scene and their segments after the NMS; the lines are the same each time."""
    rng, nms = setup.rng, NMS(float(STRIDE))
    every = [shapes(rng) for _ in range(2 if setup.quick else _SCENES)]
    return [(lines, nms(segments_of(lines, quality, rng))) for lines in every]


def _bind(linker: Callable[[Segments], Polylines], segments: Segments) -> Callable[[], Polylines]:
    return lambda: linker(segments)


def _compare(
    key: str,
    title: str,
    linker: Callable[[Segments], Polylines],
    scenes: list[tuple[Polylines, Segments]],
) -> dict[str, Measure]:
    """Gives the scores of one linker on one quality."""
    points, topo = PointMetric(radius=_RADIUS), TopoMetric(radius=_RADIUS)
    found = wanted = 0
    for truth, segments in scenes:
        lines = linker(segments)
        points.update(lines, truth, SIZE)
        topo.update(lines, truth, SIZE)
        found, wanted = found + len(lines), wanted + len(truth)
    quality, name = key.split("_")
    target = at_least(_TARGETS[quality]) if name == _BEST and quality in _TARGETS else None
    return {
        f"points_{key}": percent(f"{title}: points", [points.compute()["f1"]]),
        f"topo_{key}": percent(f"{title}: TOPO", [topo.compute()["f1"]], target),
        f"count_{key}": Measure(f"{title}: count", found / wanted, "x"),
    }


__all__ = ["measure"]
