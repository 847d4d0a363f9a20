"""`yolino train`: an experiment file in, a checkpoint out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from yolino.cli.options import SkipBroken

EPILOG = """
**Examples**

- `yolino train configs/tusimple.yaml` trains, or goes on where a stopped run of the same name was

- `yolino train configs/tusimple.yaml name=trial training.steps=500` changes values of the file
"""


def add_to(app: typer.Typer) -> None:
    """Adds the command."""
    app.command(epilog=EPILOG)(train)


def train(
    config: Annotated[Path, typer.Argument(metavar="CONFIG.yaml", help="Experiment file.")],
    overrides: Annotated[
        list[str] | None,
        typer.Argument(metavar="[KEY=VALUE]...", help="Values that replace those of the file."),
    ] = None,
    skip_broken: SkipBroken = False,
    progress: Annotated[
        bool, typer.Option("--progress/--no-progress", help="Whether to show a bar with the remaining time.")
    ] = True,
) -> None:
    """Train a model; needs `pip install 'yolino[train]'`."""
    import logging

    from yolino.training.run import train as run

    logging.getLogger("yolino").setLevel(logging.INFO)
    best = run(config, overrides or [], progress=progress, skip_broken=skip_broken)
    typer.echo(f"The best checkpoint is {best}; `yolino export {best}` makes a model that needs no torch.")
