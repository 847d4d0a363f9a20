from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from yolino.header import Header
from yolino.inference import Engine, OnnxEngine, open_engine
from yolino.inference.engine import cache_folder
from yolino.inference.engine_onnxruntime import _provider, _provider_options, _quiet_stderr
from yolino.inference.engines import SUFFIXES

CPU, CUDA, TENSORRT = "CPUExecutionProvider", "CUDAExecutionProvider", "TensorrtExecutionProvider"
MakeModel = Callable[..., Path]


def bright(count: int) -> np.ndarray:
    return np.full((count, 64, 128, 3), 200, np.uint8)


def test_runs_batches_of_any_size(tiny_model: Path, tiny_endpoints: np.ndarray) -> None:
    engine = OnnxEngine(tiny_model)
    for count in (1, 3):
        output = engine(bright(count))
        assert output.endpoints.dtype == np.float32
        np.testing.assert_array_equal(output.endpoints, np.repeat(tiny_endpoints[None], count, axis=0))
        np.testing.assert_allclose(output.scores, np.full((count, 8), 0.9), rtol=1e-6)
        assert output.probabilities is None


def test_images_of_a_batch_do_not_mix(tiny_model: Path) -> None:
    batch = bright(3)
    batch[1] = 0
    scores = OnnxEngine(tiny_model)(batch).scores
    np.testing.assert_allclose(scores.max(axis=1), [0.9, 0.0, 0.9], rtol=1e-6)


def test_a_model_with_classes_gives_probabilities(class_model: Path) -> None:
    engine = OnnxEngine(class_model)
    assert engine.header.classes == ("solid", "dashed")
    probabilities = engine(bright(2)).probabilities
    assert probabilities is not None
    assert probabilities.shape == (2, 8, 2)


def test_the_header_comes_with_the_file(tiny_model: Path, header: Header) -> None:
    assert OnnxEngine(tiny_model).header == header


def test_every_engine_has_the_same_face(tiny_model: Path) -> None:
    assert isinstance(open_engine(tiny_model, threads=1), Engine)
    assert set(SUFFIXES) == {".onnx", ".xml", ".safetensors"}


def test_images_of_another_size_are_refused(tiny_model: Path) -> None:
    with pytest.raises(ValueError, match=r"\(64, 128\).*got \(64, 64\)"):
        OnnxEngine(tiny_model)(np.zeros((1, 64, 64, 3), np.uint8))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_missing_file_is_told(tmp_path: Path, suffix: str) -> None:
    with pytest.raises(FileNotFoundError, match=f"nothing{suffix} does not exist"):
        open_engine(tmp_path / f"nothing{suffix}")


@pytest.mark.parametrize("content", [b"", b"not a model", bytes(1000), b"\x08\x08" * 100])
def test_what_is_not_onnx_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "fake.onnx"
    path.write_bytes(content)
    with pytest.raises(
        ValueError, match=r"fake\.onnx .*(not a readable ONNX file|not a YOLinO model)"
    ) as caught:
        OnnxEngine(path)
    assert "\n" not in str(caught.value)


