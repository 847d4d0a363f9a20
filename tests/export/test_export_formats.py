"""Every format and precision opens in its engine and finds what its source finds."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from convolving_model import convolving_header, make_convolving_model
from yolino.datasets import Dataset
from yolino.export import FORMATS, Calibration, Exported, export
from yolino.header import PRECISIONS
from yolino.inference import Engine, OnnxEngine

PIXELS = {"fp32": 1e-3, "fp16": 0.1, "int8": 2.0}
NEEDED = {"onnx": "onnx", "openvino": "openvino"}
Export = Callable[[str, str], tuple[Exported, Engine]]


@pytest.fixture(scope="module")
def written(source: Path, labelled: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Export:
    """Exports the source and opens what was written; each combination once."""
    folder, kept = tmp_path_factory.mktemp("written"), dict[tuple[str, str], tuple[Exported, Engine]]()

    def write(format: str, precision: str) -> tuple[Exported, Engine]:
        pytest.importorskip(NEEDED[format], reason=f"the format {format} needs it")
        if (format, precision) == ("openvino", "int8"):
            pytest.importorskip("nncf", reason="int8 for OpenVINO needs it")
        if (format, precision) not in kept:
            target = FORMATS[format]()
            done = export(
                source,
                format=format,
                precision=precision,
                out=folder / f"{precision}{target.suffix}",
                changes=["name=mine", "postprocess.threshold=0.4"],
                calibration=Calibration(labelled) if precision == "int8" else None,
            )
            kept[format, precision] = done, target.open(done.path)
        return kept[format, precision]

    return write


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("format", FORMATS)
def test_it_equals_its_source(
    written: Export, source: Path, labelled: Dataset, format: str, precision: str
) -> None:
    from yolino.export.calibration import Inputs
    from yolino.inference import Predictor

    exact, (_, engine) = OnnxEngine(source, device="cpu"), written(format, precision)
    inputs = Inputs(Predictor(exact), labelled, 6, lambda indices, title: indices)
    images = np.concatenate([inputs[i] for i in range(6)])
    ours, theirs = exact(images), engine(images)
    np.testing.assert_allclose(theirs.scores, ours.scores, atol=0.02)
    lit = ours.scores > 0.5
    assert 50 < lit.sum() < lit.size
    far = np.linalg.norm(ours.endpoints - theirs.endpoints, axis=-1).max(axis=-1)[lit]
    assert far.max() <= PIXELS[precision]
    assert engine.precision == ("int8" if precision == "int8" else "fp32")


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("format", FORMATS)
def test_the_header_comes_with_it(written: Export, format: str, precision: str) -> None:
    done, engine = written(format, precision)
    assert engine.header == done.header
    found = dataclasses.replace(done.header, metrics={})
    postprocess = {**convolving_header().postprocess, "threshold": 0.4}
    assert found == convolving_header(name="mine", precision=precision, postprocess=postprocess)
    assert set(done.header.metrics) == ({"int8"} if precision == "int8" else set())


@pytest.mark.parametrize("format", FORMATS)
def test_fewer_bits_are_fewer_bytes(written: Export, format: str) -> None:
    # The few weights of this model lie beside constants of the decoding that stay as they are.
    sizes = [written(format, precision)[0].size for precision in ("fp32", "fp16")]
    assert sizes[1] < 0.6 * sizes[0]
    done = written(format, "fp32")[0]
    assert done.size == sum(file.stat().st_size for file in done.files)
    assert {file.suffix for file in done.files} == ({".onnx"} if format == "onnx" else {".xml", ".bin"})


def test_an_onnx_file_of_int8_means_the_same_in_openvino(written: Export) -> None:
    pytest.importorskip("openvino", reason="it is the engine of this test")
    from yolino.inference.engines import OpenVinoEngine

    done, engine = written("onnx", "int8")
    images = np.random.default_rng(0).integers(0, 256, (1, 128, 128, 3), dtype=np.uint8)
    ours, theirs = engine(images), OpenVinoEngine(done.path, device="cpu")(images)
    assert np.abs(ours.endpoints - theirs.endpoints).mean() < 0.5


def test_nothing_but_the_header_changes(written: Export, source: Path, tmp_path: Path) -> None:
    for file in (source, written("onnx", "fp16")[0].path, written("onnx", "int8")[0].path):
        done = export(file, out=tmp_path / "new.onnx", changes=["postprocess.threshold=0.9"])
        old = OnnxEngine(file).header
        assert done.header.precision == old.precision
        assert done.header.postprocess == {**old.postprocess, "threshold": 0.9}
        images = np.random.default_rng(0).integers(0, 256, (1, 128, 128, 3), dtype=np.uint8)
        for one, other in zip(OnnxEngine(file)(images), OnnxEngine(done.path)(images), strict=True):
            assert (one is None and other is None) or np.array_equal(one, other)


def test_16_bits_become_int8_too(written: Export, labelled: Dataset, tmp_path: Path) -> None:
    small = written("onnx", "fp16")[0].path
    done = export(small, precision="int8", out=tmp_path / "a.onnx", calibration=Calibration(labelled, 2))
    assert done.header.metrics["int8"]["images"] == 2


def test_a_file_can_be_written_over_itself(source: Path, tmp_path: Path) -> None:
    file = tmp_path / "lines.onnx"
    file.write_bytes(source.read_bytes())
    export(file, out=file, changes=["name=new"])
    assert OnnxEngine(file).header.name == "new"


def test_classes_survive(tmp_path: Path) -> None:
    pytest.importorskip("openvino", reason="it is the engine of this test")
    header = convolving_header(classes=("steep", "flat"))
    model = make_convolving_model(tmp_path / "classes.onnx", header)
    engine = FORMATS["openvino"]().open(export(model, format="openvino").path)
    images = np.random.default_rng(0).integers(0, 256, (2, 128, 128, 3), dtype=np.uint8)
    ours, theirs = OnnxEngine(model)(images).probabilities, engine(images).probabilities
    assert ours is not None
    assert theirs is not None
    np.testing.assert_allclose(ours, theirs, atol=1e-4)
    assert engine.header.classes == ("steep", "flat")


def test_the_default_file_is_beside_the_source_or_here(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("openvino", reason="it writes the file of this test")
    model = tmp_path / "sub" / "lines.onnx"
    model.parent.mkdir()
    model.write_bytes(source.read_bytes())
    monkeypatch.chdir(tmp_path)
    assert export(model, format="openvino").path == model.with_suffix(".xml")
    assert export("default", precision="fp16").path == Path("default.onnx")
    assert OnnxEngine("default.onnx").header.precision == "fp16"


def test_nothing_of_torch_is_needed_without_a_checkpoint(source: Path, drive: Path, tmp_path: Path) -> None:
    pytest.importorskip("nncf", reason="int8 for OpenVINO needs it")
    code = f"""
