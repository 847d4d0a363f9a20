"""`yolino warmup`: compiles ahead, for images of containers and continuous integration."""

from __future__ import annotations

from typing import Annotated

import typer

from yolino.cli.options import Model

EPILOG = """
**Examples**

- `yolino warmup` compiles what the default model needs, which its first video would else wait for

- `yolino warmup --model highway.onnx` does so for another model

- `NUMBA_CACHE_DIR=/opt/kernels yolino warmup` keeps the result there; later runs need the same variable
"""


def add_to(app: typer.Typer) -> None:
    """Adds the command."""
    app.command(epilog=EPILOG)(warmup)


def warmup(
    *,
    model: Model = "default",
    processes: Annotated[
        int, typer.Option("--processes", min=1, metavar="N", help="Processes that compile at once.")
    ] = 2,
) -> None:
    """Compile the post-processing now, not when much work is waiting; it is kept on disk."""
    import time

    from yolino.cli.screen import progress
    from yolino.inference.warming import check_kept, compile_ahead

    start = time.perf_counter()
    with progress("compiling") as show:
        for share in compile_ahead(model, processes=processes):
            show(share)
    seconds = time.perf_counter() - start
    typer.echo(f"All kernels are compiled and kept on disk, below {check_kept()} ({seconds:.0f} s).")
