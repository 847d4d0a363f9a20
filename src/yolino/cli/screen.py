"""What the commands show: results on stdout, progress and complaints on stderr."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TypeVar

import typer
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table
from rich.text import Text

T = TypeVar("T")
FEW = 3
SHOWN_ROWS = 20
MISTAKE = 2


def track(items: Sequence[T], title: str) -> Iterator[T]:
    """Yields `items` under a progress bar on stderr, if there are more than a few and somebody watches."""
    console = Console(stderr=True)
    if len(items) <= FEW or not console.is_terminal:
        yield from items
        return
    columns = (TextColumn(title), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        yield from progress.track(items)


@contextlib.contextmanager
def progress(title: str) -> Iterator[Callable[[float], None]]:
    """Gives what shows the share that is done, as a bar on stderr, if somebody watches."""
    console = Console(stderr=True)
    columns = (TextColumn(title), SpinnerColumn(), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda share: bar.update(task, completed=share)


def counted(title: str) -> Callable[[Iterable[T]], Iterator[T]]:
    """Gives what yields items whose number is not known, and counts them on stderr if somebody watches."""
    return lambda items: _count(items, title)


def _count(items: Iterable[T], title: str) -> Iterator[T]:
    console = Console(stderr=True)
    if not console.is_terminal:
        yield from items
        return
    columns = (SpinnerColumn(), TextColumn(title), TextColumn("{task.completed:.0f}"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        yield from progress.track(items, total=None)


@contextlib.contextmanager
def busy(what: str, *, long: bool = False) -> Iterator[None]:
    """Says on stderr what takes its time, as long as it does and if somebody watches.

    Args:
        what: What takes its time.
        long: Whether it takes so long that a file or a pipe is told, too, in a line.
    """
    console = Console(stderr=True)
    if not console.is_terminal:
        if long:
            typer.echo(f"{what} ...", err=True)
        yield
        return
    with console.status(what):
        yield


def print_table(
    header: Sequence[str], rows: Iterable[Sequence[object]], *, title: str | None = None, more: int = 0
) -> None:
    """Prints rows on stdout: first column to the left, the others to the right; very many are cut short.

    Args:
        header: Names of the columns.
        rows: The rows.
        title: Stands above the table.
        more: How many rows there are beyond those given.
    """
    every = list(rows)
    table = Table(title=title, title_justify="left", title_style="bold")
    for i, name in enumerate(header):
        table.add_column(name, justify="right" if i else "left", overflow="fold")
    for row in every[:SHOWN_ROWS]:
        table.add_row(*(Text(str(cell)) for cell in row))
    if more := more + max(len(every) - SHOWN_ROWS, 0):
        table.add_row(f"... and {more} more")
    Console().print(table)


@contextlib.contextmanager
def report_problems(problems: Sequence[str]) -> Iterator[None]:
    """Prints the problems that gather in the block, a line each on stderr, then ends with exit code 2.

    They are told even where the block fails.
    """
    try:
        yield
    finally:
        for problem in problems:
            typer.echo(f"Error: {problem}", err=True)
    if problems:
        raise typer.Exit(MISTAKE)


__all__ = [
    "FEW",
    "MISTAKE",
    "SHOWN_ROWS",
    "busy",
    "counted",
    "print_table",
    "progress",
    "report_problems",
    "track",
]
