"""What only the OpenVINO engine has: `.xml` files, programs for batch sizes, a silent import."""

from __future__ import annotations

import dataclasses
import shutil
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from yolino.header import Header
from yolino.inference import OnnxEngine, OpenVinoEngine, open_engine

pytest.importorskip("openvino", reason="OpenVINO runs the models of these tests")


def write_xml(source: Path, target: Path, header: Header | str | None) -> Path:
    from yolino.inference.engine_openvino import import_openvino, openvino_core

    runtime = import_openvino()
    model = openvino_core().read_model(str(source))
    if header is not None:
        text = header if isinstance(header, str) else header.to_json()
        model.set_rt_info(text, ["yolino", "header"])
    runtime.save_model(model, str(target), compress_to_fp16=False)
    return target


@pytest.fixture
def xml(tiny_model: Path, tmp_path: Path, header: Header) -> Path:
    return write_xml(tiny_model, tmp_path / "tiny.xml", header)


def bright(count: int) -> np.ndarray:
    return np.full((count, 64, 128, 3), 200, np.uint8)


def test_both_formats_carry_the_header(xml: Path, tiny_model: Path, header: Header) -> None:
    for path in (xml, tiny_model):
        engine = OpenVinoEngine(path)
        assert engine.header == header
        assert engine.name == "OpenVINO fp32"
        for found, wanted in zip(engine(bright(2))[:2], OnnxEngine(tiny_model)(bright(2))[:2], strict=True):
            np.testing.assert_allclose(found, wanted, atol=1e-4)


def test_the_weights_beside_it_are_needed(xml: Path) -> None:
    xml.with_suffix(".bin").unlink()
    with pytest.raises(FileNotFoundError, match=r"tiny\.xml needs the file .*tiny\.bin beside it"):
        open_engine(xml)


def test_a_file_without_header_is_refused(tiny_model: Path, tmp_path: Path, make_model) -> None:
    plain = make_model(tmp_path / "plain.onnx", header=None)
    for path in (plain, write_xml(plain, tmp_path / "plain.xml", None)):
        with pytest.raises(ValueError, match="is not a YOLinO model: its metadata has no 'yolino' header"):
            OpenVinoEngine(path)
    with pytest.raises(ValueError, match=r"bad\.xml has a damaged header\. The header"):
        OpenVinoEngine(write_xml(tiny_model, tmp_path / "bad.xml", "{}"))


@pytest.mark.parametrize("content", [b"", b"not a model", b"<net/>", b"<net version='11'><layers/></net>"])
def test_what_is_no_model_is_one_line(tmp_path: Path, content: bytes) -> None:
    for name in ("fake.xml", "fake.onnx"):
        path = tmp_path / name
        path.write_bytes(content)
        path.with_suffix(".bin").touch()
        with pytest.raises(ValueError, match=r"fake\.(xml|onnx)") as caught:
            OpenVinoEngine(path)
        assert "\n" not in str(caught.value)


def test_the_graph_must_be_that_of_an_exported_network(tmp_path: Path, make_model, header: Header) -> None:
    with pytest.raises(ValueError, match="lacks the outputs scores: it has endpoints"):
        OpenVinoEngine(make_model(tmp_path / "one.onnx", outputs=("endpoints",)))
    path = make_model(tmp_path / "model.onnx")
    other = dataclasses.replace(header, size=(64, 256)).to_json()
    with pytest.raises(ValueError, match=r"takes images of \(64, 128\), but its header says \(64, 256\)"):
        OpenVinoEngine(make_model(path, header=other))


def test_a_name_with_spaces_and_umlauts_is_no_matter(xml: Path, tmp_path: Path, header: Header) -> None:
    folder = tmp_path / "größe 1"
    folder.mkdir()
    for suffix in (".xml", ".bin"):
        shutil.copy(xml.with_suffix(suffix), folder / f"mein modell{suffix}")
    assert OpenVinoEngine(folder / "mein modell.xml").header == header


def test_only_a_few_batch_sizes_stay_compiled(tiny_model: Path) -> None:
    engine = OpenVinoEngine(tiny_model)
    programs = engine._programs
    for count in (1, 2, 3, 4, 1, 5):
        assert engine(bright(count)).scores.shape == (count, 8)
    assert list(programs._kept) == [3, 4, 1, 5]
    assert engine(bright(2)).scores.shape == (2, 8)


def test_calls_at_once_have_requests_of_their_own(tiny_model: Path) -> None:
    engine = OpenVinoEngine(tiny_model, threads=2, streams=2)
    start = threading.Barrier(4)
    found: list[float] = []

    def work(value: int) -> None:
        start.wait()
        for _ in range(20):
            found.append(abs(float(engine(bright(1) * value).scores.max()) - 0.9 * value))

    threads = [threading.Thread(target=work, args=(i % 2,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 80
    assert max(found) < 1e-5
    assert engine._programs._kept[1]._free.qsize() <= 4


def test_threads_and_streams_reach_openvino(tiny_model: Path) -> None:
    engine = OpenVinoEngine(tiny_model, threads=2, streams=2)
    engine(bright(1))
    compiled = engine._programs._kept[1]._compiled
    assert compiled.get_property("NUM_STREAMS") == 2
    assert compiled.get_property("INFERENCE_NUM_THREADS") == 2
    assert not compiled.get_property("ENABLE_CPU_PINNING")


def test_importing_it_loads_no_converter_and_sends_nothing(tiny_model: Path) -> None:
    code = (
        "import sys, numpy as np; from yolino.inference import OpenVinoEngine;"
        f"OpenVinoEngine({str(tiny_model)!r})(np.zeros((1, 64, 128, 3), np.uint8));"
        "names = {'torch', 'onnx', 'onnxruntime', 'openvino_telemetry', 'openvino.tools.ovc'};"
        "assert not names & set(sys.modules), names & set(sys.modules);"
        "from openvino.tools.ovc import convert_model"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""


SIGNALS = """
import os, signal, sys
from yolino.inference import OpenVinoEngine
told = []
signal.signal(signal.SIGUSR1, lambda *arguments: told.append(1))
engines = [OpenVinoEngine(sys.argv[1]) for _ in range(3)]
while engines:
    engines.pop(0)
    os.kill(os.getpid(), signal.SIGUSR1)
print(len(told))
"""


@pytest.mark.skipif(not hasattr(signal, "SIGUSR1"), reason="needs signals as POSIX has them")
def test_signals_are_handled_after_engines_have_gone(tiny_model: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", SIGNALS, str(tiny_model)], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout.strip()) == (0, "3"), done.stderr
