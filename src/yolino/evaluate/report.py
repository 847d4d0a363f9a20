"""An evaluation as a page to read: Markdown, and the same as HTML."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path

from yolino.evaluate.run import Evaluation
from yolino.io import write_atomic

_STYLE = (
    "body{font:16px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem}"
    "table{border-collapse:collapse}td,th{padding:.2rem .8rem;border-bottom:1px solid #ccc;text-align:right}"
    "td:first-child,th:first-child{text-align:left}img{max-width:100%}"
)
_COUNTS = {"images": "{:.0f}", "fps": "{:.1f}", "ms": "{:.1f}", "radius": "{:.1f}"}
Row = tuple[str, str, str]


def score_rows(evaluation: Evaluation) -> list[Row]:
    """Gives a row for each score: name, value, 95 % interval."""
    rows = []
    for name, value in evaluation.scores.items():
        low, high = evaluation.intervals.get(name, (None, None))
        interval = "" if low is None else f"{low:.3f} .. {high:.3f}"
        rows.append((name.replace("_", " "), _COUNTS.get(name, "{:.4f}").format(value), interval))
    return rows


def write_report(folder: Path, evaluation: Evaluation, *, title: str, facts: Sequence[str] = ()) -> None:
    """Writes `report.md` and `report.html` into the folder that holds the pictures of the worst images.

    Args:
        folder: Where to write; pictures are linked relative to it.
        evaluation: What was found.
        title: First line of the page.
        facts: What was evaluated on what and how, a sentence each.
    """
    write_atomic(folder / "report.md", _markdown(folder, evaluation, title, facts))
    write_atomic(folder / "report.html", _html(folder, evaluation, title, facts))


_SCORES = ("score", "value", "95 % interval")
_COLORS = "Hits are green, false alarms blue, misses red, as in the paper; F1 is that of the point metric."


def _markdown(folder: Path, evaluation: Evaluation, title: str, facts: Sequence[str]) -> str:
    lines = [f"# {title}", "", *(f"- {fact}" for fact in facts), "", "| " + " | ".join(_SCORES) + " |"]
    lines += ["|---|---:|---:|", *("| " + " | ".join(row) + " |" for row in score_rows(evaluation))]
    if evaluation.worst:
        lines += ["", "## The worst images", "", _COLORS]
    for bad in evaluation.worst:
        link = bad.picture.relative_to(folder).as_posix().replace(" ", "%20")
        lines += ["", f"### {bad.name}", "", _of(bad.f1, bad.precision, bad.recall), "", f"![]({link})"]
    return "\n".join(lines) + "\n"


def _of(f1: float, precision: float, recall: float) -> str:
    return f"F1 {f1:.3f}, precision {precision:.3f}, recall {recall:.3f}"


def _html(folder: Path, evaluation: Evaluation, title: str, facts: Sequence[str]) -> str:
    text = html.escape
    cells = "".join(
        "<tr>" + "".join(f"<td>{text(cell)}</td>" for cell in row) + "</tr>" for row in score_rows(evaluation)
    )
    heads = "".join(f"<th>{text(name)}</th>" for name in _SCORES)
    pictures = "".join(
        f"<h3>{text(bad.name)}</h3><p>{_of(bad.f1, bad.precision, bad.recall)}</p>"
        f'<img alt="" loading="lazy" src="{text(bad.picture.relative_to(folder).as_posix())}">'
        for bad in evaluation.worst
    )
    worst = f"<h2>The worst images</h2><p>{_COLORS}</p>{pictures}" if evaluation.worst else ""
    items = "".join(f"<li>{text(fact)}</li>" for fact in facts)
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{text(title)}</title>'
        f"<style>{_STYLE}</style><h1>{text(title)}</h1><ul>{items}</ul>"
        f"<table><tr>{heads}</tr>{cells}</table>{worst}</html>\n"
    )


__all__ = ["score_rows", "write_report"]
