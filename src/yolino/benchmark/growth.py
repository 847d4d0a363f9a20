"""Section `growth`: how time and memory grow with image, candidates, lines, classes and batch."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import cv2
import numpy as np
from jaxtyping import UInt8

from yolino.benchmark.curves import Curve
from yolino.benchmark.frames import made_up_output
from yolino.benchmark.growing import NEAR_LINEAR, Case, exponents, grow
from yolino.benchmark.measure import Measure, Section, lacking, missing
from yolino.benchmark.scenes import SIZE, STRIDE, candidates_around, heaped_candidates, noisy_candidates
from yolino.benchmark.setup import Setup
from yolino.header import Header
from yolino.inference import Predictor
from yolino.postprocess import LINKERS
from yolino.postprocess.nms import NMS
from yolino.types import Output, Polylines, Segments

IMAGES = (
    (240, 320),
    (480, 640),
    (720, 1280),
    (1080, 1920),
    (1440, 2560),
    (2160, 3840),
    (2880, 5120),
    (4320, 7680),
)
CANDIDATES = (100, 300, 1000, 3000, 10_000, 30_000, 100_000, 300_000, 1_000_000)
LINES = (1, 3, 10, 30, 100, 300, 1000, 3000, 10_000)
CLASSES = (1, 2, 5, 10, 20, 50, 100)
BATCHES = (1, 2, 4, 8, 16, 32)
_MOST_IN_ONE_SCENE = 100_000  # candidates that are linked: beyond, a picture of 320x640 has room for no more
PER_LINE = 30
_LINE_CELLS, _FIELD_CELLS = 10, (3, 18)  # length; rows and columns of its own, too many to be joined across
_NETWORK_NEEDS = ("torch", "onnx")
ABOUT = (
    "Each curve has the exponent of its growth: the slope of log time (memory) over log size in the upper "
    "half of the sizes, 1 is linear. More candidates come from a larger scene with more lanes, as dense as "
    "before, in the order of a network's cells; worst cases apart are the same scene with more candidates, "
    f"and all of them in one radius. Linkers get what the NMS leaves. Lines: {PER_LINE} candidates around "
    "each, in a field of its own. Classes: from the network's output to polylines, without the network. "
    "Memory: the most that the process held during one call, less what it held before, as the system counts "
    "it (compiled kernels and engines included; exact to some tenths of a MB; exponents only from 1 MB on). "
    "That of the network's input and of several images at once includes opening the model."
)


def measure(setup: Setup) -> Section:
    """Measures all curves."""
    parts = (_images, _inputs, _candidates, _dense_candidates, _lines, _classes, _batches)
    curves = [curve for part in parts for curve in part(setup)]
    measures: dict[str, Measure] = {}
    for curve in curves:
        measures |= exponents(curve, None if setup.quick else NEAR_LINEAR)
    if why := lacking(*_NETWORK_NEEDS):
        title = "network, by pixels of the network's input: exponent of the time"
        measures["input_time"] = missing(title, "", NEAR_LINEAR, why)
    return Section("Growth", ABOUT, measures, curves=curves)


def _sizes(setup: Setup, sizes: Sequence[int]) -> Sequence[int]:
    return sizes[:2] if setup.quick else sizes


def _images(setup: Setup) -> Iterator[Curve]:
    """Measures preprocessing and whole frames of one scene in finer and finer pixels."""
    sizes = IMAGES[:2] if setup.quick else IMAGES
    images = [cv2.resize(setup.frame, size[::-1], interpolation=cv2.INTER_LINEAR) for size in sizes]
    predictor = setup.predictor
    steps: dict[str, tuple[str, Callable[..., object]]] = {
        "preprocess": ("preprocess", predictor.preprocess),
        "frame": ("whole frame", predictor),
    }
    for name, (title, step) in steps.items():
        cases = [
            Case(height * width, partial(step, image), f"{width}x{height}")
            for (height, width), image in zip(sizes, images, strict=True)
        ]
        yield grow(setup, name, title, "pixels of the image", cases)


def _inputs(setup: Setup) -> Iterator[Curve]:
    """Measures one network at several sizes of its input, where it can be exported."""
    if not lacking(*_NETWORK_NEEDS):
        from yolino.benchmark.growth_network import measure_inputs

        yield measure_inputs(setup)


def _candidates(setup: Setup) -> Iterator[Curve]:
    """Measures NMS and linkers on larger and larger scenes."""
    scenes = [_by_cell(noisy_candidates(setup.rng, count)) for count in _sizes(setup, CANDIDATES)]
    yield from _suppress_and_link(setup, "", "candidates, larger scene", scenes)


def _dense_candidates(setup: Setup) -> Iterator[Curve]:
    """Measures NMS and linkers on the same scene with more and more candidates."""
    counts, x = _sizes(setup, CANDIDATES), "candidates, same scene"
    heaps = [heaped_candidates(setup.rng, count) for count in counts]
    yield _over(setup, ("nms_heap", "NMS, all in one radius", x), NMS(float(STRIDE)), heaps)
    scenes = [_by_cell(noisy_candidates(setup.rng, count, size=SIZE)) for count in counts]
    yield from _suppress_and_link(setup, "_dense", x, scenes)


def _by_cell(segments: Segments) -> Segments:
    """Gives the segments in the order of a network's cells, row by row."""
    columns, rows = np.floor(segments.midpoints / STRIDE).T
    return segments[np.lexsort((columns, rows))]


