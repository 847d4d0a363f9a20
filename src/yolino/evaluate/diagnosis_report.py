"""A diagnosis as tables, and as a page with pictures of the images that lose most."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from yolino.datasets import Dataset
from yolino.evaluate.diagnosis import Diagnosis
from yolino.evaluate.diagnosis_rows import CAUSES
from yolino.evaluate.oracles import LADDER
from yolino.evaluate.worst import Image, pixels_of
from yolino.io import write_atomic, write_image
from yolino.metrics import PointMetric
from yolino.types import Polylines, Sample
from yolino.viz import contact_sheet, draw_matches, fit_tile

_COLUMNS = ("accuracy", "fp", "fn", "f1", "precision", "recall", "segment_f1")
_SMALLEST = 0.0005
_TILE = (720, 1280)  # pixels: height and width in which images are drawn
_STYLE = (
    "body{font:16px/1.5 system-ui,sans-serif;max-width:75rem;margin:2rem auto;padding:0 1rem}"
    "table{border-collapse:collapse}td,th{padding:.2rem .8rem;border-bottom:1px solid #ccc;text-align:right}"
    "td:first-child,th:first-child{text-align:left}img{max-width:100%}"
)
_COLORS = (
    "Left the model, right the same with this stage repaired. Hits are green, false alarms blue, misses red."
)


class Table(NamedTuple):
    """A table to print.

    Attributes:
        title: What it shows.
        header: Names of the columns.
        rows: The cells.
    """

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]


def tables(diagnosis: Diagnosis, *, brief: bool = False) -> list[Table]:
    """Gives the rows, the losses and, where there is accuracy, where along the lines it is lost.

    Args:
        diagnosis: What was found.
        brief: Whether to leave out precision and recall, so that a terminal has room.
    """
    hidden = ("precision", "recall") if brief else ()
    shown = [name for name in _COLUMNS if name in diagnosis.rows[0].scores and name not in hidden]
    named = [name.replace("_", " ") for name in shown]
    headline = diagnosis.headline
    interval, gain = f"95 % of {headline}", "gain"
    rows = [
        [
            row.title,
            *(f"{row.scores[name]:.3f}" for name in shown),
            _range(row.intervals[headline]),
            "" if row.name == "model" else _signed(row.gain),
        ]
        for row in diagnosis.rows
    ]
    losses = [
        [loss.stage, *(_signed(loss.values[name]) for name in shown), _range(loss.intervals[headline])]
        for loss in diagnosis.losses
    ]
    found = [
        Table("With steps replaced by the truth", ("row", *named, interval, gain), rows),
        Table("What each stage loses", ("stage", *named, interval), losses),
    ]
    if diagnosis.causes:
        causes = [(CAUSES[name], f"{value:.4f}") for name, value in diagnosis.causes.items()]
        found.append(
            Table("Where along the lines accuracy is lost", ("rows of the labels", "accuracy"), causes)
        )
    return found


def write_diagnosis(
    folder: Path,
    diagnosis: Diagnosis,
    dataset: Dataset,
    *,
    title: str,
    facts: Sequence[str] = (),
    worst: int = 9,
) -> None:
    """Writes `report.md` and `report.html`, and pictures of the images that lose most at the worst stage.

    Args:
        folder: Where to write.
        diagnosis: What was found.
        dataset: The images that it was found on.
        title: First line of the page.
        facts: What was diagnosed on what and how, a sentence each.
        worst: Number of pictures.
    """
    pictures = _write_pictures(folder, diagnosis, dataset, worst)
    write_atomic(folder / "report.md", _markdown(diagnosis, title, facts, pictures))
    write_atomic(folder / "report.html", _html(diagnosis, title, facts, pictures))


class _Picture(NamedTuple):
    name: str
    loss: float
    file: str


def _write_pictures(folder: Path, diagnosis: Diagnosis, dataset: Dataset, worst: int) -> list[_Picture]:
    """Writes a picture of each of the worst images of the dominant stage that lose anything."""
    dominant = diagnosis.dominant
    step = next(step for step in LADDER if step.stage == dominant.stage)
    written = []
    for rank, index in enumerate(np.argsort(-np.array(dominant.images), kind="stable")[:worst], 1):
        if dominant.images[index] <= 0:
            break
        sample, loss = dataset[int(index)], dominant.images[index]
        name = Path(sample.name).with_suffix("").as_posix().replace("/", "-")
        image = pixels_of(sample)
        tiles = [
            _verdict(image, sample, diagnosis.lines[oracle][index], dataset.directed)
            for oracle in (step.below, step.above)
        ]
        titles = [f"loses {loss:.3f} by {step.stage}", f"without: {sample.name}"]
        file = f"worst/{rank:02d}-{name}.png"
        write_image(
            folder / file,
            contact_sheet(tiles, titles, columns=2, tile=(tiles[0].shape[0], tiles[0].shape[1])),
        )
        written.append(_Picture(sample.name, loss, file))
    return written


def _verdict(image: Image, sample: Sample, lines: Polylines, directed: bool) -> Image:
    """Gives the image with the point metric's verdict on lines."""
    size = (image.shape[0], image.shape[1])
    match = PointMetric(directed=directed).match(lines, sample.polylines, size, sample.ignore)
    canvas = fit_tile(image, _TILE)
    scale = np.array(canvas.shape[1::-1]) / np.array(size[::-1])
    found, truth = match.prediction.points * scale, match.truth.points * scale
    return draw_matches(
        canvas,
        hits=found[match.true_positives],
        false_alarms=found[match.false_positives],
        misses=truth[match.false_negatives],
        reach=match.radius * float(scale.min()),
    )


