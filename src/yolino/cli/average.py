"""`yolino average`: several checkpoints in, the checkpoint of their mean weights out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from yolino.cli.options import SkipBroken

if TYPE_CHECKING:
    from yolino.training.averaging import Averaged

EPILOG = """
**Examples**

- `yolino train lanes.yaml name=more_1 training.start_from=runs/lanes/last.safetensors training.seed=1
  training.steps=2500` trains on from a finished run; the same with seed 2, and so on

- `yolino average runs/lanes/last.safetensors runs/more_1/last.safetensors runs/more_2/last.safetensors
  --out lanes.safetensors` averages them, and scores each and the average on the validation data

- `yolino average a.safetensors b.safetensors --config lanes.yaml data.root=data --out c.safetensors` names
  the experiment file, where it does not lie beside the first checkpoint
"""


def add_to(app: typer.Typer) -> None:
    """Adds the command."""
    app.command(epilog=EPILOG)(average)


def average(
    checkpoints: Annotated[
        list[str],
        typer.Argument(
            metavar="CHECKPOINT... [KEY=VALUE]...",
            help="Checkpoints of runs that began from one checkpoint, and values that replace those of the "
            "experiment file.",
            show_default=False,
        ),
    ],
    *,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="The checkpoint to write.")],
    config: Annotated[
        Path | None,
        typer.Option(
            "--config",
            metavar="CONFIG.yaml",
            help="Experiment file with the data.",
            show_default="the one beside the first checkpoint",
        ),
    ] = None,
    images: Annotated[
        int,
        typer.Option("--images", min=1, help="Training images to measure the features' mean and spread on."),
    ] = 960,
    skip_broken: SkipBroken = False,
) -> None:
    """Average the weights of several trainings; needs `pip install 'yolino[train]'`.

    The average of networks that began from one checkpoint may find more on new images than each of them, at
    no cost in use.
    """
    from yolino.cli.screen import track
    from yolino.training.averaging import average as run

    files = [text for text in checkpoints if "=" not in text or Path(text).is_file()]
    overrides = [text for text in checkpoints if text not in files]
    done = run(
        files,
        out,
        config=config,
        overrides=overrides,
        images=images,
        skip_broken=skip_broken,
        progress=track,
    )
    _print(files, done)


def _print(files: list[str], done: Averaged) -> None:
    """Prints the scores of all, and what to do with the average."""
    from yolino.cli.screen import print_table

    rows = [*zip(files, done.members, strict=True), ("average", done.scores)]
    keys = {"line_f1": "F1 of lines", "threshold": "at score", "f1": "F1 of segments"}
    shown = [[name, *(f"{scores[key]:.3f}" for key in keys)] for name, scores in rows]
    print_table(["On the validation data", *keys.values()], shown)
    best = max(member["line_f1"] for member in done.members)
    if done.scores["line_f1"] < best:
        typer.echo(
            "On these images the best of them finds more than the average; on others it may be different."
        )
    typer.echo(f"The average is {done.path}; `yolino export {done.path}` makes a model that needs no torch.")
