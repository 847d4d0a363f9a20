"""What tuning found, in words: rows of tables, sentences, and the new header."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from yolino.header import Header
from yolino.tuning.run import Estimate, Tuning

Row = tuple[str, ...]


def parameter_rows(tuning: Tuning) -> list[Row]:
    """Gives a row for each parameter that changes: name, before, after, its gain alone, its loss if kept."""
    return [
        (one.name, f"{one.before:g}", f"{one.after:g}", f"{one.alone:+.4f}", f"{one.share:+.4f}")
        for one in tuning.changes
        if one.before != one.after
    ]


def score_rows(tuning: Tuning) -> list[Row]:
    """Gives a row for each score: name, before, after, after on images that were left out of the tuning."""
    kinds = ("before", "after", "crossed")
    first = _row("objective", [getattr(tuning, kind).value for kind in kinds])
    return [
        first,
        *(_row(name, [tuning.scores[kind][name] for kind in kinds]) for name in tuning.scores["before"]),
    ]


def _row(name: str, values: list[float]) -> Row:
    return (name.replace("_", " "), *(f"{value:.4f}" for value in values))


def summary(tuning: Tuning) -> list[str]:
    """Gives the sentences that say what to expect."""
    changed = len(parameter_rows(tuning))
    here = f"On the {tuning.images} images that it was tuned on: {_gain(tuning.gain)}."
    there = (
        f"On images that it was not tuned on ({tuning.blocks} blocks, each with the settings that the others "
        f"give): {_gain(tuning.crossed_gain)}."
    )
    if not changed:
        return [
            f"None of {tuning.settings} settings is better for sure: keep what there is.",
            there,
        ]
    if tuning.crossed_gain.value <= 0:
        verdict = "Expect no gain on new images: keep the old settings, or label more images."
    elif tuning.crossed_gain.low <= 0:
        verdict = "On new images a gain is likely, but these images are too few to be sure."
    else:
        verdict = "Expect about this gain on new images of the same kind."
    return [here, there, verdict]


def _gain(gain: Estimate) -> str:
    return f"{gain.value:+.4f} ({gain.low:+.4f} .. {gain.high:+.4f})"


def tuned_header(header: Header, tuning: Tuning, data: str) -> Header:
    """Gives the header with the new post-processing; its metrics say what it was tuned on, and the scores.

    The old metrics are those of other settings: they stand below "before_tuning" then.

    Args:
        header: The model's.
        tuning: What was found.
        data: What the images are, for people.
    """
    metrics = {"tuning": facts(tuning, data), "before_tuning": dict(header.metrics)}
    return replace(header, postprocess=dict(tuning.postprocess), metrics=metrics)


def facts(tuning: Tuning, data: str) -> dict[str, Any]:
    """Gives what tuning found as plain values, for JSON."""

    def plain(estimate: Estimate) -> list[float]:
        return [round(value, 5) for value in (estimate.value, estimate.low, estimate.high)]

    def rounded(scores: Mapping[str, float]) -> dict[str, float]:
        return {name: round(value, 5) for name, value in scores.items()}

    return {
        "data": data,
        "images": tuning.images,
        "objective": tuning.objective.meaning,
        "before": plain(tuning.before),
        "after": plain(tuning.after),
        "cross_validated": plain(tuning.crossed),
        "cross_validated_gain": plain(tuning.crossed_gain),
        "scores": {kind: rounded(scores) for kind, scores in tuning.scores.items()},
    }


__all__ = ["Row", "facts", "parameter_rows", "score_rows", "summary", "tuned_header"]
