"""The benchmark's result as text: tables that read well in a terminal and in Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

_SIGNS = {"at least": ">=", "at most": "<=", "equal to": ""}
_WORDS = {True: "yes", False: "NO", None: ""}
_HEADER = ("measure", "median", "quartiles", "target", "met")


def report(result: dict[str, Any]) -> str:
    """Gives what `benchmark` found as text.

    Args:
        result: What `benchmark` gave.
    """
    blocks = [_machine(result)]
    quick = result["settings"]["quick"]
    for name, section in result["sections"].items():
        lines = [f"### {section['title']} (`{name}`)", ""]
        if section["not_measured"]:
            lines.append(_capital(section["not_measured"]))
        else:
            lines += [section["about"], "", *_table(list(section["measures"].values()), quick=quick)]
            for curve in section.get("curves", ()):
                lines += ["", *_curve(curve)]
        blocks.append("\n".join(lines))
    return "\n\n".join([*blocks, _summary(result["targets"], quick=quick)])


def _machine(result: dict[str, Any]) -> str:
    machine, model, settings = result["machine"], result["model"], result["settings"]
    versions = ", ".join(f"{name} {version}" for name, version in machine["versions"].items())
    cores = f"{machine['cores']} cores, {machine['threads']} threads"
    if machine.get("gpu"):
        cores += f", {machine['gpu']}"
    lines = [
        f"- Machine: {machine['cpu']}, {cores}; {machine['system']}",
        f"- Versions: Python {machine['python']}, {versions}",
    ]
    if model is not None:
        height, width = model["size"]
        lines.append(
            f"- Model: {model['name']} ({model['file']}, {model['megabytes']} MB), {height}x{width}, "
            f"cells of {model['stride']} px, on {model['device']}; image: {settings['image']}"
        )
    lines.append(f"- Medians of up to {settings['repeats']} interleaved rounds, with quartiles")
    if settings["quick"]:
        lines.append("- QUICK: tiny inputs, the numbers mean nothing")
    if machine["load"] is not None and machine["load"] > machine["cores"] / 2:
        lines.append(f"- The machine was busy before (load {machine['load']}): take the numbers with care")
    return "\n".join(lines)


def _table(measures: Sequence[dict[str, Any]], *, quick: bool) -> list[str]:
    rows = [
        (
            measured["title"],
            number(measured["value"], measured["unit"]),
            _range(measured),
            _target(measured),
            "" if quick else _WORDS[measured["met"]],
        )
        for measured in measures
    ]
    notes = [f"- {m['title']}: {m['note']}" for m in measures if m["note"]]
    widths = [max(len(row[i]) for row in [_HEADER, *rows]) for i in range(len(_HEADER))]
    line = [_row(_HEADER, widths), "|-" + "-|-".join("-" * width for width in widths) + "-|"]
    return line + [_row(row, widths) for row in rows] + (["", *notes] if notes else [])


def _curve(curve: dict[str, Any]) -> list[str]:
    """Gives a curve as a table with a column for each size, under the exponents."""
    costs = {"time": curve["exponent"], "memory": curve["memory_exponent"]}
    grown = [f"{cost} ~ n^{value:.2f}" for cost, value in costs.items() if value is not None]
    points = curve["points"]
    rows = [
        [curve["x"], *(point["label"] or f"{point['value']:,.0f}" for point in points)],
        [curve["unit"], *(_digits(point["median"]) for point in points)],
        ["MB", *("-" if p["megabytes"] is None else f"{p['megabytes']:.1f}" for p in points)],
    ]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    line = "|-" + "-|-".join("-" * width for width in widths) + "-|"
    head, *body = (_row(row, widths) for row in rows)
    return [": ".join([f"**{curve['title']}**", *[", ".join(grown)] * bool(grown)]), "", head, line, *body]


def _row(cells: Sequence[str], widths: Sequence[int]) -> str:
    return "| " + " | ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True)) + " |"


def _range(measured: dict[str, Any]) -> str:
    if measured["low"] is None:
        return ""
    return f"{_digits(measured['low'])} .. {_digits(measured['high'])}"


def _target(measured: dict[str, Any]) -> str:
    if measured["target"] is None:
        return ""
    return f"{_SIGNS[measured['bound']]} {number(measured['target'], measured['unit'])}".strip()


def number(value: float | bool | None, unit: str) -> str:
    """Gives a value with its unit, in three significant digits."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{_digits(value)} {unit}".strip()


def _digits(value: float) -> str:
    """Gives three significant digits, and no exponent."""
    if abs(value) >= 100 or value == int(value):
        return f"{value:.0f}"
    return f"{value:.3g}" if abs(value) >= 1e-4 else f"{value:.6f}"


def _summary(targets: dict[str, list[str]], *, quick: bool) -> str:
    parts = [f"{len(targets['met'])} of {len(targets['met']) + len(targets['missed'])} targets met"]
    if quick:
        parts = ["A quick run judges no targets"]
    elif targets["missed"]:
        parts.append(f"missed: {', '.join(targets['missed'])}")
    if targets["not_measured"]:
        parts.append(f"not measured: {', '.join(targets['not_measured'])}")
    return "; ".join(parts) + "."


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:] + "."


__all__ = ["number", "report"]
