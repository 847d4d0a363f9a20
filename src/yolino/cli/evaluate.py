"""`yolino evaluate`: a model and a labelled dataset in, scores out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from yolino.cli.options import AsJson, DatasetName, Device, Labels, Model, More, Root, Threshold

EPILOG = """
**Example**

- `yolino evaluate --dataset tusimple --root data/tusimple --labels label_data_0531.json --save scores` prints
  the scores, writes scores/predictions.json (the benchmark's submission file) and pictures of bad images
"""


def add_to(app: typer.Typer) -> None:
    """Adds the command."""
    app.command(epilog=EPILOG)(evaluate)


def evaluate(
    *,
    dataset: DatasetName = "tusimple",
    root: Root = None,
    labels: Labels = None,
    model: Model = "default",
    threshold: Threshold = None,
    device: Device = "auto",
    option: More = None,
    save: Annotated[
        Path | None, typer.Option("--save", metavar="DIR", help="Folder for predictions.json and pictures.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Score a model on labelled images: the TuSimple benchmark's numbers and the paper's."""
    import json

    from yolino.cli.labels import open_dataset
    from yolino.cli.screen import print_table, track
    from yolino.evaluate import evaluate as run
    from yolino.inference import load

    predictor = load(model, device=device, threshold=threshold)
    samples = open_dataset(dataset, root, labels or [], option or [], classes=predictor.header.classes)
    scores = run(predictor, samples, save=save, progress=lambda indices: track(indices, "evaluating"))
    if as_json:
        typer.echo(json.dumps(scores))
        return
    counts = {"images": f"{scores['images']:.0f}", "fps": f"{scores['fps']:.1f}", "ms": f"{scores['ms']:.1f}"}
    rows = [(name.replace("_", " "), counts.get(name, f"{value:.4f}")) for name, value in scores.items()]
    print_table(("score", "value"), rows, title=f"{predictor.header.name} on {dataset}")
    if save is not None:
        typer.echo(f"Details are in {save}.")
