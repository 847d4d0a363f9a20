"""What every engine keeps: iterates over `ENGINES`, so a new one is tested the moment it is added."""

from __future__ import annotations

import functools
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from yolino.header import Header
from yolino.inference import ENGINES, Engine, open_engine
from yolino.inference.engine_openvino import _precisions, import_openvino, openvino_core
from yolino.types import Output

torch = pytest.importorskip("torch", reason="torch is the engine that the others must equal")
pytest.importorskip("onnx", reason="onnx writes the files of this test")

HEADER = Header("0", "tiny", (64, 96), 16, 2, "po", classes=("a", "b", "c"), postprocess={"threshold": 0.25})
NETWORK = {
    "backbone": "residual",
    "backbone_args": {"widths": [8, 8, 8, 8], "blocks": [1, 1, 1, 1], "stem": 4},
    "neck_width": 8,
    "predictors": 2,
    "num_classes": 3,
}
CASES = [(name, suffix) for name, kind in ENGINES.items() for suffix in kind.suffixes]
HALF_PX, HALF_SCORE = 0.1, 0.01  # what 16 bits may change here; the end points are up to 96 px

Files = dict[str, Path]
Open = Callable[..., Engine]


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Files:
    """One network in every format."""
    from yolino.export.graph import onnx_bytes
    from yolino.model.checkpoint import save_checkpoint
    from yolino.model.network import Network

    folder = tmp_path_factory.mktemp("engines")
    torch.manual_seed(0)
    network = Network(**NETWORK).eval()
    found = {suffix: folder / f"tiny{suffix}" for suffix in (".safetensors", ".onnx", ".xml")}
    save_checkpoint(found[".safetensors"], network.state_dict(), HEADER, NETWORK)
    found[".onnx"].write_bytes(onnx_bytes(network, HEADER))
    if ENGINES["openvino"].missing is None:
        write_openvino(found[".onnx"], found[".xml"], HEADER.to_json())
    return found


def write_openvino(source: Path, target: Path, header: str | None) -> None:
    runtime = import_openvino()
    model = openvino_core().read_model(str(source))
    if header is not None:
        model.set_rt_info(header, ["yolino", "header"])
    runtime.save_model(model, str(target), compress_to_fp16=False)


@pytest.fixture
def images() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (5, *HEADER.size, 3), dtype=np.uint8)


@pytest.fixture(params=CASES, ids=[f"{name}{suffix}" for name, suffix in CASES])
def opened(request: pytest.FixtureRequest, files: Files, monkeypatch: pytest.MonkeyPatch) -> Iterator[Open]:
    """Opens the network with each engine, from each of its files."""
    name, suffix = request.param
    if (missing := ENGINES[name].missing) is not None:
        pytest.skip(f"{missing} is not installed")
    if name == "torch-compiled":  # the compiler takes minutes: it has a test of its own, below
        monkeypatch.setattr(torch, "compile", lambda graph, **_: graph)
    threads = torch.get_num_threads()
    yield functools.partial(open_engine, files[suffix], engine=name, device="cpu")
    torch.set_num_threads(threads)


@pytest.fixture
def expected(files: Files, images: np.ndarray) -> Output:
    return open_engine(files[".safetensors"], engine="torch", device="cpu")(images)


def assert_close(found: Output, expected: Output, pixels: float = 1e-3, score: float = 1e-4) -> None:
    assert all(part is not None and part.dtype == np.float32 for part in found)
    np.testing.assert_allclose(found.endpoints, expected.endpoints, rtol=0, atol=pixels)
    np.testing.assert_allclose(found.scores, expected.scores, rtol=0, atol=score)
    np.testing.assert_allclose(found.probabilities, expected.probabilities, rtol=0, atol=score)


def test_it_says_what_it_is(opened: Open) -> None:
    engine = opened(threads=1)
    assert isinstance(engine, Engine)
    assert (engine.header, engine.device, engine.precision) == (HEADER, "cpu", "fp32")
    assert engine.name.endswith("fp32")


def test_it_equals_the_torch_engine(opened: Open, images: np.ndarray, expected: Output) -> None:
    assert_close(opened()(images), expected)


def test_batches_of_any_size_give_the_same(opened: Open, images: np.ndarray, expected: Output) -> None:
    engine = opened()
    for count in (1, 2, 5, 1, 3, 4):
        part = Output(*(None if values is None else values[:count] for values in expected))
        assert_close(engine(images[:count]), part)


@pytest.mark.parametrize("precision", ["bf16", "fp16"])
def test_sixteen_bits_stay_within_a_tenth_of_a_pixel(
    opened: Open, images: np.ndarray, expected: Output, precision: str
) -> None:
    name = opened.keywords["engine"]  # type: ignore[attr-defined]
    if precision not in ENGINES[name].precisions["cpu"]:
        with pytest.raises(ValueError, match=rf"has no precision '{precision}'; it has .*fp32"):
            opened(precision=precision)
        return
    if name == "openvino" and precision not in _precisions(openvino_core()):
        with pytest.raises(ValueError, match=f"on this processor cannot run in {precision}; it has fp32"):
            opened(precision=precision)
        return
    engine = opened(precision=precision)
    assert engine.precision == precision
    assert_close(engine(images), expected, HALF_PX, HALF_SCORE)


