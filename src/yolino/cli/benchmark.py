"""`yolino benchmark`: how fast it is on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from yolino.cli.options import AsJson, Device, Model

EPILOG = """
**Examples**

- `yolino benchmark` measures everything beside other implementations, for some minutes

- `yolino benchmark --only stages --json` measures the steps of one frame, prints one JSON object
"""


def add_to(app: typer.Typer) -> None:
    """Adds the command."""
    app.command(epilog=EPILOG)(benchmark)


def benchmark(
    *,
    model: Model = "default",
    device: Device = "auto",
    only: Annotated[
        list[str] | None,
        typer.Option("--only", metavar="SECTION", help="Part of the benchmark; may be repeated."),
    ] = None,
    repeats: Annotated[int, typer.Option("--repeats", min=1, help="Largest number of rounds.")] = 30,
    threads: Annotated[
        int | None, typer.Option("--threads", min=1, help="Threads.", show_default="all cores")
    ] = None,
    image: Annotated[
        Path | None, typer.Option("--image", metavar="FILE", help="Frame.", show_default="a drawn road")
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Only see that everything runs; the numbers mean nothing.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Measure the speed of a model and of each step on this machine, beside other implementations."""
    import json

    from yolino.benchmark import benchmark as run
    from yolino.benchmark import report
    from yolino.cli.screen import track

    result = run(
        model,
        device,
        repeats=repeats,
        image=image,
        only=only or None,
        threads=threads,
        quick=quick,
        progress=lambda names: track(names, "measuring"),
    )
    typer.echo(json.dumps(result) if as_json else report(result))
