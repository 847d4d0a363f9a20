"""The command line: `yolino predict | train | sweep | evaluate | diagnose | tune | score | export | ...`.

Each command is one file. What a command needs is imported when it runs, so that `yolino --help` is fast and
detecting never loads torch.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Annotated

import typer

from yolino.cli import (
    average,
    benchmark,
    datasets,
    diagnose,
    evaluate,
    export,
    predict,
    score,
    sweep,
    train,
    tune,
    warmup,
)

_MISTAKE, _BUG = 2, 3

app = typer.Typer(
    name="yolino",
    help="Detect polylines of any shape in images: one network pass, vectors out.",
    epilog="Begin with `yolino predict photo.jpg`; `yolino COMMAND --help` shows examples.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool | None) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"yolino {version('yolino')}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool | None,
        typer.Option("--version", help="Print the version and stop.", callback=_print_version, is_eager=True),
    ] = None,
) -> None:
    import logging

    logging.basicConfig(level=logging.WARNING, format="%(levelname)s: %(message)s")


_COMMANDS = (
    predict,
    train,
    sweep,
    average,
    evaluate,
    diagnose,
    tune,
    score,
    export,
    datasets,
    benchmark,
    warmup,
)
for _command in _COMMANDS:
    _command.add_to(app)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line and gives its exit code: 0, or 2 after a mistake, told in one line on stderr.

    Args:
        arguments: What stands after `yolino`; the arguments of the process by default.
    """
    try:
        app(args=None if arguments is None else list(arguments), prog_name="yolino")
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else int(stop.code is not None)
    except (ValueError, OSError, ModuleNotFoundError, MemoryError) as error:
        typer.echo(f"Error: {_explain(error)}", err=True)
        return _MISTAKE
    except Exception as error:
        if "YOLINO_TRACEBACK" in os.environ:
            raise
        typer.echo(
            f"Error: {type(error).__name__}: {_explain(error)} This is a bug in yolino: please report it "
            "with what the same command prints when YOLINO_TRACEBACK=1 is set.",
            err=True,
        )
        return _BUG
    return 0


_EXTRAS = {"rasterio": "geo", "pyogrio": "geo", "pyarrow": "geo", "skimage": "masks", "av": "video"}
_EXTRAS |= {"openvino": "openvino", "nncf": "quantize", "matplotlib": "plot"}


def _explain(error: BaseException) -> str:
    """Gives the sentence that a user reads: one line, with the file and what to do where that is known."""
    text = " ".join(str(error).split())
    if isinstance(error, OSError) and error.strerror and error.filename is not None:
        return f"{error.filename}: {error.strerror}."
    if isinstance(error, ModuleNotFoundError) and error.name and not error.name.startswith("yolino"):
        extra = _EXTRAS.get(error.name, "train")
        return f"This needs the package {error.name}, which is not installed: pip install 'yolino[{extra}]'."
    if isinstance(error, MemoryError):
        return f"There is not enough memory. {text}".strip()
    return text or type(error).__name__


__all__ = ["app", "main"]
