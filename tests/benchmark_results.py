"""A small result of a benchmark, as its JSON has it."""

from __future__ import annotations

from typing import Any

from yolino.benchmark.curves import Curve, Point
from yolino.benchmark.frames import STEPS
from yolino.benchmark.measure import Measure, Section, at_least


def small_result(**given: Section) -> dict[str, Any]:
    """Gives a result with these sections; by default with one of each kind that is drawn."""
    sections = given or {
        "stages": stages(),
        "nms": nms(),
        "growth": growth(),
        "engines": engines(),
        "roofline": roofline(),
    }
    return {
        "machine": {
            "cpu": "A processor",
            "cores": 2,
            "threads": 2,
            "system": "Linux 6 x86_64",
            "python": "3.11.1",
            "load": None,
            "versions": {"yolino": "1.0"},
        },
        "model": {
            "name": "tiny",
            "file": "tiny.onnx",
            "megabytes": 0.1,
            "size": [64, 128],
            "stride": 16,
            "predictors": 1,
            "device": "cpu",
        },
        "settings": {"repeats": 5, "seconds": 1.0, "quick": False, "image": "drawn road"},
        "targets": {"met": [], "missed": [], "not_measured": []},
        "sections": {name: section.to_dict() for name, section in sections.items()},
    }


def stages() -> Section:
    measures = {
        f"{kind}_{step}": Measure(f"{title}: {words}", 0.5 + number, "ms")
        for kind, title in {"image": "this image, 7 candidates", "candidates": "500 candidates"}.items()
        for number, (step, words) in enumerate(STEPS.items())
    }
    return Section("One frame", "How.", measures | {"image_total": Measure("this image: all", 9.0, "ms")})


def nms() -> Section:
    return Section(
        "NMS",
        "How.",
        {
            "ours_500": Measure("500: yolino", 0.05, "ms"),
            "sklearn_500": Measure("500: scikit-learn", 6.0, "ms"),
            "speedup_500": Measure("500: faster", 120.0, "x", target=at_least(100)),
        },
    )


def growth(points: int = 4) -> Section:
    sizes = [10.0**power for power in range(1, points + 1)]
    linear = tuple(Point(x, x / 50, x / 60, x / 40, x / 1e3) for x in sizes)
    square = tuple(Point(x, x * x / 1e4, x * x / 1e4, x * x / 1e4, None, f"{x:.0f}x1") for x in sizes)
    curves = (
        Curve("nms", "NMS", "candidates", linear),
        Curve("graph", "linker graph", "candidates", square),
        Curve("empty", "nothing", "classes", ()),
    )
    return Section("Growth", "How.", {}, curves=curves)


def engines() -> Section:
    measures: dict[str, Measure] = {}
    for number, name in enumerate(("ONNX Runtime fp32", "OpenVINO int8")):
        key = f"engine{number}"
        measures |= {
            f"{key}_network": Measure(f"{name}: bare network", 10.0 - number, "ms"),
            f"{key}_total": Measure(f"{name}: end to end", 11.0 - number, "ms"),
            f"{key}_roofline": Measure(f"{name}: part of the roofline", 40.0 + number, "%"),
        }
    return Section("Engines", "How.", measures)


def roofline() -> Section:
    return Section("Roofline", "How.", {"fp32": Measure("matrix product, fp32", 200.0, "GFLOP/s")})
