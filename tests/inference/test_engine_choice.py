"""Which engine takes a file, and what is said where none can; the metadata that the choice looks at."""

from __future__ import annotations

import dataclasses
import importlib.machinery
import importlib.util
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yolino.header import Header
from yolino.inference import ENGINES, EngineChoice, engines, load, open_engine
from yolino.inference.engine import choose_precision
from yolino.inference.engine_openvino import _precisions, openvino_core
from yolino.inference.engines import EngineKind, choose_engine
from yolino.inference.onnx_metadata import read_onnx_metadata

MakeModel = Callable[..., Path]


def without(monkeypatch: pytest.MonkeyPatch, *packages: str) -> None:
    """Lets packages look as if they were not installed."""
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name in packages else find(name))


def test_an_unknown_engine_is_told_with_the_nearest(tiny_model: Path) -> None:
    with pytest.raises(
        ValueError, match=r"engine 'opnvino' is unknown; did you mean 'openvino'\? use auto or"
    ):
        open_engine(tiny_model, engine="opnvino")
    with pytest.raises(ValueError, match="precision 'half' is unknown; use one of auto, fp32, bf16"):
        open_engine(tiny_model, precision="half")


def test_an_engine_refuses_files_that_others_read(tiny_model: Path, tmp_path: Path) -> None:
    with pytest.raises(
        ValueError, match=r"torch reads \.safetensors files, .*engine onnxruntime or openvino"
    ):
        open_engine(tiny_model, engine="torch")
    (tmp_path / "a.xml").touch()
    with pytest.raises(
        ValueError, match=r"onnxruntime reads \.onnx files, .*a\.xml: take the engine openvino"
    ):
        open_engine(tmp_path / "a.xml", engine="onnxruntime")


def test_an_engine_says_which_precisions_and_devices_it_has(tiny_model: Path) -> None:
    with pytest.raises(
        ValueError, match="no precision 'bf16'; it has fp32, int8 on cpu and fp32, fp16, int8 on cuda"
    ):
        open_engine(tiny_model, engine="onnxruntime", precision="bf16")
    with pytest.raises(ValueError, match="openvino has no device 'cuda'; it has cpu"):
        open_engine(tiny_model, engine="openvino", device="cuda")
    with pytest.raises(ValueError, match=r"No engine runs \.onnx files in bf16 on cuda: take the device cpu"):
        open_engine(tiny_model, precision="bf16", device="cuda")
    with pytest.raises(ValueError, match="ONNX Runtime on cpu cannot run in fp16; it has fp32, int8"):
        open_engine(tiny_model, engine="onnxruntime", device="auto", precision="fp16")


