"""An evaluation as a page to read: Markdown, and the same as HTML."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path

from yolino.evaluate.confusion import draw_confusion
from yolino.evaluate.run import Evaluation
from yolino.io import write_atomic

_STYLE = (
    "body{font:16px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem}"
    "table{border-collapse:collapse}td,th{padding:.2rem .8rem;border-bottom:1px solid #ccc;text-align:right}"
    "td:first-child,th:first-child{text-align:left}img{max-width:100%}"
)
_COUNTS = {"images": "{:.0f}", "fps": "{:.1f}", "ms": "{:.1f}", "radius": "{:.1f}"}
Row = tuple[str, str, str]


PICTURE = "confusion.svg"
SCORE_COLUMNS = ("score", "value", "95 % interval")
CLASS_COLUMNS = ("class", "lines", "right", "95 % interval", "precision", "recall", "F1")
_SHOWN = ("class_recall_lines", "precision", "recall", "f1")  # of each class, as columns
_OF_CLASS = (*_SHOWN, "class_recall")  # the last is the share in the confusion matrix of points


def score_rows(evaluation: Evaluation) -> list[Row]:
    """Gives a row for each score but those of single classes: name, value, 95 % interval."""
    rows = []
    of_class = {f"{score}_{name}" for score in _OF_CLASS for name in evaluation.classes}
    for name, value in evaluation.scores.items():
        if name not in of_class:
            text = _COUNTS.get(name, "{:.4f}").format(value)
            rows.append((name.replace("_", " "), text, _interval(evaluation, name)))
    return rows


def class_rows(evaluation: Evaluation) -> list[tuple[str, ...]]:
    """Gives a row for each class, in the order of `CLASS_COLUMNS`; none if classes were not compared.

    These are its name, how many of its lines were found, the part of them that was called so with its
    interval, and the point metric of this class alone.
    """
    rows = []
    for name, counts in zip(evaluation.classes, evaluation.line_confusion, strict=True):
        texts = dict.fromkeys(_SHOWN, "")
        for score in _SHOWN:
            # Of what was not found nothing was called right or wrong.
            if f"{score}_{name}" in evaluation.scores and (any(counts) or score != _SHOWN[0]):
                texts[score] = f"{evaluation.scores[f'{score}_{name}']:.3f}"
        right, *others = texts.values()
        interval = _interval(evaluation, f"{_SHOWN[0]}_{name}") if right else ""
        rows.append((name, str(sum(counts)), right, interval, *others))
    return rows


def confusion_tables(evaluation: Evaluation) -> list[tuple[str, Sequence[str], list[tuple[str, ...]]]]:
    """Gives title, columns and rows of the confusion matrices; none if classes were not compared."""
    columns = ("labelled \\ predicted", *evaluation.classes)
    return [
        (title, columns, [(n, *map(str, row)) for n, row in zip(evaluation.classes, matrix, strict=True)])
        for title, matrix in _matrices(evaluation).items()
    ]


def _matrices(evaluation: Evaluation) -> dict[str, Sequence[Sequence[int]]]:
    if not evaluation.classes:
        return {}
    return {
        "Lines that were found": evaluation.line_confusion,
        "Points that were found": evaluation.confusion,
    }


def _interval(evaluation: Evaluation, name: str) -> str:
    low, high = evaluation.intervals.get(name, (None, None))
    return "" if low is None else f"{low:.3f} .. {high:.3f}"


def write_report(folder: Path, evaluation: Evaluation, *, title: str, facts: Sequence[str] = ()) -> None:
    """Writes `report.md` and `report.html` into the folder that holds the pictures of the worst images.

    If classes were compared, it also draws their confusion matrices: `confusion.svg`.

    Args:
        folder: Where to write; pictures are linked relative to it.
        evaluation: What was found.
        title: First line of the page.
        facts: What was evaluated on what and how, a sentence each.
    """
    if evaluation.classes:
        write_atomic(folder / PICTURE, draw_confusion(evaluation.classes, _matrices(evaluation)))
    write_atomic(folder / "report.md", _markdown(folder, evaluation, title, facts))
    write_atomic(folder / "report.html", _html(folder, evaluation, title, facts))


_CLASSES = (
    "Lines are those that were found, right is the part of them that carries its class, each line as a whole "
    "by what most of it carries. Precision, recall and F1 are the point metric's over the lines of one class."
)
_COLORS = "Hits are green, false alarms blue, misses red, as in the paper; F1 is that of the point metric."


def _markdown(folder: Path, evaluation: Evaluation, title: str, facts: Sequence[str]) -> str:
    lines = [f"# {title}", "", *(f"- {fact}" for fact in facts), ""]
    lines += _markdown_table(SCORE_COLUMNS, score_rows(evaluation))
    if evaluation.classes:
        lines += ["", "## Classes", "", *_markdown_table(CLASS_COLUMNS, class_rows(evaluation)), "", _CLASSES]
        lines += ["", f"![]({PICTURE})"]
    if evaluation.worst:
        lines += ["", "## The worst images", "", _COLORS]
    for bad in evaluation.worst:
        link = bad.picture.relative_to(folder).as_posix().replace(" ", "%20")
        lines += ["", f"### {bad.name}", "", _of(bad.f1, bad.precision, bad.recall), "", f"![]({link})"]
    return "\n".join(lines) + "\n"


def _markdown_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    ruler = "|---|" + "---:|" * (len(columns) - 1)
    head, *body = ("| " + " | ".join(row) + " |" for row in (columns, *rows))
    return [head, ruler, *body]


def _of(f1: float, precision: float, recall: float) -> str:
    return f"F1 {f1:.3f}, precision {precision:.3f}, recall {recall:.3f}"


def _html(folder: Path, evaluation: Evaluation, title: str, facts: Sequence[str]) -> str:
    text = html.escape
    pictures = "".join(
        f"<h3>{text(bad.name)}</h3><p>{_of(bad.f1, bad.precision, bad.recall)}</p>"
        f'<img alt="" loading="lazy" src="{text(bad.picture.relative_to(folder).as_posix())}">'
        for bad in evaluation.worst
    )
    worst = f"<h2>The worst images</h2><p>{_COLORS}</p>{pictures}" if evaluation.worst else ""
    classes = (
        f"<h2>Classes</h2>{_html_table(CLASS_COLUMNS, class_rows(evaluation))}<p>{_CLASSES}</p>"
        f'<img alt="Confusion matrices" src="{PICTURE}">'
        if evaluation.classes
        else ""
    )
    items = "".join(f"<li>{text(fact)}</li>" for fact in facts)
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{text(title)}</title>'
        f"<style>{_STYLE}</style><h1>{text(title)}</h1><ul>{items}</ul>"
        f"{_html_table(SCORE_COLUMNS, score_rows(evaluation))}{classes}{worst}</html>\n"
    )


def _html_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    def row(cells: Sequence[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells) + "</tr>"

    return f"<table>{row(columns, 'th')}{''.join(row(cells, 'td') for cells in rows)}</table>"


__all__ = ["CLASS_COLUMNS", "SCORE_COLUMNS", "class_rows", "confusion_tables", "score_rows", "write_report"]
