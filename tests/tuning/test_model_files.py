from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yolino.header import Header
from yolino.inference import OnnxEngine
from yolino.inference.onnx_metadata import read_onnx_metadata
from yolino.tuning import with_header
from yolino.tuning.model_files import _read_varint, _varint

CHANGE = {"threshold": 0.25, "linker": "graph", "linker_options": {"min_score": 0.5}}


@pytest.fixture
def changed(header: Header) -> Header:
    return replace(header, postprocess=CHANGE, data='two <lines> & a "Straße"\n')


def test_an_onnx_file_keeps_its_network(tiny_model: Path, changed: Header, tmp_path: Path) -> None:
    onnx = pytest.importorskip("onnx", reason="onnx reads what was written")
    path = tmp_path / "tuned.onnx"
    path.write_bytes(with_header(tiny_model, changed))
    assert read_onnx_metadata(path) == {"yolino": changed.to_json()}
    before, after = onnx.load(tiny_model), onnx.load(path)
    assert before.graph == after.graph
    assert before.opset_import == after.opset_import
    onnx.checker.check_model(after)
    bright = np.full((1, 64, 128, 3), 200, np.uint8)
    old, new = OnnxEngine(tiny_model, device="cpu"), OnnxEngine(path, device="cpu")
    assert new.header == changed
    assert np.array_equal(old(bright).endpoints, new(bright).endpoints)


def test_other_metadata_of_an_onnx_file_stays(tiny_model: Path, changed: Header, tmp_path: Path) -> None:
    onnx = pytest.importorskip("onnx", reason="onnx writes the file of this test")
    model = onnx.load(tiny_model)
    entry = model.metadata_props.add()
    entry.key, entry.value = "author", "somebody"
    path = tmp_path / "model.onnx"
    path.write_bytes(model.SerializeToString())
    path.write_bytes(with_header(path, changed))
    assert read_onnx_metadata(path) == {"author": "somebody", "yolino": changed.to_json()}


def test_writing_the_same_header_twice_changes_nothing(
    tiny_model: Path, changed: Header, tmp_path: Path
) -> None:
    path = tmp_path / "tuned.onnx"
    path.write_bytes(with_header(tiny_model, changed))
    assert with_header(path, changed) == path.read_bytes()


def test_a_checkpoint_keeps_its_weights(header: Header, changed: Header, tmp_path: Path) -> None:
    safetensors = pytest.importorskip("safetensors.numpy", reason="safetensors writes the file of this test")
    from safetensors import safe_open

    path = tmp_path / "a.safetensors"
    weights = {"one": np.arange(6, dtype=np.float32).reshape(2, 3), "two": np.array([7], np.int64)}
    safetensors.save_file(weights, path, metadata={"yolino": header.to_json(), "network": '{"a": 1}'})
    path.write_bytes(with_header(path, changed))
    with safe_open(path, framework="np") as file:
        assert file.metadata() == {"yolino": changed.to_json(), "network": '{"a": 1}'}
        assert {name: file.get_tensor(name).tolist() for name in weights} == {
            name: value.tolist() for name, value in weights.items()
        }
    assert int.from_bytes(path.read_bytes()[:8], "little") % 8 == 0


def test_an_xml_file_keeps_all_but_the_header(changed: Header, tmp_path: Path) -> None:
    import xml.etree.ElementTree as ET

    path = tmp_path / "a.xml"
    start, end = (
        '<?xml version="1.0"?>\n<net>\n\t<layers><header value="1" /></layers>\n',
        "\n\t</rt_info>\n</net>\n",
    )
    old = '\t<rt_info>\n\t\t<yolino>\n\t\t\t<header value="{&quot;a&quot;: 1}" />\n\t\t</yolino>'
    path.write_text(start + old + end)
    made = with_header(path, changed).decode()
    assert made.startswith(start)
    assert made.endswith(end)
    found = ET.fromstring(made).find("rt_info/yolino/header")
    assert found is not None
    assert Header.from_json(found.attrib["value"]) == changed


def test_openvino_reads_what_was_written(tiny_model: Path, changed: Header, tmp_path: Path) -> None:
    pytest.importorskip("openvino", reason="OpenVINO writes and reads the files of this test")
    from yolino.export import export
    from yolino.inference import OpenVinoEngine

    path = export(tiny_model, format="openvino", out=tmp_path / "a.xml").path
    path.write_bytes(with_header(path, changed))
    assert OpenVinoEngine(path, device="cpu").header == changed


@pytest.mark.parametrize("suffix", [".onnx", ".safetensors", ".xml"])
@pytest.mark.parametrize(
    "content", [b"", b"<net></net>", b"\x02\0\0\0\0\0\0\0{}", b"\xff" * 40, b"r\x05\n\x03abc"]
)
def test_what_has_no_header_is_named(suffix: str, content: bytes, changed: Header, tmp_path: Path) -> None:
    path = tmp_path / f"broken{suffix}"
    path.write_bytes(content)
    with pytest.raises(ValueError, match="is damaged, or is no model of yolino with a header"):
        with_header(path, changed)


@pytest.mark.parametrize("cut", [1, 10, 200])
def test_a_file_that_is_cut_short_is_named(
    cut: int, tiny_model: Path, changed: Header, tmp_path: Path
) -> None:
    path = tmp_path / "short.onnx"
    path.write_bytes(tiny_model.read_bytes()[:-cut])
    with pytest.raises(ValueError, match="is damaged"):
        with_header(path, changed)


def test_models_without_a_header_and_other_files_are_named(
    make_model: Callable[..., Path], changed: Header, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match="no model of yolino"):
        with_header(make_model(tmp_path / "bare.onnx", header=None), changed)
    with pytest.raises(ValueError, match=r"of no kind whose header can be written: \.onnx"):
        with_header(tmp_path / "a.pt", changed)
    with pytest.raises(FileNotFoundError):
        with_header(tmp_path / "none.onnx", changed)


@given(value=st.integers(0, 2**63))
def test_integers_come_back(value: int) -> None:
    data = b"x" + _varint(value)
    assert _read_varint(data, 1) == (value, len(data))