@pytest.mark.parametrize("name", ENGINES)
def test_an_engine_that_is_not_installed_is_one_line(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kind = ENGINES[name]
    without(monkeypatch, *kind.packages)
    file = tmp_path / f"model{kind.suffixes[0]}"
    file.touch()
    with pytest.raises(ModuleNotFoundError) as caught:
        open_engine(file, engine=name)
    assert f"{name} needs the package {kind.packages[0]}" in str(caught.value)
    assert kind.install in str(caught.value)


def with_cuda(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    """Lets ONNX Runtime look as if it were onnxruntime-gpu, by the file that it then brings."""
    (folder / "capi").mkdir()
    (folder / "capi" / "libonnxruntime_providers_cuda.so").touch()
    spec = importlib.machinery.ModuleSpec("onnxruntime", None, is_package=True)
    spec.submodule_search_locations = [str(folder)]
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: spec if name == "onnxruntime" else find(name)
    )


def no_cuda(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets ONNX Runtime look as if it had none, whatever is installed."""
    monkeypatch.setattr(engines, "_is_there", lambda start: not start)


def test_auto_counts_only_the_devices_that_are_there(
    tiny_model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        no_cuda(patch)
        assert ENGINES["onnxruntime"].devices("auto") == ("cpu",)
        assert choose_engine(tiny_model, "auto", "fp16") == "openvino"
        assert choose_engine(tiny_model, "cuda", "fp16") == "onnxruntime"  # which says what it needs
        assert choose_engine(Path("a.safetensors"), "auto", "fp16") == "torch"
        without(patch, "openvino")
        assert choose_engine(tiny_model, "auto", "fp16") == "openvino"  # which says how it is installed
    with_cuda(monkeypatch, tmp_path)
    assert ENGINES["onnxruntime"].devices("auto") == ("cpu", "cuda")
    assert ENGINES["onnxruntime"].devices("cpu") == ("cpu",)
    assert choose_engine(tiny_model, "auto", "fp16") == "onnxruntime"
    assert choose_engine(tiny_model, "cpu", "fp16") == "openvino"
    assert choose_engine(tiny_model, "auto", "bf16") == "openvino"


def test_fp16_without_cuda_is_the_processors_or_refused(
    tiny_model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("openvino")
    no_cuda(monkeypatch)
    if "fp16" in _precisions(openvino_core()):
        assert open_engine(tiny_model, precision="fp16").name == "OpenVINO fp16"
    else:
        with pytest.raises(ValueError, match="OpenVINO on this processor cannot run in fp16; it has fp32"):
            open_engine(tiny_model, precision="fp16")


def test_onnxruntime_is_chosen_first_and_openvino_where_only_it_can(
    tiny_model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert choose_engine(tiny_model) == "onnxruntime"
    assert choose_engine(tiny_model, "cpu", "bf16") == "openvino"
    assert choose_engine(Path("a.xml")) == "openvino"
    assert choose_engine(Path("a.safetensors"), precision="bf16") == "torch"
    without(monkeypatch, "onnxruntime")
    assert choose_engine(tiny_model) == "openvino"
    without(monkeypatch, "onnxruntime", "openvino")
    assert choose_engine(tiny_model) == "onnxruntime"  # which then says how it is installed


def test_quantized_files_go_to_openvino_where_it_is(
    tmp_path: Path, make_model: MakeModel, header: Header, monkeypatch: pytest.MonkeyPatch
) -> None:
    quantized = dataclasses.replace(header, precision="int8")
    path = make_model(tmp_path / "int8.onnx", header=quantized)
    with monkeypatch.context() as patch:
        no_cuda(patch)
        assert choose_engine(path) == "openvino"
        assert choose_engine(path, "cuda") == "onnxruntime"
        without(patch, "openvino")
        assert choose_engine(path) == "onnxruntime"
    with_cuda(monkeypatch, tmp_path)
    assert choose_engine(path) == "onnxruntime"
    assert choose_engine(path, "cpu") == "openvino"


@pytest.mark.parametrize("engine", ["onnxruntime", "openvino"])
def test_a_quantized_file_runs_in_int8_only(
    engine: str, tmp_path: Path, make_model: MakeModel, header: Header
) -> None:
    if ENGINES[engine].missing is not None:
        pytest.skip(f"{engine} is not installed")
    path = make_model(tmp_path / "int8.onnx", header=dataclasses.replace(header, precision="int8"))
    for precision in ("auto", "int8"):
        opened = open_engine(path, engine=engine, device="cpu", precision=precision)
        assert (opened.precision, opened.name[-5:]) == ("int8", " int8")
    with pytest.raises(ValueError, match=r"int8\.onnx is quantized to int8 and cannot run in fp32"):
        open_engine(path, engine=engine, precision="fp32")


def test_weights_stored_in_half_are_calculated_in_fp32(header: Header) -> None:
    stored = dataclasses.replace(header, precision="fp16")
    assert choose_precision("auto", stored, Path("a.onnx"), ("fp32", "fp16"), "here") == "fp32"


def test_a_choice_is_handed_on(tiny_model: Path) -> None:
    engine = EngineChoice("onnxruntime", "cpu", "fp32", threads=1, streams=2).open(tiny_model)
    assert engine.name == "ONNX Runtime fp32"
    predictor = load(tiny_model, engine="onnxruntime", device="cpu", precision="fp32", threads=1, streams=2)
    assert predictor.engine.name == engine.name


def test_a_kind_knows_its_devices() -> None:
    kind = EngineKind((".a",), {"cpu": ("fp32",), "cuda": ("fp16",)}, (), "", "")
    assert kind.can("auto", "fp16")
    assert kind.can("auto", "auto")
    assert kind.can("cpu", "fp32")
    assert not kind.can("cpu", "fp16")
    assert not kind.can("tpu", "auto")


def test_metadata_is_read_without_the_network(tiny_model: Path, class_model: Path, header: Header) -> None:
    assert read_onnx_metadata(tiny_model) == {"yolino": header.to_json()}
    assert Header.from_json(read_onnx_metadata(class_model)["yolino"]).classes == ("solid", "dashed")


def test_metadata_of_several_entries_is_what_onnx_reads(tiny_model: Path, tmp_path: Path) -> None:
    onnx = pytest.importorskip("onnx")
    model = onnx.load(tiny_model)
    onnx.helper.set_model_props(model, {"a": "", "b": "ä" * 300, "": "c"})
    onnx.save(model, tmp_path / "a.onnx")
    assert read_onnx_metadata(tmp_path / "a.onnx") == {"a": "", "b": "ä" * 300, "": "c"}


@given(content=st.binary(max_size=200), cut=st.integers(0, 4000))
def test_damaged_metadata_is_no_error(content: bytes, cut: int, tiny_model: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.onnx"
        for damaged in (content, tiny_model.read_bytes()[:cut] + content):
            path.write_bytes(damaged)
            assert set(read_onnx_metadata(path)) <= {"yolino"} or content
