from __future__ import annotations

import os
import subprocess
import sys
import types
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
import typer

from yolino.cli import app
from yolino.cli.screen import track

from .conftest import Run

COMMANDS = tuple(typer.main.get_command(app).commands)  # type: ignore[attr-defined]


def test_help_names_the_commands(run: Run) -> None:
    code, out, err = run("--help")
    assert (code, err) == (0, "")
    assert len(COMMANDS) >= 12
    assert all(command in out for command in COMMANDS)
    assert "yolino predict photo.jpg" in out


@pytest.mark.parametrize(
    "command", [[c] for c in COMMANDS] + [["datasets", c] for c in ("check", "show", "deviation")]
)
def test_help_of_every_command_shows_an_example(run: Run, command: list[str]) -> None:
    code, out, _ = run(*command, "--help")
    assert code == 0
    assert f"yolino {command[0]} " in out.partition("Example")[2]


def test_help_of_evaluate_says_for_what_predictions_are_written(run: Run) -> None:
    _, out, _ = run("evaluate", "--help")
    words = " ".join(out.replace("│", " ").split())
    assert "for TuSimple also for predictions.json" in words


def test_the_version_is_printed(run: Run) -> None:
    assert run("--version") == (0, f"yolino {version('yolino')}\n", "")


def test_an_unknown_command_is_a_mistake(run: Run) -> None:
    code, _, err = run("detect", "photo.jpg")
    assert code == 2
    assert "No such command 'detect'" in err


@pytest.fixture
def broken_export(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Makes `yolino export` raise what it is given."""

    def replace(error: BaseException) -> None:
        def export(*arguments: object, **options: object) -> None:
            raise error

        module = types.ModuleType("yolino.export")
        module.export = export  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, "yolino.export", module)

    return replace


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (ValueError("two\n  lines"), "two lines"),
        (FileNotFoundError(2, "No such file or directory", "x.ckpt"), "x.ckpt: No such file or directory."),
        (PermissionError("no."), "no."),
        (
            OSError(28, "No space left on device", "runs/last.ckpt"),
            "runs/last.ckpt: No space left on device.",
        ),
        (
            ModuleNotFoundError("No module named 'torch'", name="torch"),
            "This needs the package torch, which is not installed: pip install 'yolino[train]'.",
        ),
        (MemoryError(), "There is not enough memory."),
        (ValueError(), "ValueError"),
    ],
)
def test_mistakes_are_one_line_and_exit_code_2(
    run: Run, broken_export: Any, error: BaseException, message: str
) -> None:
    broken_export(error)
    assert run("export", "x.ckpt") == (2, "", f"Error: {message}\n")


def test_bugs_are_one_line_too_but_another_exit_code(
    run: Run, broken_export: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken_export(KeyError("oops"))
    code, out, err = run("export", "x.ckpt")
    assert (code, out) == (3, "")
    assert err.startswith("Error: KeyError: 'oops' This is a bug in yolino: please report it")
    assert err.count("\n") == 1
    monkeypatch.setenv("YOLINO_TRACEBACK", "1")
    with pytest.raises(KeyError):
        run("export", "x.ckpt")


def test_export_and_train_pass_on_what_they_are_told(
    run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    calls: list[Any] = []

    def record(result: Any) -> Any:
        def call(*arguments: object, **options: object) -> Any:
            calls.append((arguments, options))
            return result

        return call

    written = tmp_path / "model.onnx"
    written.write_bytes(bytes(2_500_000))
    done = types.SimpleNamespace(files=(written,), size=2_500_000)
    for name, function, result in (
        ("yolino.export", "export", done),
        ("yolino.training.run", "train", Path("runs/x/best.safetensors")),
    ):
        module = types.ModuleType(name)
        setattr(module, function, record(result))
        monkeypatch.setitem(sys.modules, name, module)
    code, out, _ = run("export", "best.safetensors", "--out", "model.onnx")
    assert code == 0
    assert "model.onnx (2.5 MB)" in out
    code, out, _ = run("train", "config.yaml", "name=x", "training.steps=5", "--no-progress")
    assert code == 0
    assert "yolino export runs/x/best.safetensors" in out
    passed = {"format": "onnx", "precision": None, "out": Path("model.onnx"), "changes": []}
    assert calls[0][1].pop("progress") is track
    assert calls == [
        (("best.safetensors",), {**passed, "calibration": None}),
        ((Path("config.yaml"), ["name=x", "training.steps=5"]), {"progress": False, "skip_broken": False}),
    ]


def test_help_is_fast_and_loads_no_numpy(tmp_path: Path) -> None:
    code = (
        "import sys; from yolino.cli import main; main(['predict', '--help']);"
        "assert not {'numpy', 'cv2', 'torch', 'onnxruntime', 'numba'} & set(sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_program_predicts_one_image_with_what_that_needs_and_says_nothing_else(
    model: Path, photo: Path, tmp_path: Path
) -> None:
    """The whole thing as a user runs it; `-X importtime` names every module that is loaded."""
    command = [
        sys.executable,
        "-X",
        "importtime",
        "-m",
        "yolino.cli",
        "predict",
        str(photo),
        "--model",
        str(model),
    ]
    variables = {key: value for key, value in os.environ.items() if key != "YOLINO_KERNELS"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path, env=variables)
    assert done.returncode == 0, done.stderr.splitlines()[-1]
    assert (tmp_path / "yolino-out" / "photo.json").is_file()
    lines = done.stderr.splitlines()
    assert all(line.startswith("import time:") for line in lines)
    loaded = {line.rpartition("|")[2].strip() for line in lines}
    assert {"cv2", "yolino.inference.engines", "yolino.postprocess"} <= loaded
    assert not {"torch", "torchvision", "lightning", "sklearn", "onnx", "matplotlib"} & loaded
    assert (
        not {"numba", "llvmlite", "scipy", "openvino", "yolino.datasets", "yolino.metrics", "yaml"} & loaded
    )
