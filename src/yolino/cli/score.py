"""`yolino score`: predictions and labels in files, scores out; no model."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from yolino.cli.metrics import MetricOption, Radius, Undirected
from yolino.cli.options import AsJson

if TYPE_CHECKING:
    from yolino.evaluate import Scores

EPILOG = """
**Examples**

- `yolino score --metric tusimple predictions.json label_data_0531.json` gives the official script's values

- `yolino score --metric culane found/ CULane/ --list CULane/list/test.txt` gives the official
  tool's values

- `yolino score --metric chamfer yolino-out/ annotations.xml` compares any formats, image by image
"""
_SIDES = "A label file, a folder, or a data.yaml, in any format that can be read."


def add_to(app: typer.Typer) -> None:
    """Adds the command."""
    app.command(epilog=EPILOG)(score)


def score(
    predictions: Annotated[Path, typer.Argument(metavar="PREDICTIONS", help=_SIDES)],
    labels: Annotated[Path, typer.Argument(metavar="LABELS", help=_SIDES)],
    *,
    metric: Annotated[
        str, typer.Option("--metric", metavar="NAME", help="The metric; an unknown one lists them.")
    ] = "points",
    lists: Annotated[
        list[Path] | None,
        typer.Option("--list", metavar="FILE", help="Names of the images to score; a list per category."),
    ] = None,
    iou: Annotated[
        float | None, typer.Option("--iou", min=0, max=1, help="CULane: least overlap.", show_default="0.5")
    ] = None,
    size: Annotated[
        str | None,
        typer.Option(
            "--size", metavar="HEIGHTxWIDTH", help="Size of the images, where neither files nor images tell."
        ),
    ] = None,
    radius: Radius = None,
    undirected: Undirected = False,
    option_of_metric: MetricOption = None,
    format: Annotated[
        str | None,
        typer.Option("--format", metavar="FORMAT", help="Format of both sides.", show_default="found out"),
    ] = None,
    intervals: Annotated[
        bool,
        typer.Option("--intervals/--no-intervals", help="Whether to give 95 % intervals."),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Score predictions in files against labels in files."""
    from yolino.cli.metrics import build_metric
    from yolino.cli.screen import counted
    from yolino.evaluate import Scores
    from yolino.evaluate import score as run
    from yolino.metrics import Metric, score_files

    if metric == "tusimple" and predictions.is_file() and labels.is_file() and not lists:
        _print(Scores({**score_files(predictions, labels)}, {}, 0, {}), as_json=as_json)
        return
    shape = _shape(size)
    offered: dict[str, Any] = {"directed": not undirected}
    wanted = {"radius": radius, "iou": iou}
    if metric == "culane":
        shape = offered["size"] = shape or (590, 1640)

    def make(classes: Sequence[str]) -> Metric:
        chosen = classes or None
        return build_metric(metric, {**offered, "classes": chosen}, option_of_metric or (), wanted=wanted)

    make(())  # a mistake in the metric shows before files are read
    found = run(
        make,
        predictions,
        labels,
        lists=lists or (),
        size=shape,
        format=format,
        intervals=intervals,
        progress=counted("scoring"),
    )
    if found.missing:
        typer.echo(f"{found.missing} labelled images have no prediction: they count as misses.", err=True)
    _print(found, as_json=as_json)


def _shape(text: str | None) -> tuple[int, int] | None:
    """Gives `(height, width)` of `590x1640`."""
    if text is None:
        return None
    height, x, width = text.lower().partition("x")
    if not x or not height.isdecimal() or not width.isdecimal() or "0" in (height, width):
        raise ValueError(f"--size is {text!r}; give HEIGHTxWIDTH in pixels, e.g. 590x1640.")
    return int(height), int(width)


def _print(found: Scores, *, as_json: bool) -> None:
    import json

    from yolino.cli.screen import print_table

    names = found.classes or tuple(map(str, range(len(found.confusion))))
    if as_json:
        more: dict[str, Any] = {"intervals": found.intervals} if found.intervals else {}
        more |= {"categories": found.categories} if found.categories else {}
        more |= {"classes": names, "confusion": found.confusion} if found.confusion else {}
        typer.echo(json.dumps({**found.values, **more}))
        return
    rows = []
    for name, value in found.values.items():
        low, high = found.intervals.get(name, (None, None))
        text = f"{value:.4f}" if isinstance(value, float) else str(value)
        rows.append((name.replace("_", " "), text, "" if low is None else f"{low:.3f} .. {high:.3f}"))
    print_table(("score", "value", "95 % interval"), rows)
    for category, scores in found.categories.items():
        print_table(("score", "value"), [(n, f"{v:.4f}") for n, v in scores.items()], title=category)
    if found.confusion:
        counts = [(name, *row) for name, row in zip(names, found.confusion, strict=True)]
        print_table(("labelled \\ predicted", *names), counts, title="Samples that were found, by class")


__all__ = ["add_to", "score"]
