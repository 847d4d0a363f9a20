"""`yolino evaluate`: a model and a labelled dataset in, scores out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from yolino.cli.metrics import MetricOption, Radius, Undirected
from yolino.cli.options import (
    AsJson,
    Data,
    DatasetName,
    Device,
    Engine,
    Flip,
    Groups,
    Labels,
    Model,
    More,
    Precision,
    Root,
    SkipBroken,
    Split,
    Threshold,
    drawn_for_intervals,
)

if TYPE_CHECKING:
    from yolino.evaluate import Evaluation
    from yolino.inference import Predictor

EPILOG = """
**Examples**

- `yolino evaluate --data drive.yaml --split val --save scores` prints the scores with their intervals, and
  writes scores/report.html with pictures of the worst images

- `yolino evaluate --data photos/ --metric chamfer --metric topo --json` takes other metrics

- `yolino evaluate --dataset tusimple --root data/tusimple --labels label_data_0531.json --save scores` also
  writes scores/predictions.json, the benchmark's submission file
"""


def add_to(app: typer.Typer) -> None:
    """Adds the command."""
    app.command(epilog=EPILOG)(evaluate)


def evaluate(
    *,
    data: Data = None,
    split: Split = None,
    dataset: DatasetName = None,
    root: Root = None,
    labels: Labels = None,
    option: More = None,
    skip_broken: SkipBroken = False,
    model: Model = "default",
    threshold: Threshold = None,
    engine: Engine = "auto",
    device: Device = "auto",
    precision: Precision = "auto",
    flip: Flip = None,
    metric: Annotated[
        list[str] | None,
        typer.Option(
            "--metric",
            metavar="NAME",
            help="Metric over the lines; may be repeated; an unknown one lists them.",
            show_default="TuSimple's and the paper's",
        ),
    ] = None,
    radius: Radius = None,
    undirected: Undirected = False,
    option_of_metric: MetricOption = None,
    groups: Groups = "image",
    save: Annotated[
        Path | None,
        typer.Option(
            "--save",
            metavar="DIR",
            help="Folder for a report and pictures; for TuSimple also for predictions.json.",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Score a model on labelled images, with 95 % confidence intervals."""
    import json

    from yolino.cli.labels import Selection, open_or_tell
    from yolino.cli.metrics import build_metric
    from yolino.cli.screen import track
    from yolino.datasets.grouping import grouping
    from yolino.evaluate import evaluate as run
    from yolino.evaluate import label_map, point_radius, write_report
    from yolino.inference import EngineChoice, Predictor

    group = None if groups == "image" else grouping(groups)
    predictor = Predictor(EngineChoice(engine, device, precision).open(model), threshold=threshold, flip=flip)
    chosen = Selection(data, split, dataset, root, labels or (), option or (), skip_broken)
    samples = open_or_tell(chosen, classes=predictor.header.classes)
    if option_of_metric and not metric:
        raise ValueError("--set is for the arguments of a metric: name it with --metric.")
    names = predictor.header.classes
    offered = {
        "directed": predictor.header.directed and samples.directed and not undirected,
        "classes": names if label_map(samples.classes, names) is not None else None,
        "radius": point_radius(predictor.header),
    }
    wanted = {"radius": radius}
    if radius is not None and not metric:
        raise ValueError("--radius is for a metric: name it with --metric.")
    metrics = {
        name: build_metric(name, offered, option_of_metric or (), wanted=wanted) for name in metric or ()
    }
    found = run(
        predictor,
        samples,
        metrics=metrics or None,
        groups=group,
        save=save,
        progress=lambda indices: track(indices, "evaluating"),
    )
    title = f"{predictor.header.name} on {data or dataset or 'tusimple'}{f' ({split})' if split else ''}"
    if save is not None:
        write_report(save, found, title=title, facts=_facts(str(model), predictor, groups))
    if as_json:
        typer.echo(json.dumps(_as_object(found)))
        return
    _print(found, title)
    if save is not None:
        typer.echo(f"Details are in {save / 'report.html'}.")


def _as_object(found: Evaluation) -> dict[str, Any]:
    """Gives what is printed as JSON."""
    intervals = {name: list(interval) for name, interval in found.intervals.items()}
    confusion = {
        "classes": found.classes,
        "confusion": found.confusion,
        "line_confusion": found.line_confusion,
    }
    return {**found.scores, "intervals": intervals, **(confusion if found.classes else {})}


def _print(found: Evaluation, title: str) -> None:
    """Prints the scores, and where classes were compared those of each class and what was taken for what."""
    from yolino.cli.screen import print_table
    from yolino.evaluate import CLASS_COLUMNS, SCORE_COLUMNS, class_rows, confusion_tables, score_rows

    print_table(SCORE_COLUMNS, score_rows(found), title=title)
    if found.classes:
        print_table(CLASS_COLUMNS, class_rows(found), title="Classes")
    for name, columns, rows in confusion_tables(found):
        print_table(columns, rows, title=name)


def _facts(model: str, predictor: Predictor, groups: str) -> list[str]:
    from importlib.metadata import version

    mirrored = ", each image and its mirror image" if predictor.flip else ""
    return [
        f"Model: {model} with {predictor.engine.name} ({predictor.engine.device}){mirrored}",
        f"Segments with a score of at least {predictor.threshold:g}",
        f"Intervals: percentile bootstrap, 1,000 draws of {drawn_for_intervals(groups)}",
        f"yolino {version('yolino')}",
    ]