def _suppress_and_link(setup: Setup, suffix: str, x: str, scenes: Sequence[Segments]) -> Iterator[Curve]:
    nms = NMS(float(STRIDE))
    yield _over(setup, (f"nms{suffix}", "NMS", x), nms, scenes)
    linked = [scene for scene in scenes if not suffix or len(scene) <= _MOST_IN_ONE_SCENE]
    merged = [nms(scene) for scene in linked]
    for name, linker in LINKERS.items():
        labels = (f"{name}{suffix}", f"linker {name}", x)
        yield _over(setup, labels, linker(float(STRIDE)), merged, [len(scene) for scene in linked])


def _lines(setup: Setup) -> Iterator[Curve]:
    """Measures NMS and linking together on more and more lines."""
    counts, nms = _sizes(setup, LINES), NMS(float(STRIDE))
    scenes = [lines_apart(setup.rng, count) for count in counts]
    for name, linker in LINKERS.items():
        labels = (f"lines_{name}", f"NMS, linker {name}", "lines")
        yield _over(setup, labels, _both(nms, linker(float(STRIDE))), scenes, counts)


def _both(nms: NMS, linker: Callable[[Segments], Polylines]) -> Callable[[Segments], Polylines]:
    return lambda segments: linker(nms(segments))


def _over(
    setup: Setup,
    names: tuple[str, str, str],
    step: Callable[[Segments], object],
    inputs: Sequence[Segments],
    sizes: Sequence[int] | None = None,
) -> Curve:
    """Measures one step on several inputs; names are those of the curve, sizes by default the inputs'."""
    sizes = [len(each) for each in inputs] if sizes is None else sizes
    cases = [Case(size, partial(step, each)) for size, each in zip(sizes, inputs, strict=True)]
    return grow(setup, *names, cases)


def lines_apart(rng: np.random.Generator, count: int) -> Segments:
    """Gives candidates around lines that lie in fields of their own, in rows and columns.

    Args:
        rng: Source of all randomness.
        count: Number of lines, each with 30 candidates, a tenth of them clutter anywhere.
    """
    columns = int(np.ceil(np.sqrt(count)))
    places = np.stack([np.arange(count) % columns, np.arange(count) // columns], axis=1)
    rows, width = _FIELD_CELLS
    corners = places * (width, rows) + (1.0, rows / 2)
    slopes = rng.uniform(-0.1, 0.1, count)
    steps = np.stack([np.full(count, 1.0), slopes], axis=1) * _LINE_CELLS
    vertices = np.stack([corners, corners + steps], axis=1) * STRIDE
    lines = Polylines(vertices.reshape(-1, 2), 2 * np.arange(count + 1))
    size = ((int(places[-1, 1]) + 1) * rows * STRIDE, columns * width * STRIDE)
    return _by_cell(candidates_around(rng, lines, PER_LINE * count, size, STRIDE))


class _Answer:
    """An engine that has no network: it always gives the same output."""

    name, device, precision, streams = "made-up output", "cpu", "fp32", 1

    def __init__(self, header: Header, output: Output) -> None:
        self.header, self._output = header, output

    def __call__(self, batch: UInt8[np.ndarray, "b h w 3"], /) -> Output:
        return self._output


def _classes(setup: Setup) -> Iterator[Curve]:
    """Measures what follows the network, for outputs with more and more classes."""
    predictor, rng = setup.predictor, setup.rng
    image = np.zeros((*predictor.header.size, 3), np.uint8)
    output = made_up_output(predictor, rng)
    cases = []
    for count in _sizes(setup, CLASSES):
        shares = rng.dirichlet(np.ones(count), output.scores.shape).astype(np.float32)
        header = replace(predictor.header, classes=tuple(f"class {i}" for i in range(count)))
        answer = _Answer(header, output._replace(probabilities=shares))
        cases.append(Case(count, partial(Predictor(answer, threshold=predictor.threshold), image)))
    yield grow(setup, "classes", "frame without network", "classes", cases)


def _batches(setup: Setup) -> Iterator[Curve]:
    """Measures more and more images at once: the network alone, and everything."""
    predictor = setup.predictor
    single = predictor.preprocess(setup.frame)[0]
    engine, whole = [], []
    for count in _sizes(setup, BATCHES):
        batch, frames = np.stack([single] * count), [setup.frame] * count
        engine.append(Case(count, partial(predictor.engine, batch), fresh=_fresh_engine(setup, batch)))
        whole.append(Case(count, partial(_of_batch(predictor, count), frames), fresh=_fresh(setup, frames)))
    yield grow(setup, "batch_network", "network", "images at once", engine)
    yield grow(setup, "batch_frames", "whole frames", "images at once", whole)


def _of_batch(predictor: Predictor, count: int) -> Predictor:
    return Predictor(predictor.engine, threshold=predictor.threshold, batch_size=count)


def _fresh_engine(setup: Setup, batch: np.ndarray) -> Callable[[], object]:
    # An engine keeps the memory of its largest batch, so each has one of its own.
    return lambda: replace(setup).predictor.engine(batch)


def _fresh(setup: Setup, frames: list[np.ndarray]) -> Callable[[], object]:
    return lambda: _of_batch(replace(setup).predictor, len(frames))(frames)


__all__ = ["lines_apart", "measure"]
