"""`yolino tune`: a model and labelled images in, a model with a better threshold, NMS and linker out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from yolino.cli.options import (
    AsJson,
    Data,
    DatasetName,
    Device,
    Engine,
    Labels,
    More,
    Precision,
    Root,
    SkipBroken,
    Split,
)

if TYPE_CHECKING:
    from yolino.header import Header
    from yolino.tuning import Tuning

EPILOG = """
**Examples**

- `yolino tune lanes.onnx --data drive.yaml --split val --out tuned.onnx` writes the model with new settings,
  and says what to expect of them on other images

- `yolino tune lanes.onnx --data drive.yaml --split val` prints them as the `postprocess:` section of an
  experiment file

- `yolino tune default --data drive.yaml --only threshold --only nms.epsilon` changes nothing else

- `yolino tune lanes.onnx --data photos/ --linker graph --metric f1 --json` takes another linker and metric
"""


def add_to(app: typer.Typer) -> None:
    """Adds the command."""
    app.command(epilog=EPILOG)(tune)


def tune(
    model: Annotated[
        str, typer.Argument(metavar="MODEL", help="A model file, or a packaged model ('default').")
    ],
    *,
    data: Data = None,
    split: Split = None,
    dataset: DatasetName = None,
    root: Root = None,
    labels: Labels = None,
    option: More = None,
    skip_broken: SkipBroken = False,
    metric: Annotated[
        str | None,
        typer.Option(
            "--metric",
            metavar="NAME",
            help="What to make large: lanes (accuracy - FP / 2 - FN / 2), accuracy, f1, or another metric.",
            show_default="lanes for TuSimple, else f1",
        ),
    ] = None,
    linker: Annotated[
        str | None,
        typer.Option("--linker", metavar="NAME", help="Another linker.", show_default="the model's"),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(
            "--only", metavar="NAME", help="Parameter to change; may be repeated; an unknown one lists them."
        ),
    ] = None,
    trials: Annotated[int, typer.Option("--trials", min=1, help="Settings that a search tries.")] = 400,
    folds: Annotated[
        int, typer.Option("--folds", min=2, help="Blocks of images for the cross-validation.")
    ] = 5,
    groups: Annotated[
        str,
        typer.Option(
            "--groups",
            metavar="auto|image|folder|N|regex:...",
            help="Which images stay in one block: those of a clip, of a folder, of the first N folders.",
        ),
    ] = "auto",
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of everything random.")] = 0,
    engine: Engine = "auto",
    device: Device = "auto",
    precision: Precision = "auto",
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="Model file to write, with the suffix of MODEL.",
            show_default="the settings are printed as YAML",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Choose a model's threshold, NMS and linker parameters on labelled images."""
    from yolino.cli.labels import Selection, open_or_tell
    from yolino.cli.screen import progress, track
    from yolino.inference import EngineChoice, Predictor
    from yolino.inference.loading import model_path
    from yolino.tuning import Options, with_header
    from yolino.tuning import tune as run

    options = Options(metric, linker, tuple(only or ()), trials, folds, groups, seed)
    path = model_path(model)
    _check_out(out, path)
    predictor = Predictor(EngineChoice(engine, device, precision).open(model))
    if out is not None:
        with_header(path, predictor.header)  # says before the work if the file has no place for another
    if data is None and dataset is None and root is None and not labels:
        raise ValueError("Tuning needs labelled images: name them with --data, or with --dataset and --root.")
    samples = open_or_tell(Selection(data, split, dataset, root, labels or (), option or (), skip_broken))
    with progress("tuning") as share:
        found = run(
            predictor, samples, options, progress=lambda indices: track(indices, "detecting"), share=share
        )
    source = f"{data or dataset or root or 'tusimple'}{f' ({split})' if split else ''}"
    if out is not None:
        _write(path, out, predictor.header, found, source)
    _show(found, source, out, as_json=as_json)


def _check_out(out: Path | None, path: Path) -> None:
    """Says before the work what could not be written after it."""
    if out is not None and out.suffix.lower() != path.suffix.lower():
        raise ValueError(
            f"The file {out} must end in {path.suffix}, as {path.name} does: `yolino export` converts models."
        )
    if out is not None and out.is_dir():
        raise ValueError(f"{out} is a folder: name the model file to write.")


def _write(path: Path, out: Path, header: Header, found: Tuning, source: str) -> None:
    from yolino.export.pairs import write_pair
    from yolino.io import write_atomic
    from yolino.tuning import tuned_header, with_header

    content = with_header(path, tuned_header(header, found, source))
    if path.suffix.lower() == ".xml":
        write_pair(out, content, path.with_suffix(".bin").read_bytes())
    else:
        write_atomic(out, content)


def _show(found: Tuning, source: str, out: Path | None, *, as_json: bool) -> None:
    import json

    import yaml

    from yolino.cli.screen import print_table
    from yolino.tuning import facts, parameter_rows, score_rows, summary

    if as_json:
        changes = {one.name: vars(one) for one in found.changes}
        values = {"postprocess": found.postprocess, "changes": changes, "settings": found.settings}
        typer.echo(json.dumps({**facts(found, source), **values}))
        return
    rows = parameter_rows(found)
    if rows:
        print_table(("parameter", "before", "after", "alone gives", "without it lost"), rows)
    head = (f"{found.objective.name} of {source}", "before", "tuned", "cross-validated")
    print_table(head, score_rows(found))
    typer.echo(f"The objective is {found.objective.meaning}; {found.settings} settings were scored.")
    for sentence in summary(found):
        typer.echo(sentence)
    if out is None:
        typer.echo(yaml.safe_dump({"postprocess": dict(found.postprocess)}, sort_keys=False), nl=False)
    else:
        typer.echo(f"The model with the new settings is {out}.")
