"""`yolino diagnose`: a model and a labelled dataset in, what limits the model out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from yolino.cli.options import (
    AsJson,
    Data,
    DatasetName,
    Device,
    Engine,
    Groups,
    Labels,
    More,
    Precision,
    Root,
    SkipBroken,
    Split,
    Threshold,
    drawn_for_intervals,
)

if TYPE_CHECKING:
    from yolino.datasets import Dataset
    from yolino.evaluate.diagnosis import Diagnosis

EPILOG = """
**Examples**

- `yolino diagnose --data drive.yaml --split val --prior train` says what limits the packaged model on the
  split val, beside what the lines of the split train are worth without any image

- `yolino diagnose best.safetensors --data drive.yaml --split val --save why` also writes why/report.html
  with pictures of the images that lose most
"""


def add_to(app: typer.Typer) -> None:
    """Adds the command."""
    app.command(epilog=EPILOG)(diagnose)


def diagnose(
    model: Annotated[
        str, typer.Argument(metavar="MODEL", help="A packaged model, or a model file.")
    ] = "default",
    *,
    data: Data = None,
    split: Split = None,
    dataset: DatasetName = None,
    root: Root = None,
    labels: Labels = None,
    option: More = None,
    skip_broken: SkipBroken = False,
    prior: Annotated[
        str | None,
        typer.Option(
            "--prior",
            metavar="SPLIT|FILE|DIR",
            help="Training labels, for a row without any image: a split of --data, or labels of any format.",
        ),
    ] = None,
    threshold: Threshold = None,
    engine: Engine = "auto",
    device: Device = "auto",
    precision: Precision = "auto",
    groups: Groups = "image",
    save: Annotated[
        Path | None,
        typer.Option("--save", metavar="DIR", help="Folder for a report and pictures of the worst images."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Find out where a model loses its score: steps are replaced by the truth, one after the other."""
    from yolino.cli.labels import Selection, open_or_tell
    from yolino.cli.screen import track
    from yolino.datasets.grouping import grouping
    from yolino.evaluate.diagnosis import diagnose as run
    from yolino.evaluate.diagnosis_report import write_diagnosis
    from yolino.evaluate.prior import find_prior
    from yolino.inference import EngineChoice, Predictor

    group = None if groups == "image" else grouping(groups)
    predictor = Predictor(EngineChoice(engine, device, precision).open(model), threshold=threshold)
    chosen = Selection(data, split, dataset, root, labels or (), option or (), skip_broken)
    samples = open_or_tell(chosen, classes=predictor.header.classes)
    medoid = None
    if prior is not None:
        medoid = find_prior(
            _training_labels(prior, data), progress=lambda indices: track(indices, "comparing labels")
        )
    found = run(
        predictor,
        samples,
        prior=medoid,
        groups=group,
        progress=lambda indices: track(indices, "diagnosing"),
    )
    title = f"{predictor.header.name} on {data or dataset or 'tusimple'}{f' ({split})' if split else ''}"
    if save is not None:
        facts = _facts(predictor, model, groups, None if medoid is None else medoid.name)
        write_diagnosis(save, found, samples, title=title, facts=facts)
    _print(found, title, save, as_json=as_json)


def _training_labels(prior: str, data: Path | None) -> Dataset:
    """Gives the labels that `--prior` names: a split of the dataset, or a file or folder."""
    from yolino.datasets.description import load_description, open_split
    from yolino.evaluate.score import open_side

    splits = {} if data is None else load_description(data).splits
    if data is not None and prior in splits:
        return open_split(load_description(data), prior)
    if not Path(prior).exists():
        known = f", and no split of {data} ({', '.join(splits) or 'it has none'})" if data else ""
        raise FileNotFoundError(f"--prior {prior!r} is no file or folder{known}: give training labels.")
    return open_side(Path(prior)).samples


def _facts(predictor: Any, model: str, groups: str, prior: str | None) -> list[str]:
    from importlib.metadata import version

    return [
        f"Model: {model} with {predictor.engine.name} ({predictor.engine.device})",
        f"Segments with a score of at least {predictor.threshold:g}",
        *([] if prior is None else [f"No image: the lines of {prior} everywhere"]),
        f"Intervals: percentile bootstrap, 1,000 draws of {drawn_for_intervals(groups)}",
        f"yolino {version('yolino')}",
    ]


def _print(found: Diagnosis, title: str, save: Path | None, *, as_json: bool) -> None:
    import json

    from yolino.cli.screen import print_table
    from yolino.evaluate.diagnosis_report import tables

    if as_json:
        typer.echo(json.dumps(_values(found)))
        return
    typer.echo(title)
    for table in tables(found, brief=True):
        print_table(table.header, table.rows, title=table.title)
    typer.echo(found.verdict)
    if save is not None:
        typer.echo(f"Details are in {save / 'report.html'}.")


def _values(found: Diagnosis) -> dict[str, Any]:
    return {
        "headline": found.headline,
        "images": len(found.names),
        "rows": {row.name: {**row.scores, "intervals": row.intervals} for row in found.rows},
        "losses": {loss.stage: {**loss.values, "intervals": loss.intervals} for loss in found.losses},
        "causes": dict(found.causes),
        "verdict": found.verdict,
    }


__all__ = ["add_to", "diagnose"]