def test_a_truncated_model_is_refused(tmp_path: Path, tiny_model: Path) -> None:
    path = tmp_path / "half.onnx"
    path.write_bytes(tiny_model.read_bytes()[: tiny_model.stat().st_size // 2])
    with pytest.raises(ValueError, match="not a readable ONNX file"):
        OnnxEngine(path)


def test_a_folder_is_no_model(tmp_path: Path) -> None:
    (tmp_path / "folder.onnx").mkdir()
    with pytest.raises(FileNotFoundError):
        OnnxEngine(tmp_path / "folder.onnx")


def test_a_model_without_header_is_refused(tmp_path: Path, make_model: MakeModel) -> None:
    path = make_model(tmp_path / "plain.onnx", header=None)
    with pytest.raises(
        ValueError, match="is not a YOLinO model: its metadata has no 'yolino' header; export one"
    ):
        OnnxEngine(path)


@pytest.mark.parametrize("text", ["", "{}", "[]", '{"version": "9"}'])
def test_a_damaged_header_is_refused(tmp_path: Path, make_model: MakeModel, text: str) -> None:
    path = make_model(tmp_path / "damaged.onnx", header=text)
    with pytest.raises(ValueError, match=r"damaged\.onnx has a damaged header\. The header"):
        OnnxEngine(path)


def test_wrong_outputs_are_refused(tmp_path: Path, make_model: MakeModel, header: Header) -> None:
    with pytest.raises(ValueError, match="lacks the outputs scores: it has endpoints"):
        OnnxEngine(make_model(tmp_path / "one.onnx", outputs=("endpoints",)))
    classes = dataclasses.replace(header, classes=("a",))
    with pytest.raises(ValueError, match="lacks the outputs probabilities"):
        OnnxEngine(make_model(tmp_path / "classes.onnx", header=classes))


def test_a_header_of_another_size_is_refused(tmp_path: Path, make_model: MakeModel, header: Header) -> None:
    path = make_model(tmp_path / "model.onnx")
    other = dataclasses.replace(header, size=(64, 256)).to_json()
    with pytest.raises(ValueError, match=r"takes images of \(64, 128\), but its header says \(64, 256\)"):
        OnnxEngine(make_model(path, header=other))


def test_unknown_suffixes_devices_and_threads_are_refused(tmp_path: Path, tiny_model: Path) -> None:
    (tmp_path / "model.pt").touch()
    with pytest.raises(ValueError, match=r"'\.pt'; known model files end in \.onnx, \.xml, \.safetensors"):
        open_engine(tmp_path / "model.pt")
    for opened in (open_engine, OnnxEngine):
        with pytest.raises(ValueError, match="device 'gpu' is unknown; use one of auto, cpu, cuda"):
            opened(tiny_model, device="gpu")
    with pytest.raises(ValueError, match="threads is 0"):
        OnnxEngine(tiny_model, threads=0)


def test_cuda_is_refused_where_it_is_not() -> None:
    runtime = pytest.importorskip("onnxruntime")
    if "CUDAExecutionProvider" in runtime.get_available_providers():
        pytest.skip("this ONNX Runtime has CUDA")
    with pytest.raises(ValueError, match="onnxruntime-gpu"):
        _provider("cuda", "auto", [CPU])


def test_the_provider_follows_from_device_and_precision() -> None:
    every = [TENSORRT, CUDA, CPU]
    assert _provider("auto", "auto", [CPU]) == CPU
    assert _provider("auto", "auto", every) == CUDA
    assert _provider("cpu", "auto", every) == CPU
    assert _provider("cuda", "fp32", every) == CUDA
    assert _provider("cuda", "fp16", every) == TENSORRT
    with pytest.raises(ValueError, match="runs fp16 with TensorRT, which this one lacks"):
        _provider("cuda", "fp16", [CUDA, CPU])


def test_cuda_is_exact_and_tensorrt_keeps_its_programs(
    tiny_model: Path, class_model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("YOLINO_CACHE", str(tmp_path))
    assert _provider_options(CUDA, tiny_model) == [(CUDA, {"use_tf32": "0"}), (CPU, {})]
    folders = []
    for model in (tiny_model, class_model):
        (first, options), *others = _provider_options(TENSORRT, model)
        assert first == TENSORRT
        assert options["trt_fp16_enable"] == options["trt_engine_cache_enable"] == "1"
        assert [name for name, _ in others] == [CUDA, CPU]
        folders.append(Path(options["trt_engine_cache_path"]))
    assert folders[0] != folders[1]  # the weights differ, and the names of the programs do not say so
    assert all(folder.is_dir() and folder.is_relative_to(tmp_path) for folder in folders)


def test_a_cache_that_cannot_be_written_is_left_out(
    tiny_model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("YOLINO_CACHE", str(tmp_path / "file"))
    assert cache_folder("tensorrt") is None
    assert _provider_options(TENSORRT, tiny_model)[0] == (TENSORRT, {"trt_fp16_enable": "1"})
    monkeypatch.delenv("YOLINO_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert cache_folder("tensorrt") == tmp_path / "cache" / "yolino" / "tensorrt"


def _fail_quietly() -> None:
    with _quiet_stderr():
        os.write(2, b"a library is missing\n")
        raise ImportError


def test_warnings_of_c_code_are_swallowed_unless_it_fails(capfd: pytest.CaptureFixture[str]) -> None:
    with _quiet_stderr():
        os.write(2, b"no GPU here\n")
    assert capfd.readouterr().err == ""
    with pytest.raises(ImportError):
        _fail_quietly()
    os.write(2, b"later\n")
    assert capfd.readouterr().err == "a library is missing\nlater\n"


def test_detecting_says_nothing_on_stderr_and_loads_no_torch(tiny_model: Path) -> None:
    code = (
        "import sys, numpy as np; from yolino.inference import OnnxEngine;"
        f"OnnxEngine({str(tiny_model)!r})(np.zeros((1, 64, 128, 3), np.uint8));"
        "assert not {'torch', 'sklearn', 'onnx'} & set(sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
