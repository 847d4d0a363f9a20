from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from yolino.inference.warming import compile_ahead

from .conftest import Run

_COUNT = """
import sys
from numba.core import event
from yolino.cli import main
with event.install_recorder("numba:compile") as compiled:
    code = main(sys.argv[1:])
print(code, len(compiled.buffer))
"""


def test_after_the_warm_up_nothing_is_compiled(run: Run, model: Path, photo: Path) -> None:
    code, out, err = run("warmup", "--model", model, "--processes", 1)
    assert (code, err) == (0, "")
    assert out.startswith("All kernels are compiled and kept on disk")
    command = [sys.executable, "-c", _COUNT, "predict", str(photo), "--model", str(model)]
    variables = {**os.environ, "YOLINO_KERNELS": "compiled"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=variables)
    assert (done.stdout.splitlines()[-1], done.stderr) == ("0 0", "")


def test_mistakes_are_told_before_anything_is_compiled(run: Run, make_model: Callable[..., Path]) -> None:
    code, _, err = run("warmup", "--model", "nothing.onnx")
    assert (code, err) == (
        2,
        "Error: The model nothing.onnx does not exist; give a model file or 'default'.\n",
    )
    with pytest.raises(ValueError, match="processes is 0, but must be at least 1"):
        next(compile_ahead(processes=0))
