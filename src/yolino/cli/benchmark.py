"""`yolino benchmark`: how fast it is on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from yolino.cli.options import AsJson, Device, Engine, Model, Precision

# The names in `yolino.benchmark.SECTIONS`, here so that --help loads nothing; a test compares them.
SECTIONS = (
    *("stages", "roofline", "engines", "paper", "files", "video", "darknet19", "nms", "linking", "linkers"),
    *("discretize", "points", "matching", "training", "loading", "growth", "startup", "install"),
)
EPILOG = """
**Examples**

- `yolino benchmark` measures everything beside other implementations, for some minutes

- `yolino benchmark --only stages --json` measures the steps of one frame, prints one JSON object

- `yolino benchmark --from result.json --plot pictures` draws what an earlier run printed with `--json`
"""


def add_to(app: typer.Typer) -> None:
    """Adds the command."""
    app.command(epilog=EPILOG)(benchmark)


def benchmark(
    *,
    model: Model = "default",
    engine: Engine = "auto",
    device: Device = "auto",
    precision: Precision = "auto",
    only: Annotated[
        list[str] | None,
        typer.Option(
            "--only",
            metavar="SECTION",
            help=f"Part of the benchmark; may be repeated. One of {', '.join(SECTIONS)}.",
            show_default="all",
        ),
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
    saved: Annotated[
        Path | None,
        typer.Option("--from", metavar="FILE", help="Measure nothing: take what --json printed before."),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option("--plot", metavar="DIR", help="Draw the result, as PNG files in a folder.")
    ] = None,
    short: Annotated[
        bool, typer.Option("--summary", help="Print the most telling numbers only, as one table.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Measure the speed of a model and of each step on this machine, beside other implementations."""
    import json

    from yolino.benchmark import benchmark as run
    from yolino.benchmark import plot as draw
    from yolino.benchmark import read_result, report, summary
    from yolino.benchmark.plot import check_plot
    from yolino.benchmark.run import chosen_sections
    from yolino.cli.screen import track

    if short and as_json:
        raise ValueError("--summary and --json exclude each other: leave one out.")
    if plot is not None:  # not after minutes of measuring
        check_plot(plot, None if saved else chosen_sections(only), quick=quick)
    if saved is not None:
        if only or image or threads or quick:
            raise ValueError("--from measures nothing: leave out --only, --image, --threads and --quick.")
        result = read_result(saved)
    else:
        result = run(
            model,
            device,
            engine=engine,
            precision=precision,
            repeats=repeats,
            image=image,
            only=only or None,
            threads=threads,
            quick=quick,
            progress=lambda names: track(names, "measuring"),
        )
    typer.echo(json.dumps(result) if as_json else summary(result) if short else report(result))
    if plot is not None:
        for path in draw(result, plot):
            typer.echo(f"Wrote {path}", err=True)
