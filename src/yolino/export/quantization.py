"""int8: quantize, judge by the labels, and say in the header what it cost."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from yolino.export.calibration import Calibration, Inputs, Progress, check_drop, evenly, polyline_f1
from yolino.export.comparison import endpoint_shift
from yolino.export.formats import Format
from yolino.header import Header
from yolino.inference import Engine, Predictor, open_engine

_COMPARED = 20  # inputs


def quantize(
    data: bytes, exact: Engine, target: Format, calibration: Calibration, out: Path, *, progress: Progress
) -> Header:
    """Writes a network quantized to 8 bits, if it still finds what it found before.

    Args:
        data: The network as ONNX, without metadata.
        exact: The same network, running.
        target: Format of the file.
        calibration: Images to quantize with, labels to judge by.
        out: The file, where nobody reads it yet.
        progress: Wraps the indices of images, to show a progress bar.

    Returns:
        The header of the file. `metrics["int8"]` says what quantizing cost, in which engine.

    Raises:
        ValueError: The F1 of the polylines falls by more than is allowed, or there is nothing to judge by.
    """
    images, before = calibration.chosen(), Predictor(exact)
    count = len(images)
    f1_before = polyline_f1(before, images, progress, "scoring before")
    check_drop(f1_before, f1_before, calibration.max_drop, count)
    inputs = Inputs(before, images, calibration.images, progress)
    model = target.quantize(data, inputs)
    header = dataclasses.replace(exact.header, precision="int8")
    judged = out.with_stem("judged")  # not `out`: what an engine has open must not be written again
    target.save(model, header, judged)
    engine = open_engine(judged)  # the one that will run it where none is named
    f1_after = polyline_f1(Predictor(engine), images, progress, "scoring after")
    check_drop(f1_before, f1_after, calibration.max_drop, count)
    seen = np.concatenate([inputs[i] for i in evenly(len(inputs), _COMPARED)])
    found = {
        "images": count,
        "engine": engine.name,
        "f1_before": round(f1_before, 4),
        "f1_after": round(f1_after, 4),
        "shift_px": round(endpoint_shift(exact, engine, seen, before.threshold), 3),
    }
    header = dataclasses.replace(header, metrics={**header.metrics, "int8": found})
    target.save(model, header, out)
    return header


__all__ = ["quantize"]
