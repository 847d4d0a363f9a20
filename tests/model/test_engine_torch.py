"""The torch engine beyond what all engines share: precisions, threads, and programs for fixed batch sizes."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from yolino.header import Header
from yolino.model import engine as engines
from yolino.model import programs
from yolino.model.checkpoint import save_checkpoint
from yolino.model.engine import Exportable, TorchEngine
from yolino.model.network import Network
from yolino.model.programs import EagerProgram, GraphProgram, StaticPrograms, exact_convolutions, record

ARGUMENTS = {
    "backbone": "residual",
    "backbone_args": {"widths": [8, 8, 8, 8], "blocks": [1, 1, 1, 1], "stem": 4},
    "neck_width": 8,
    "predictors": 2,
}
HEADER = Header("0", "tiny", (64, 96), 16, 2, "po")


@pytest.fixture(autouse=True)
def threads_as_before() -> Iterator[None]:
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


@pytest.fixture
def checkpoint(tmp_path: Path) -> Path:
    torch.manual_seed(0)
    path = tmp_path / "tiny.safetensors"
    save_checkpoint(path, Network(**ARGUMENTS).eval().state_dict(), HEADER, ARGUMENTS)
    return path


def pixels(count: int) -> np.ndarray:
    return np.random.default_rng(count).integers(0, 256, (count, 64, 96, 3), dtype=np.uint8)


class Sums(torch.nn.Module):
    """Gives the sum of each image, and notes how many images came."""

    def __init__(self) -> None:
        super().__init__()
        self.counts: list[int] = []

    def forward(self, images: torch.Tensor) -> tuple[torch.Tensor]:
        self.counts.append(len(images))
        return (images.float().sum(dim=(1, 2, 3)),)


def test_weights_are_rounded_once_and_decoding_is_exact(checkpoint: Path) -> None:
    engine = TorchEngine(checkpoint, device="cpu", precision="bf16")
    network = engine.graph.network
    assert network.head.weight.dtype == torch.bfloat16
    norms = [m for m in network.modules() if isinstance(m, torch.nn.BatchNorm2d)]
    assert norms
    assert all(norm.weight.dtype == torch.float32 for norm in norms)
    output = engine(pixels(2))
    assert output.endpoints.dtype == output.scores.dtype == np.float32
    points = torch.from_numpy(output.endpoints)
    assert (points != points.bfloat16().float()).float().mean() > 0.5


def test_a_network_in_memory_stays_as_it_is() -> None:
    network = Network(**ARGUMENTS).eval()
    before = {name: (value.dtype, value.stride()) for name, value in network.state_dict().items()}
    engine = TorchEngine.of(network, HEADER)
    assert engine(pixels(1)).scores.shape == (1, 48)
    assert {name: (value.dtype, value.stride()) for name, value in network.state_dict().items()} == before
    with torch.no_grad():
        network.head.bias.add_(1)
    assert not np.array_equal(
        engine(pixels(1)).scores, TorchEngine.of(Network(**ARGUMENTS), HEADER)(pixels(1)).scores
    )


def test_weights_lie_as_the_images_do(checkpoint: Path) -> None:
    head = TorchEngine(checkpoint, device="cpu").graph.network.backbone
    kernels = [p for p in head.parameters() if p.ndim == 4 and p.shape[2] > 1]
    assert kernels
    assert all(kernel.is_contiguous(memory_format=torch.channels_last) for kernel in kernels)


def test_streams_share_the_threads(checkpoint: Path) -> None:
    for threads, streams, wanted in ((4, 2, 2), (1, 4, 1), (3, 1, 3)):
        TorchEngine(checkpoint, device="cpu", threads=threads, streams=streams)
        assert torch.get_num_threads() == wanted
    for _ in range(2):  # opening another one does not halve them again
        TorchEngine(checkpoint, device="cpu", streams=2)
        assert torch.get_num_threads() == max(1, engines._THREADS // 2)


def test_what_torch_does_not_have_is_refused(checkpoint: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ValueError, match="torch has no precision 'int8'; use auto, fp32, bf16, fp16"):
        TorchEngine(checkpoint, precision="int8")
    if not torch.cuda.is_available():
        with pytest.raises(ValueError, match="finds no GPU; use --device cpu"):
            TorchEngine(checkpoint, device="cuda")
    monkeypatch.setattr(engines.shutil, "which", lambda name: None)
    with pytest.raises(
        ValueError, match=r"torch-compiled needs a C\+\+ compiler .* or take the engine torch"
    ):
        TorchEngine(checkpoint, device="cpu", compiled=True)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 8, 9, 20])
def test_a_batch_is_filled_up_to_a_power_of_two(count: int) -> None:
    network = Sums()
    run = StaticPrograms(lambda size: EagerProgram(network, "cpu"), largest=8)
    images = pixels(count)
    (found,) = run(images)
    np.testing.assert_array_equal(found, images.reshape(count, -1).sum(axis=1).astype(np.float32))
    assert all(size in (1, 2, 4, 8) for size in network.counts)
    assert sum(network.counts) < 2 * count


def test_there_is_one_program_for_each_size_however_often_it_runs() -> None:
    made: list[int] = []

    def make(size: int) -> programs.Program:
        made.append(size)
        return EagerProgram(Sums(), "cpu")

    run = StaticPrograms(make, largest=4)
    for count in (3, 4, 1, 2, 9, 3, 1):
        assert run(pixels(count))[0].shape == (count,)
    assert made == [4, 1, 2]


def test_an_empty_batch_gives_nothing() -> None:
    (found,) = StaticPrograms(lambda size: EagerProgram(Sums(), "cpu"))(np.zeros((0, 4, 4, 3), np.uint8))
    assert found.shape == (0,)


@pytest.mark.parametrize("streams", [1, 2])
def test_a_program_runs_in_one_thread_at_a_time(streams: int) -> None:
    running, most, made = [0], [0], [0]
    lock = threading.Lock()

    def make(size: int) -> programs.Program:
        made[0] += 1
        busy = [False]

        def program(images: np.ndarray) -> list[np.ndarray]:
            assert not busy[0]
            busy[0] = True
            with lock:
                running[0] += 1
                most[0] = max(most[0], running[0])
            time.sleep(0.005)
            with lock:
                running[0] -= 1
            busy[0] = False
            return [images[:, 0, 0, 0].copy()]

        return program

    run = StaticPrograms(make, streams=streams)
    results: list[bool] = []

    def work(value: int) -> None:
        for _ in range(5):
            results.append(bool((run(np.full((1, 2, 2, 3), value, np.uint8))[0] == value).all()))

    threads = [threading.Thread(target=work, args=(value,)) for value in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert results == [True] * 20
    assert most[0] <= streams
    assert made[0] <= streams


def test_a_program_that_fails_is_free_again() -> None:
    def make(size: int) -> programs.Program:
        def program(images: np.ndarray) -> list[np.ndarray]:
            if images.max() > 0:
                raise RuntimeError("too bright")
            return [images]

        return program

    run = StaticPrograms(make)
    for _ in range(2):
        with pytest.raises(RuntimeError, match="too bright"):
            run(np.ones((1, 2, 2, 3), np.uint8))
    assert run(np.zeros((1, 2, 2, 3), np.uint8))[0].shape == (1, 2, 2, 3)


class FakeGraph:
    """Stands for a CUDA graph: what was recorded runs again on `replay`, into the same memory."""

    last: FakeGraph

    def __init__(self) -> None:
        self.replay = lambda: None
        FakeGraph.last = self


@pytest.fixture
def fake_gpu(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Lets the processor play the GPU; gives what was called."""
    calls: list[str] = []
    stream = SimpleNamespace(
        wait_stream=lambda other: calls.append("wait"), synchronize=lambda: calls.append("synchronize")
    )

    @contextlib.contextmanager
    def capture(graph: FakeGraph, **options: object) -> Iterator[None]:
        assert options["capture_error_mode"] == "thread_local"
        calls.append("record")
        yield

    monkeypatch.setattr(programs, "_pinned", lambda shape, dtype: torch.empty(shape, dtype=dtype))
    for name, value in (
        ("Stream", lambda device: stream),
        ("current_stream", lambda device: stream),
        ("stream", lambda stream: contextlib.nullcontext()),
        ("CUDAGraph", FakeGraph),
        ("graph", capture),
    ):
        monkeypatch.setattr(torch.cuda, name, value)
    return calls


