"""`yolino export`: a checkpoint in, a model file out that needs no torch."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

EPILOG = """
**Examples**

- `yolino export runs/tusimple/best.safetensors --out lanes.onnx`

- `yolino predict --model lanes.onnx photo.jpg` uses it
"""


def add_to(app: typer.Typer) -> None:
    """Adds the command."""
    app.command(epilog=EPILOG)(export)


def export(
    checkpoint: Annotated[Path, typer.Argument(metavar="CHECKPOINT", help="File that `yolino train` wrote.")],
    format: Annotated[
        str, typer.Option("--format", "-f", metavar="onnx", help="Format of the model.")
    ] = "onnx",
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="Model file.", show_default="beside the checkpoint"),
    ] = None,
    changes: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Value of the header to change, e.g. postprocess.threshold=0.3.",
        ),
    ] = None,
    compact: Annotated[
        bool, typer.Option("--compact", help="Store the weights in half the bytes; results move by < 0.1 px.")
    ] = False,
) -> None:
    """Export a checkpoint as one file with everything inside; needs `pip install 'yolino[train]'`."""
    from yolino.export import export as run

    written = run(checkpoint, format=format, out=out, changes=changes or [], compact=compact)
    typer.echo(f"{written} ({written.stat().st_size / 1e6:.1f} MB)")
