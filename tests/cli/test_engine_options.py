"""`--engine`, `--precision` and `--device` of the commands that run a network."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from striped_model import make_striped_model, striped_header
from yolino.inference import ENGINES
from yolino.inference.engine import DEVICES, PRECISIONS

from .conftest import Run

FOUND = [name for name, kind in ENGINES.items() if kind.missing is None and ".onnx" in kind.suffixes]


@pytest.mark.parametrize("command", ["predict", "evaluate", "benchmark"])
def test_the_help_names_every_choice(run: Run, command: str) -> None:
    code, out, _ = run(command, "--help")
    text = " ".join(out.replace("│", " ").split())
    assert code == 0
    for option in ("--engine", "--precision", "--device"):
        assert option in out
    assert all(name in text for name in ("auto", *ENGINES, *DEVICES, *PRECISIONS))


@pytest.mark.parametrize("engine", FOUND)
def test_engines_give_the_same_lines(run: Run, model: Path, photo: Path, engine: str) -> None:
    assert run("predict", photo, "--model", model, "--engine", engine, "--no-images")[0] == 0
    lines = json.loads(Path("yolino-out/photo.json").read_text())["polylines"]
    assert len(lines) == 2


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            ("--engine", "onnx"),
            "The engine 'onnx' is unknown; did you mean 'onnxruntime'? use auto or one of",
        ),
        (("--engine", "torch"), "The engine torch reads .safetensors files, but the model is"),
        (("--precision", "f16"), "The precision 'f16' is unknown; use one of auto, fp32, bf16, fp16, int8."),
        (("--precision", "int8"), "is not quantized, so it cannot run in int8: write a file that is with"),
        (
            ("--engine", "onnxruntime", "--precision", "bf16"),
            "The engine onnxruntime has no precision 'bf16'",
        ),
        (
            ("--engine", "openvino", "--device", "cuda"),
            "The engine openvino has no device 'cuda'; it has cpu.",
        ),
        (("--device", "gpu"), "The device 'gpu' is unknown; use one of auto, cpu, cuda."),
    ],
)
def test_a_wrong_choice_is_one_line_and_exit_code_2(
    run: Run, model: Path, photo: Path, options: tuple[str, ...], message: str
) -> None:
    code, out, err = run("predict", photo, "--model", model, *options)
    assert (code, out) == (2, "")
    assert message in err
    assert err.startswith("Error: ")
    assert err.count("\n") == 1


@pytest.mark.parametrize("command", ["predict", "evaluate", "video", "scene"])
def test_an_engine_that_is_not_installed_is_one_line(
    run: Run, model: Path, photo: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *rest: None if name == "openvino" else find(name, *rest)
    )
    arguments: dict[str, tuple[object, ...]] = {
        "predict": ("predict", photo),
        "evaluate": ("evaluate", "--dataset", "tusimple", "--root", "."),
        "video": ("predict", video(Path("a.avi"))),
        "scene": ("predict", photo, "--out", "a.json", "--scale", "1"),
    }
    code, _, err = run(*arguments[command], "--model", model, "--engine", "openvino")
    assert code == 2
    assert err == (
        "Error: The engine openvino needs the package openvino, which is not installed: "
        "pip install 'yolino[openvino]'.\n"
    )


def video(path: Path) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 10, (128, 64))
    for _ in range(3):
        writer.write(np.full((64, 128, 3), 200, np.uint8))
    writer.release()
    return path


def test_videos_and_evaluations_take_the_choice(run: Run, model: Path) -> None:
    choice = ("--model", model, "--engine", "onnxruntime", "--device", "cpu", "--precision", "fp32")
    assert run("predict", video(Path("a.avi")), *choice, "--out", "a.jsonl")[0] == 0
    assert Path("a.jsonl").is_file()


@pytest.mark.skipif("openvino" not in FOUND, reason="OpenVINO is not installed")
def test_a_scene_does_not_mix_engines(
    run: Run, photo: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = make_striped_model(tmp_path / "striped.onnx", striped_header())
    scene = ("predict", photo, "--model", model, "--out", "a.json")
    with monkeypatch.context() as patch:
        patch.setattr("yolino.inference.scene.link", interrupted)
        code, _, err = run(*scene, "--engine", "onnxruntime")
        assert (code, err) == (2, "Error: stopped here\n")
    assert Path("a.json.partial").is_dir()
    code, _, err = run(*scene, "--engine", "openvino")
    assert code == 2
    assert (
        "differs in: engine (it was ONNX Runtime fp32 on cpu). Remove a.json.partial to begin anew, or go on"
    ) in err
    code, _, err = run(*scene, "--engine", "onnxruntime")
    assert code == 0
    assert "Going on with a.json.partial" in err


def interrupted(*_: object) -> None:
    raise ValueError("stopped here")
