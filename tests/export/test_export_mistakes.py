"""What is refused, and how it is told."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

from convolving_model import write_drive
from yolino.datasets import Dataset
from yolino.datasets.description import load_description, open_split
from yolino.export import Calibration, export
from yolino.export.calibration import Chosen


def test_unknown_names_are_refused(source: Path) -> None:
    with pytest.raises(ValueError, match="format 'caffe' is unknown; use one of onnx, openvino"):
        export(source, format="caffe")
    with pytest.raises(ValueError, match="precision 'int4' is unknown; use one of fp32, fp16, int8"):
        export(source, precision="int4")


@pytest.mark.parametrize(
    ("out", "format", "message"),
    [
        (
            "a.xml",
            "onnx",
            r"a\.xml must end in \.onnx, as the format onnx does \(or take --format openvino\)",
        ),
        ("a.onnx", "openvino", r"a\.onnx must end in \.xml.*--format onnx"),
        ("a.bin", "openvino", r"a\.bin must end in \.xml, as the format openvino does\.$"),
        ("a", "onnx", r"a must end in \.onnx"),
    ],
)
def test_a_suffix_that_contradicts_the_format_is_refused(
    source: Path, tmp_path: Path, out: str, format: str, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        export(source, format=format, out=tmp_path / out)


def test_sources_that_are_none_are_refused(source: Path, tmp_path: Path) -> None:
    for name in ("nothing.safetensors", "nothing.onnx"):
        with pytest.raises(FileNotFoundError, match="does not exist"):
            export(tmp_path / name, out=tmp_path / "out.onnx")
    (tmp_path / "a.xml").write_text("<net/>")
    with pytest.raises(
        ValueError, match=r"a\.xml, but only a checkpoint \(\.safetensors\) or an exported \.onnx"
    ):
        export(tmp_path / "a.xml")
    (tmp_path / "a.onnx").write_bytes(b"no model")
    with pytest.raises(ValueError, match="not a readable ONNX file"):
        export(tmp_path / "a.onnx", out=tmp_path / "b.onnx")
    with pytest.raises(ValueError, match="'defalt' is unknown"):
        export("defalt")
    with pytest.raises(ValueError, match=r"overwrite its source.*--out"):
        export(source)


def test_int8_and_calibration_need_each_other(source: Path, labelled: Dataset, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"int8 needs labelled images.*--calibrate DATA"):
        export(source, precision="int8", out=tmp_path / "a.onnx")
    for precision in (None, "fp32", "fp16"):
        with pytest.raises(ValueError, match=r"--calibrate is for int8, but the precision is fp\d+: add"):
            export(source, precision=precision, out=tmp_path / "a.onnx", calibration=Calibration(labelled))


def test_weights_that_are_rounded_do_not_come_back(source: Path, labelled: Dataset, tmp_path: Path) -> None:
    half = export(source, precision="fp16", out=tmp_path / "half.onnx").path
    with pytest.raises(ValueError, match="rounded to 16 bits already"):
        export(half, precision="fp32", out=tmp_path / "a.onnx")
    quantized = export(
        source, precision="int8", out=tmp_path / "q.onnx", calibration=Calibration(labelled, 2)
    ).path
    attempts: list[dict[str, Any]] = [
        {"precision": "fp32"},
        {"precision": "fp16"},
        {"precision": "int8", "calibration": Calibration(labelled)},
    ]
    for more in attempts:
        with pytest.raises(ValueError, match="is quantized to int8 already, so only its header"):
            export(quantized, out=tmp_path / "a.onnx", **more)
    if "openvino" in sys.modules:
        with pytest.raises(ValueError, match="is quantized to int8 already"):
            export(quantized, format="openvino", out=tmp_path / "a.xml")
    assert not (tmp_path / "a.onnx").exists()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("size=[64,64]", "The size of .* is built into its graph"),
        ("stride=32", "The stride of"),
        ("predictors=2", "The predictors of"),
        ("representation=md", "The representation of"),
        ("classes=[a]", "The classes of"),
        ("precision=int8", "would not change the weights: use --precision"),
        ("nme=x", "unknown nme"),
        ("name", "key=value"),
        ("postprocess.treshold=1", "treshold"),
    ],
)
def test_what_is_built_in_cannot_be_changed(source: Path, tmp_path: Path, change: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        export(source, out=tmp_path / "a.onnx", changes=[change])


def test_calibration_data_must_be_there_and_labelled(source: Path, labelled: Dataset, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="images is 0"):
        Calibration(labelled, images=0)
    for drop in (-0.1, 1.5, float("nan")):
        with pytest.raises(ValueError, match="max_drop is"):
            Calibration(labelled, max_drop=drop)
    description = load_description(write_drive(tmp_path / "drive", 2, labelled=False))
    with pytest.raises(ValueError, match="no images: check the folder and the split"):
        Calibration(Chosen(labelled, []))
    calibration = Calibration(open_split(description, "all"))
    with pytest.raises(ValueError, match="None of the 2 calibration images has a labelled line"):
        export(source, precision="int8", out=tmp_path / "a.onnx", calibration=calibration)


@pytest.mark.parametrize(
    ("package", "format", "precision"),
    [("onnx", "onnx", "fp16"), ("openvino", "openvino", "fp32"), ("nncf", "openvino", "int8")],
)
def test_a_package_that_is_missing_is_told_in_one_sentence(
    source: Path,
    labelled: Dataset,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    *,
    package: str,
    format: str,
    precision: str,
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    calibration = Calibration(labelled, 1) if precision == "int8" else None
    out = tmp_path / ("a.onnx" if format == "onnx" else "a.xml")
    with pytest.raises(ModuleNotFoundError) as told:
        export(source, format=format, precision=precision, out=out, calibration=calibration)
    assert str(told.value).endswith(
        f"needs the package {package}, which is not installed: pip install 'yolino[quantize]'."
    )
    assert told.value.name is None  # else the command line would name another extra
