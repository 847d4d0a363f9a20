"""The benchmark's result in a dozen rows, for a README."""

from __future__ import annotations

import re
from typing import Any

from yolino.benchmark.report import number

# What, its number, what stands beside it; {section.measure} becomes the number with its unit.
ROWS = (
    (
        "{model}, image to polylines, ONNX Runtime fp32",
        "{engines.onnxruntime_fp32_total} ({engines.onnxruntime_fp32_fps})",
        "the bare network: {engines.onnxruntime_fp32_network}",
    ),
    (
        "{model}, image to polylines, OpenVINO bf16",
        "{engines.openvino_bf16_total} ({engines.openvino_bf16_fps})",
        "the bare network: {engines.openvino_bf16_network}",
    ),
    (
        "{model}, image to polylines, OpenVINO int8",
        "{engines.openvino_int8_total} ({engines.openvino_int8_fps})",
        "the bare network: {engines.openvino_int8_network}",
    ),
    (
        "{model}, JPEG files decoded at half the size to polylines, OpenVINO bf16",
        "{files.openvino_bf16_half}",
        "decoded whole: {files.openvino_bf16_whole}",
    ),
    (
        "{model}, JPEG files decoded at half the size to polylines, OpenVINO int8",
        "{files.openvino_int8_half}",
        "decoded whole: {files.openvino_int8_whole}",
    ),
    (
        "Darknet-19, 32 px, image to polylines, OpenVINO int8",
        "{paper.32px_openvino_int8_total} ({paper.32px_openvino_int8_fps})",
        "bare: {paper.32px_openvino_int8_network}; ONNX Runtime fp32 {paper.32px_onnxruntime_fp32_total}",
    ),
    (
        "Darknet-19, 16 px, image to polylines, OpenVINO int8",
        "{paper.16px_openvino_int8_total} ({paper.16px_openvino_int8_fps})",
        "bare: {paper.16px_openvino_int8_network}; ONNX Runtime fp32 {paper.16px_onnxruntime_fp32_total}",
    ),
    (
        "post-processing of 500 candidates, after a network has run",
        "{stages.candidates_after}",
        "with the linker of new models: {stages.graph_after}",
    ),
    ("preprocessing of 1280x720", "{stages.candidates_preprocess}", "decoding it from JPEG: {stages.read}"),
    ("NMS of 500 candidates", "{nms.ours_500}", "scikit-learn, same clusters: {nms.speedup_500} slower"),
    ("NMS of 10,000 candidates", "{nms.ours_10000}", "scikit-learn: {nms.speedup_10000} slower"),
    ("NMS of 4,000 candidates in one radius", "{nms.ours_heap}", "scikit-learn: {nms.speedup_heap} slower"),
    ("linking and spline of a frame", "{linking.chain}", "a loop in Python: {linking.loops}"),
    ("point metric of an image", "{points.ours}", "a loop with numpy: {points.speedup} slower"),
    (
        "JPEG to augmented training tensor",
        "{loading.ours}",
        "PIL and torchvision v2: {loading.speedup} slower",
    ),
    (
        "training data from JPEG files, two processes",
        "{loading.gentle_rate}",
        "cached: {loading.gentle_cached_rate}",
    ),
    (
        "`yolino predict` on one image, start to end",
        "{startup.predict}",
        "the first time of all: {startup.first}",
    ),
    ("peak memory of `yolino predict`", "{startup.memory}", ""),
)
_NAME = re.compile(r"\{(\w+)\.(\w+)\}")


def summary(result: dict[str, Any]) -> str:
    """Gives the most telling numbers as a Markdown table; rows that were not measured are left out.

    If none was, it says so.

    Args:
        result: What `benchmark` gave.
    """
    rows = [filled for row in ROWS if (filled := _filled(row, result)) is not None]
    if not rows:
        return f"The summary has no row for {', '.join(result['sections'])}: leave out --summary."
    return "\n".join(["| what | median | beside it, in the same run |", "|---|---|---|", *map(_line, rows)])


def _filled(row: tuple[str, str, str], result: dict[str, Any]) -> tuple[str, str, str] | None:
    what, number, beside = row
    what = what.format(model=(result.get("model") or {}).get("name", "model"))
    if (found := _fill(number, result)) is None:
        return None
    return what, found, _fill(beside, result) or ""


def _fill(text: str, result: dict[str, Any]) -> str | None:
    """Gives a text with the numbers that it names; None if one of them was not measured."""
    found = {}
    for section, name in _NAME.findall(text):
        measured = result["sections"].get(section, {}).get("measures", {}).get(name)
        if measured is None or measured["value"] is None:
            return None
        found[section, name] = number(measured["value"], measured["unit"])
    return _NAME.sub(lambda match: found[match[1], match[2]], text)


def _line(row: tuple[str, str, str]) -> str:
    return f"| {' | '.join(row)} |"


__all__ = ["ROWS", "summary"]