import sys
for name in ("torch", "torchvision", "lightning", "timm", "safetensors.torch"):
    sys.modules[name] = None
from yolino.cli import main
for more in (["-p", "fp16"], ["-p", "int8", "--calibrate", {str(drive)!r}, "--split", "all"]):
    for format, suffix in (("onnx", "onnx"), ("openvino", "xml")):
        assert main(["export", {str(source)!r}, "-f", format, "-o", f"{{more[1]}}.{{suffix}}", *more]) == 0
assert main(["export", "default", "--set", "name=mine"]) == 0
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert sorted(file.name for file in tmp_path.iterdir()) == [
        "default.onnx", "fp16.bin", "fp16.onnx", "fp16.xml", "int8.bin", "int8.onnx", "int8.xml",
    ]  # fmt: skip
    assert "Statistics" not in done.stdout
    lines = done.stdout.splitlines()
    assert len(lines) == 7, lines  # a line for each file, and one for what int8 costs


def test_no_usage_statistics_are_sent(tmp_path: Path) -> None:
    """The package that sends them cannot even be imported."""
    pytest.importorskip("nncf", reason="it would send them")
    code = """
import sys
from yolino.export.packages import import_nncf
nncf = import_nncf()
import nncf.telemetry.wrapper as wrapper
assert type(wrapper.telemetry).__module__ == "unittest.mock", type(wrapper.telemetry)
assert sys.modules["openvino_telemetry"] is None
assert not any(name.startswith("openvino_telemetry.") for name in sys.modules)
"""
    done: Any = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