def test_a_recorded_network_uses_the_same_memory_and_gives_copies(fake_gpu: list[str]) -> None:
    network = Sums()
    program = GraphProgram(network, (2, 64, 96, 3), "cpu")
    assert network.counts == [2] * 4  # three to warm up, one that is recorded
    assert fake_gpu == ["wait", "synchronize", "record"]
    FakeGraph.last.replay = lambda: program._outputs[0].copy_(network(program._images)[0])
    images = pixels(2)
    (first,) = program(images)
    assert fake_gpu[-1] == "synchronize"
    wanted = images.reshape(2, -1).sum(axis=1).astype(np.float32)
    np.testing.assert_array_equal(first, wanted)
    (second,) = program(np.zeros_like(images))
    np.testing.assert_array_equal(second, 0)
    np.testing.assert_array_equal(first, wanted)


def test_a_network_that_cannot_be_recorded_runs_step_by_step(
    fake_gpu: list[str], caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert isinstance(record(Sums(), (1, 4, 4, 3), "cpu"), GraphProgram)

    def fail(graph: FakeGraph, **options: object) -> None:
        raise RuntimeError("operation not permitted when stream is capturing")

    monkeypatch.setattr(torch.cuda, "graph", fail)
    program = record(Sums(), (1, 4, 4, 3), "cpu")
    assert isinstance(program, EagerProgram)
    assert "runs step by step, as it cannot be a CUDA graph: operation not permitted" in caplog.text
    assert program(np.ones((1, 4, 4, 3), np.uint8))[0] == [48]

    def full(graph: FakeGraph, **options: object) -> None:
        raise torch.cuda.OutOfMemoryError("full")

    monkeypatch.setattr(torch.cuda, "graph", full)
    with pytest.raises(torch.cuda.OutOfMemoryError):
        record(Sums(), (1, 4, 4, 3), "cpu")


def test_float32_is_not_rounded_to_tf32() -> None:
    before = torch.backends.cudnn.allow_tf32
    with exact_convolutions():
        assert not torch.backends.cudnn.allow_tf32
    assert torch.backends.cudnn.allow_tf32 == before


def test_the_exported_graph_is_that_of_fp32() -> None:
    network = Network(**ARGUMENTS).eval()
    graph = Exportable(network, HEADER.size)
    with torch.inference_mode():
        endpoints, scores = graph(torch.from_numpy(pixels(1)))
    assert endpoints.shape == (1, 48, 2, 2)
    assert scores.shape == (1, 48)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
@pytest.mark.parametrize("precision", ["fp32", "bf16", "fp16"])
def test_a_gpu_gives_what_the_processor_gives(checkpoint: Path, precision: str) -> None:
    images = pixels(5)
    wanted = TorchEngine(checkpoint, device="cpu")(images)
    engine = TorchEngine(checkpoint, device="cuda", precision=precision, streams=2)
    bounds = (1e-3, 1e-4) if precision == "fp32" else (0.1, 0.01)
    for count in (5, 1, 2, 5):
        found = engine(images[:count])
        np.testing.assert_allclose(found.endpoints, wanted.endpoints[:count], rtol=0, atol=bounds[0])
        np.testing.assert_allclose(found.scores, wanted.scores[:count], rtol=0, atol=bounds[1])
