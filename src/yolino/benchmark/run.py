"""Runs the sections of the benchmark one after the other."""

from __future__ import annotations

import importlib
import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from yolino.benchmark.clock import opencv_threads
from yolino.benchmark.machine import describe_machine
from yolino.benchmark.measure import Section, lacking
from yolino.benchmark.setup import Setup
from yolino.inference.engine import usable_cores

Progress = Callable[[Sequence[str]], Iterable[str]]


class Entry(NamedTuple):
    """Where a section is measured, imported when its turn comes.

    Attributes:
        title: What it is about.
        module: Module below `yolino.benchmark`.
        function: Function there: `Setup` -> `Section`.
        needs: Modules without which it cannot run.
        model: Whether it runs the model.
    """

    title: str
    module: str
    function: str = "measure"
    needs: tuple[str, ...] = ()
    model: bool = False


SECTIONS: dict[str, Entry] = {
    "stages": Entry("One frame, step by step", "stages", model=True),
    "roofline": Entry("The most that this machine can do", "roofline", needs=("openvino",)),
    "engines": Entry("The model on every engine", "engines", model=True),
    "paper": Entry("Darknet-19 on every engine", "paper", needs=("torch", "onnx")),
    "files": Entry("JPEG files to polylines", "files", model=True),
    "video": Entry("Video to polylines", "video", model=True),
    "darknet19": Entry("The model beside Darknet-19", "darknet", needs=("torch", "onnx"), model=True),
    "nms": Entry("NMS beside scikit-learn", "nms"),
    "linking": Entry("Linking and spline", "linking"),
    "linkers": Entry("What linkers make of segments", "linkers"),
    "discretize": Entry("Polylines to cells", "labels", "measure_discretize"),
    "points": Entry("Point metric beside a loop", "labels", "measure_points"),
    "matching": Entry("Matching beside loops", "training", "measure_matching", needs=("torch",)),
    "training": Entry("Matching and loss in training", "training", "measure_training", needs=("torch",)),
    "loading": Entry("JPEG file to training tensor", "loading", needs=("torch", "torchvision")),
    "growth": Entry("Growth", "growth", model=True),
    "startup": Entry("Start and memory", "process", "measure_startup", model=True),
    "install": Entry("Installation", "process", "measure_install"),
}


def benchmark(
    model: str = "default",
    device: str = "auto",
    *,
    engine: str = "auto",
    precision: str = "auto",
    repeats: int = 30,
    image: Path | str | None = None,
    only: Sequence[str] | None = None,
    threads: int | None = None,
    quick: bool = False,
    progress: Progress = iter,
) -> dict[str, Any]:
    """Measures speed, memory and size on this machine, beside other implementations in the same run.

    Contestants take turns; values are medians with quartiles. Let nothing else run on the machine meanwhile.

    Args:
        model: "default" or a model file.
        device: Where the network runs: "auto", "cpu" or "cuda".
        engine: What runs the model, where a section does not take every engine.
        precision: In which arithmetic, likewise.
        repeats: Largest number of rounds; a race that takes longer than 10 s ends after three or more.
        image: Image file of the frame; a drawn road of 720x1280 by default.
        only: Names in `SECTIONS`; all by default.
        threads: Threads of the network, OpenCV and torch; all usable cores by default.
        quick: Whether to take tiny inputs, only to see that everything runs.
        progress: Wraps the names of the sections that are looped over, to show a progress bar.

    Returns:
        One JSON object: `machine`, `model` (None if no section runs one), `settings`, `targets` (the names of
        those met, missed and not measured) and `sections`; each measure has `title`, `value`, `unit`, `low`,
        `high`, `target`, `bound`, `met` and `note`.

    Raises:
        ValueError: An unknown section, model or device, or a number out of range.
        FileNotFoundError: The model or the image does not exist.
    """
    names = chosen_sections(only)
    if repeats < 1 or (threads is not None and threads < 1):
        raise ValueError(f"repeats is {repeats} and threads {threads}, but both must be at least 1.")
    count = threads or usable_cores()
    machine = describe_machine(count, device)
    with tempfile.TemporaryDirectory(prefix="yolino-benchmark-") as folder, opencv_threads(count):
        setup = Setup(
            Path(folder),
            model=str(model),
            device=device,
            engine=engine,
            precision=precision,
            threads=count,
            repeats=min(repeats, 2) if quick else repeats,
            seconds=0.0 if quick else 10.0,
            quick=quick,
            image=None if image is None else Path(image),
        )
        described = setup.describe_model() if any(SECTIONS[name].model for name in names) else None
        sections = {name: _measure(name, setup).to_dict() for name in progress(names)}
    return {
        "machine": machine,
        "model": described,
        "settings": {
            "repeats": setup.repeats,
            "seconds": setup.seconds,
            "quick": quick,
            "image": _name(image),
        },
        "targets": _verdicts(sections),
        "sections": sections,
    }


def chosen_sections(only: Sequence[str] | None) -> list[str]:
    """Gives the names of the sections to measure, in the order of `SECTIONS`; all without a choice.

    Raises:
        ValueError: An unknown section.
    """
    unknown = [name for name in only or () if name not in SECTIONS]
    if unknown:
        raise ValueError(
            f"The section {unknown[0]!r} of the benchmark is unknown; use one of {', '.join(SECTIONS)}."
        )
    return [name for name in SECTIONS if not only or name in only]


def _measure(name: str, setup: Setup) -> Section:
    entry = SECTIONS[name]
    if why := lacking(*entry.needs):
        return Section(entry.title, "", not_measured=f"not measured: {why}")
    measure: Callable[[Setup], Section] = getattr(
        importlib.import_module(f"yolino.benchmark.{entry.module}"), entry.function
    )
    return measure(setup)


def _verdicts(sections: dict[str, dict[str, Any]]) -> dict[str, list[str]]:
    """Gives the measures that have a target, as `section.measure`, by what became of them."""
    verdicts: dict[str, list[str]] = {"met": [], "missed": [], "not_measured": []}
    names = {True: "met", False: "missed", None: "not_measured"}
    for section, found in sections.items():
        for key, measured in found["measures"].items():
            if measured["target"] is not None:
                verdicts[names[measured["met"]]].append(f"{section}.{key}")
        if found["not_measured"]:
            verdicts["not_measured"].append(section)
    return verdicts


def _name(image: Path | str | None) -> str:
    return "drawn road" if image is None else Path(image).name


__all__ = ["SECTIONS", "Entry", "Progress", "benchmark", "chosen_sections"]
