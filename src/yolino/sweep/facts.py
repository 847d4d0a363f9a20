"""What the numbers of a sweep rest on, in sentences, and whether the reported ones rest on the same."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from yolino.sweep.description import Basis, Sweep
from yolino.sweep.result import Part, Result, Row


def facts(sweep: Sweep, rows: Mapping[str, Row]) -> list[str]:
    """Gives a sentence for each data that was trained and scored on, and what is not as it was reported."""
    found: dict[tuple[object, ...], tuple[Basis | None, list[Result]]] = {}
    for group in sweep.layout.groups:
        for name in group.rows:
            for result in rows[name].results.values():
                key = (result.train, result.scored, group.reported_on)
                kept = found.setdefault(key, (group.reported_on, []))[1]
                if result not in kept:
                    kept.append(result)
    reporter = sweep.layout.reported_by
    return [f"{_sentence(runs)}{_deviation(runs, basis, reporter)}" for basis, runs in found.values()]


def _sentence(runs: Sequence[Result]) -> str:
    first = runs[0]
    training = [result.settings["training"] for result in runs]
    backbones = _either(result.settings["model"]["backbone"] for result in runs)
    sizes = _either("x".join(map(str, result.settings["data"]["size"])) for result in runs)
    batches = _either(str(settings["batch_size"]) for settings in training)
    return (
        f"Trained on {_parts(first.train)}, scored on {_parts(first.scored)}; backbone {backbones}, "
        f"input {sizes}, "
        f"{_range([result.steps for result in runs])} steps of {batches} images, "
        f"seed {_either(str(seed) for seed in sorted({result.seed for result in runs}))}."
    )


def _deviation(runs: Sequence[Result], basis: Basis | None, reporter: str) -> str:
    """Says what differs from what the reported numbers rest on; nothing if nothing does."""
    if basis is None:
        return ""
    found = []
    for what, count, parts in (("train", basis.train, runs[0].train), ("score", basis.val, runs[0].scored)):
        if count is not None and count != sum(part.images for part in parts):
            found.append(f"{count:,} images to {what}")
    said = []
    if found:
        said.append(f"not the data of the {reporter} ({basis.data}, {' and '.join(found)})")
    backbones = {result.settings["model"]["backbone"] for result in runs}
    if basis.backbone is not None and backbones != {basis.backbone}:
        said.append(
            f"not its backbone ({basis.backbone})" if said else f"not the {reporter}'s {basis.backbone}"
        )
    if not said:
        return ""
    return f" This is {' and '.join(said)}: compare the rows with each other rather than with the {reporter}."


def _parts(parts: Sequence[Part]) -> str:
    return " and ".join(f"{part.name} ({part.images:,} images)" for part in parts)


def _either(values: Iterable[str]) -> str:
    return ", ".join(dict.fromkeys(values))


def _range(values: Sequence[int]) -> str:
    low, high = min(values), max(values)
    return f"{low:,}" if low == high else f"{low:,} to {high:,}"


__all__ = ["facts"]
