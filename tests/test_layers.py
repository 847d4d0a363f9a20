"""Who imports whom: the layers of the house, and what an import must not load."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def test_no_layer_imports_one_above_it() -> None:
    pytest.importorskip("importlinter", reason="import-linter is not installed")
    command = [
        sys.executable,
        "-c",
        "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports(no_logo=True))",
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def _loaded_by(statement: str) -> set[str]:
    """Gives the top-level packages that a new interpreter has loaded after `statement`."""
    code = f"import json, sys; {statement}; print(json.dumps(sorted(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return {name.partition(".")[0] for name in json.loads(done.stdout.splitlines()[-1])}


def test_importing_yolino_loads_nothing_heavy() -> None:
    heavy = {
        "torch",
        "torchvision",
        "timm",
        "lightning",
        "numba",
        "scipy",
        "cv2",
        "onnxruntime",
        "sklearn",
        "numpy",
    }
    assert not heavy & _loaded_by("import yolino, yolino.cli")


def test_detecting_needs_no_torch() -> None:
    rooms = ("inference", "postprocess", "metrics", "datasets", "viz", "evaluate", "io", "grid", "config")
    loaded = _loaded_by("import yolino; yolino.load; import " + ", ".join(f"yolino.{room}" for room in rooms))
    assert "cv2" in loaded
    assert not {"torch", "torchvision", "timm", "lightning", "sklearn", "onnx", "safetensors"} & loaded


def test_rooms_of_detecting_and_reading_load_no_compiler_and_no_scipy() -> None:
    """Numba is imported by the first kernel that is compiled, scipy by what needs it."""
    loaded = _loaded_by("import yolino; yolino.load; import yolino.postprocess, yolino.viz, yolino.datasets")
    assert not {"numba", "llvmlite", "scipy"} & loaded