def test_outputs_belong_to_the_caller(opened: Open, images: np.ndarray) -> None:
    engine = opened()
    first = engine(images[:2])
    kept = [part.copy() for part in first if part is not None]
    for part in engine(images[2:4]):
        assert part is not None
        assert part.flags.writeable
        part[:] = -1
    for part, copy in zip(first, kept, strict=True):
        np.testing.assert_array_equal(part, copy)


def test_the_images_are_not_changed(opened: Open, images: np.ndarray) -> None:
    before = images.copy()
    images.flags.writeable = False
    opened()(images[::2])
    np.testing.assert_array_equal(images, before)


@pytest.mark.parametrize("streams", [1, 2])
def test_threads_at_once_give_what_one_gives(opened: Open, images: np.ndarray, streams: int) -> None:
    engine = opened(threads=2, streams=streams)
    alone = [engine(images[i : i + 1]) for i in range(4)]
    found: dict[tuple[int, int], Output] = {}

    def work(thread: int) -> None:
        for repeat in range(6):
            i = (thread + repeat) % 4
            found[thread, repeat] = engine(images[i : i + 1])

    threads = [threading.Thread(target=work, args=(thread,)) for thread in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 12
    for (thread, repeat), output in found.items():
        assert_close(output, alone[(thread + repeat) % 4], 1e-4, 1e-5)


def test_images_of_another_size_are_refused(opened: Open) -> None:
    with pytest.raises(ValueError, match=r"takes images of \(64, 96\) .*got \(64, 64\)"):
        opened()(np.zeros((1, 64, 64, 3), np.uint8))


REFUSED = """
import sys
import numpy as np
from yolino.inference import open_engine
for file, name in zip(sys.argv[1::2], sys.argv[2::2]):
    if name == "torch-compiled":
        import torch
        torch.compile = lambda graph, **_: graph
    engine = open_engine(file, engine=name, device="cpu")
    good = np.zeros((1, *engine.header.size, 3), np.uint8)
    for batch in (good.astype(np.float32), good[0], good[:0], good[..., :1]):
        try:
            engine(batch)
        except ValueError as error:
            print(error)
"""


def test_what_is_no_batch_of_images_is_refused_in_one_line(files: Files) -> None:
    """In a process of its own, without the checks of types in these tests."""
    there = [(name, suffix) for name, suffix in CASES if ENGINES[name].missing is None]
    arguments = [text for name, suffix in there for text in (str(files[suffix]), name)]
    done = subprocess.run(
        [sys.executable, "-c", REFUSED, *arguments], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    start = "The network takes a batch of at least one RGB image, uint8 (b, h, w, 3), got "
    kinds = (
        "float32 (1, 64, 96, 3).",
        "uint8 (64, 96, 3).",
        "uint8 (0, 64, 96, 3).",
        "uint8 (1, 64, 96, 1).",
    )
    assert done.stdout.splitlines() == [start + kind for kind in kinds] * len(there)


def test_a_damaged_file_is_one_line(opened: Open, tmp_path: Path) -> None:
    file = opened.args[0]  # type: ignore[attr-defined]
    half = tmp_path / f"half{file.suffix}"
    half.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    half.with_suffix(".bin").touch()
    with pytest.raises(ValueError, match=r"half\.(xml|onnx|safetensors)") as caught:
        open_engine(half, engine=opened.keywords["engine"])  # type: ignore[attr-defined]
    assert "\n" not in str(caught.value)


def test_arguments_that_are_not_allowed_are_refused(opened: Open) -> None:
    for arguments, message in (
        ({"threads": 0}, "threads is 0"),
        ({"streams": 0}, "streams is 0"),
        ({"precision": "int8"}, "int8"),
        ({"precision": "half"}, "precision 'half' is unknown; use one of auto, fp32"),
    ):
        with pytest.raises(ValueError, match=message):
            opened(**arguments)


@pytest.mark.parametrize("streams", [1, 2])
def test_no_more_threads_than_asked_for(opened: Open, streams: int) -> None:
    assert opened(threads=1, streams=streams)(np.zeros((1, *HEADER.size, 3), np.uint8)).scores.shape == (
        1,
        48,
    )


@pytest.mark.skipif(
    "YOLINO_TEST_COMPILER" not in os.environ, reason="takes minutes; set YOLINO_TEST_COMPILER"
)
def test_the_compiler_changes_nothing(files: Files) -> None:
    code = (  # in a process of its own: the compiler cannot look through the checks of types in these tests
        "import numpy as np; from yolino.inference import open_engine;"
        f"file = {str(files['.safetensors'])!r};"
        f"images = np.random.default_rng(0).integers(0, 256, (3, *{HEADER.size}, 3), dtype=np.uint8);"
        "one, other = (open_engine(file, engine=e, device='cpu') for e in ('torch', 'torch-compiled'));"
        "assert other.name == 'torch compiled fp32';"
        "assert all(np.allclose(a, b, atol=1e-4) for a, b in zip(one(images), other(images)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
