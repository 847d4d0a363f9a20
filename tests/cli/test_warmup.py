from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from yolino.inference import warming
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


@pytest.fixture(autouse=True)
def _free(monkeypatch: pytest.MonkeyPatch) -> None:
    """The variables of whoever runs the tests decide nothing."""
    monkeypatch.delenv("YOLINO_KERNELS", raising=False)


def test_after_the_warm_up_nothing_is_compiled(run: Run, model: Path, photo: Path) -> None:
    code, out, err = run("warmup", "--model", model, "--processes", 1)
    assert (code, err) == (0, "")
    told = re.fullmatch(r"All kernels are compiled and kept on disk, below (.+) \(\d+ s\)\.\n", out)
    assert told is not None
    assert list(Path(told[1]).glob("postprocess*/**/*suppress*.nbi"))
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


def test_a_folder_that_cannot_be_written_is_told_before_anything_is_compiled(model: Path) -> None:
    folder = model / "kernels"  # below a file, so nobody can make it
    command = [sys.executable, "-c", _COUNT, "warmup", "--model", str(model)]
    variables = {**os.environ, "NUMBA_CACHE_DIR": str(folder)}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=variables)
    assert done.stdout == "2 0\n"
    assert done.stderr == (
        f"Error: Kernels cannot be kept in {folder}, which NUMBA_CACHE_DIR names, because it cannot be "
        "written: name another folder.\n"
    )


def test_kernels_that_were_not_kept_are_told(
    run: Run, model: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(warming, "are_kept", lambda: False)
    monkeypatch.setattr(warming, "_find_place", lambda: tmp_path)
    monkeypatch.setattr(warming, "JOBS", ())
    code, out, err = run("warmup", "--model", model, "--processes", 1)
    assert (code, out) == (2, "")
    assert err == (
        f"Error: The kernels are compiled, but were not kept in {tmp_path}: "
        "name another folder in NUMBA_CACHE_DIR.\n"
    )


def test_kernels_that_are_never_used_are_not_compiled(
    run: Run, model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("YOLINO_KERNELS", "interpreted")
    assert run("warmup", "--model", model) == (
        2,
        "",
        "Error: YOLINO_KERNELS is 'interpreted', so compiled kernels would never be used: unset it first.\n",
    )
