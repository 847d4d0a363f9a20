"""`yolino sweep`: several experiments in, one table out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from yolino.cli.options import SkipBroken

if TYPE_CHECKING:
    from yolino.sweep import Sweep

FAILED = 1

EPILOG = """
**What a sweep is**

A folder of experiment files. Each file is a row of the table; a file may begin with `base: other.yaml` and
hold only what is different. A file `sweep.yaml` may put the rows into groups and hold numbers to compare
with. Runs are made one after the other. Stop it at any time: the same command goes on where it was.

**Examples**

- `yolino sweep configs/paper data.root=data --dry-run` lists the runs, and which of them lack their data

- `yolino sweep configs/paper data.root=data` makes the paper's table, and the curves of all runs, in
  runs/sweep

- `yolino sweep configs/paper data.root=data model.backbone=residual training.steps=1500 --out runs/small`
  does it with a small network: each KEY=VALUE changes all rows

- `yolino sweep configs/paper data.root=data --only po_8_16px --only eu_8_16px --seeds 0,1` runs two rows,
  twice each

- `yolino sweep configs/paper --out runs/small --table` writes the table anew from the runs that are finished
"""


def add_to(app: typer.Typer) -> None:
    """Adds the command."""
    app.command(epilog=EPILOG)(sweep)


def sweep(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder of experiment files.")],
    overrides: Annotated[
        list[str] | None,
        typer.Argument(metavar="[KEY=VALUE]...", help="Values that replace those of all files."),
    ] = None,
    *,
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder of the runs and the table.")
    ] = Path("runs/sweep"),
    only: Annotated[
        list[str] | None,
        typer.Option("--only", metavar="ROW", help="Run this row only; may be repeated.", show_default="all"),
    ] = None,
    seeds: Annotated[
        str | None,
        typer.Option(
            "--seeds", metavar="0,1,...", help="Run each row with each seed.", show_default="the files'"
        ),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="List the runs and what is missing; run nothing.")
    ] = False,
    table: Annotated[
        bool, typer.Option("--table", help="Run nothing: write the table of the finished runs.")
    ] = False,
    skip_broken: SkipBroken = False,
    progress: Annotated[
        bool, typer.Option("--progress/--no-progress", help="Whether each run shows a bar, too.")
    ] = True,
) -> None:
    """Train several experiments, score each, write one table; needs `pip install 'yolino[train,plot]'`."""
    import sys

    from yolino.sweep import load_sweep, plan, prospects, run_sweep

    found = load_sweep(folder)
    if table:
        if overrides or only or seeds or dry_run:
            raise ValueError("--table runs nothing: leave out KEY=VALUE, --only, --seeds and --dry-run.")
        if not out.is_dir():
            raise FileNotFoundError(f"There is no folder {out}: name that of a sweep with --out.")
        _show(found, out)
        return
    jobs = plan(found, overrides or (), out, only=only or (), seeds=_numbers(seeds))
    ready = prospects(jobs, skip_broken=skip_broken)
    if dry_run:
        for number, each in enumerate(ready, 1):
            job = each.job
            steps = job.experiment.training.steps
            typer.echo(f"[{number} of {len(ready)}] {job.row}, seed {job.seed}, {steps} steps: {each.state}")
        return
    outcome = run_sweep(
        found,
        ready,
        out,
        say=lambda text: typer.echo(text, err=True),
        bar=progress and sys.stderr.isatty(),
        skip_broken=skip_broken,
    )
    _show(found, out)
    for name, problem in outcome.failed.items():
        typer.echo(f"Error: {name} {problem} Details are in {out}/runs/{name}/problem.txt.", err=True)
    if outcome.failed:
        raise typer.Exit(FAILED)


def _numbers(text: str | None) -> list[int]:
    """Reads `0,1,2`."""
    if text is None:
        return []
    parts = text.split(",")
    if not all(part.strip().isdecimal() for part in parts):
        raise ValueError(f"--seeds is {text!r}, but must be whole numbers with commas between: 0,1,2.")
    return [int(part) for part in parts]


def _show(found: Sweep, out: Path) -> None:
    """Writes and prints the table, and draws the curves where that can be done."""
    import importlib.util

    from yolino.cli.screen import print_table
    from yolino.sweep import cells, draw_curves, facts, heading, legend, notes, read_rows, write_tables

    write_tables(found, out)
    rows = read_rows(found, out)
    shown = [cells(found, rows, name) for name, row in rows.items() if row.results]
    if shown:
        print_table(heading(found, rows), shown, title=found.layout.title)
        typer.echo(legend(found, rows))
    for line in (*facts(found, rows), *notes(rows)):
        typer.echo(line)
    written = [out / f"table.{suffix}" for suffix in ("md", "csv", "json")]
    if importlib.util.find_spec("matplotlib") is None:
        typer.echo("curves.png needs the package matplotlib: pip install 'yolino[plot]'.", err=True)
    elif (curves := draw_curves(found, rows, out)) is not None:
        written.append(curves)
    typer.echo(f"Wrote {', '.join(map(str, written))}.", err=True)