def _markdown(diagnosis: Diagnosis, title: str, facts: Sequence[str], pictures: Sequence[_Picture]) -> str:
    lines = [f"# {title}", "", diagnosis.verdict, "", *(f"- {fact}" for fact in facts)]
    for table in tables(diagnosis):
        lines += ["", f"## {table.title}", "", "| " + " | ".join(table.header) + " |"]
        lines += ["|---" + "|---:" * (len(table.header) - 1) + "|"]
        lines += ["| " + " | ".join(row) + " |" for row in table.rows]
    if pictures:
        lines += ["", f"## Most lost by {diagnosis.dominant.stage}", "", _COLORS]
    for each in pictures:
        link = each.file.replace(" ", "%20")
        lines += ["", f"### {each.name}", "", f"{diagnosis.headline} {each.loss:.3f}", "", f"![]({link})"]
    return "\n".join(lines) + "\n"


def _html(diagnosis: Diagnosis, title: str, facts: Sequence[str], pictures: Sequence[_Picture]) -> str:
    text = html.escape
    parts = [f"<h1>{text(title)}</h1><p>{text(diagnosis.verdict)}</p>"]
    parts.append("<ul>" + "".join(f"<li>{text(fact)}</li>" for fact in facts) + "</ul>")
    for table in tables(diagnosis):
        heads = "".join(f"<th>{text(name)}</th>" for name in table.header)
        cells = "".join(
            "<tr>" + "".join(f"<td>{text(cell)}</td>" for cell in row) + "</tr>" for row in table.rows
        )
        parts.append(f"<h2>{text(table.title)}</h2><table><tr>{heads}</tr>{cells}</table>")
    if pictures:
        parts.append(f"<h2>Most lost by {text(diagnosis.dominant.stage)}</h2><p>{text(_COLORS)}</p>")
    parts += [
        f"<h3>{text(each.name)}</h3><p>{diagnosis.headline} {each.loss:.3f}</p>"
        f'<img alt="" loading="lazy" src="{text(each.file)}">'
        for each in pictures
    ]
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{text(title)}</title>'
        f"<style>{_STYLE}</style>{''.join(parts)}</html>\n"
    )


def _signed(value: float) -> str:
    """Gives the value with its sign, and without one where nothing is left of it."""
    return "0.000" if abs(value) < _SMALLEST else f"{value:+.3f}"


def _range(interval: tuple[float, float]) -> str:
    low, high = (round(value, 3) + 0.0 for value in interval)  # + 0.0: no -0.000
    return f"{low:.3f} .. {high:.3f}"


__all__ = ["Table", "tables", "write_diagnosis"]
