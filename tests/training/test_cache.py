"""Decoded pixels are those of decoding, exactly, and are written once, whole or not at all."""

from __future__ import annotations

import multiprocessing
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from yolino.config import load_experiment
from yolino.datasets import Synthetic
from yolino.datasets.convert import convert
from yolino.training import cache as cache_module
from yolino.training.augment import PRESETS, Augment
from yolino.training.cache import PixelCache, expected
from yolino.training.frames import CachedFrames, Frames
from yolino.training.loaders import build_loaders
from yolino.types import Polylines, Sample

SIZE = (96, 192)


def picture(size: tuple[int, int], seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (*size, 3), np.uint8)


def frames_in(folder: Path, fit: str = "bottom") -> CachedFrames:
    return CachedFrames(PixelCache(folder), SIZE, fit)


def written(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.npy"))


@pytest.mark.parametrize("preset", list(PRESETS))
@pytest.mark.parametrize("fit", ["bottom", "letterbox", "stretch"])
@pytest.mark.parametrize(
    ("name", "size"),
    [("a.jpg", (216, 384)), ("a.jpg", (217, 391)), ("a.png", (216, 384)), ("a.webp", (99, 401))],
)
def test_cached_and_uncached_examples_are_equal(
    tmp_path: Path, preset: str, fit: str, name: str, size: tuple[int, int]
) -> None:
    cv2.imwrite(str(tmp_path / name), picture(size))
    line = Polylines.from_list([np.array([[10.0, 200.0], [150.0, 20.0]])])
    sample = Sample("a", tmp_path / name, line)
    plain = Augment(SIZE, fit=fit, **PRESETS[preset])
    cached = Augment(SIZE, fit=fit, **PRESETS[preset], frames=frames_in(tmp_path / "decoded", fit))
    for seed in (0, 1, 2, 0, 1, 2):
        a, b = (augment(sample, np.random.default_rng(seed)) for augment in (plain, cached))
        assert np.array_equal(a.image, b.image)
        assert np.array_equal(a.polylines.vertices, b.polylines.vertices)
    assert len(written(tmp_path / "decoded")) <= 1


@pytest.mark.parametrize("reduce", [1, 2, 4])
def test_only_the_scale_of_the_plain_fit_is_kept(tmp_path: Path, reduce: int) -> None:
    file, size = tmp_path / "a.jpg", (192, 384)  # twice the network's input
    cv2.imwrite(str(file), picture(size))
    found = frames_in(tmp_path / "decoded").pixels(file, reduce, size)
    assert np.array_equal(found, Frames().pixels(file, reduce, size))
    assert len(written(tmp_path / "decoded")) == (reduce == 2)


def test_a_file_is_decoded_once(tmp_path: Path) -> None:
    file, calls = tmp_path / "a.jpg", []
    file.write_bytes(b"x")

    def decode() -> np.ndarray:
        calls.append(1)
        return picture((4, 6))

    for _ in range(3):  # a new object each time, as in another process
        assert np.array_equal(PixelCache(tmp_path / "d")(file, "reduce 2", decode), picture((4, 6)))
    assert len(calls) == 1
    PixelCache(tmp_path / "d")(file, "reduce 4", decode)
    assert len(calls) == 2


def test_a_changed_file_is_decoded_anew_and_its_size_read_again(tmp_path: Path) -> None:
    file, frames = tmp_path / "a.png", frames_in(tmp_path / "decoded")
    for size in ((96, 192), (192, 384)):
        cv2.imwrite(str(file), picture(size))
        assert frames.size(file) == size
        assert np.array_equal(
            frames.pixels(file, size[0] // 96, size), Frames().pixels(file, size[0] // 96, size)
        )
    assert len(written(tmp_path / "decoded")) == 2


def test_a_damaged_file_is_written_anew(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    file, frames = tmp_path / "a.png", frames_in(tmp_path / "decoded")
    cv2.imwrite(str(file), picture(SIZE))
    frames.pixels(file, 1, SIZE)
    (kept,) = written(tmp_path / "decoded")
    whole = kept.read_bytes()
    for part in (whole[:-100], whole[:20], b""):
        kept.write_bytes(part)
        assert np.array_equal(frames.pixels(file, 1, SIZE), picture(SIZE)[..., ::-1])
        assert kept.read_bytes() == whole
    assert "damaged" in caplog.text


def fill(folder: Path, images: list[Path], together: Any) -> None:
    frames = frames_in(folder)
    together.wait()
    for image in images:
        assert np.array_equal(frames.pixels(image, 1, SIZE), Frames().pixels(image, 1, SIZE))


def test_processes_fill_one_folder_at_the_same_time(tmp_path: Path) -> None:
    images = [tmp_path / f"{i}.png" for i in range(6)]
    for i, image in enumerate(images):
        cv2.imwrite(str(image), picture(SIZE, i))
    context = multiprocessing.get_context("fork")
    together = context.Barrier(3)
    processes = [context.Process(target=fill, args=(tmp_path / "d", images, together)) for _ in range(3)]
    for process in processes:
        process.start()
    for process in processes:
        process.join(60)
    assert [process.exitcode for process in processes] == [0, 0, 0]
    assert len(list((tmp_path / "d").iterdir())) == len(images)  # and nothing temporary


def test_what_it_takes_is_estimated(tmp_path: Path) -> None:
    class Files(list[Sample]):
        classes, directed = ("line",), True

    images = []
    for i in range(50):
        cv2.imwrite(str(tmp_path / f"{i}.png"), picture((96, 192)))
        images.append(tmp_path / f"{i}.png")
    files = Files(Sample(p.name, p, Polylines.from_list([])) for p in images)
    frames = frames_in(tmp_path / "decoded")
    assert expected(files, frames.bytes_of) == (50 * 3 * 96 * 192, 50 * 3 * 96 * 192)
    for image in images[:25]:
        frames.pixels(image, 1, SIZE)
    total, missing = expected(files, frames.bytes_of)
    assert 0.4 < missing / total < 0.6
    drawn = Files([Sample("a", picture((4, 4)), Polylines.from_list([]))])
    assert expected(drawn, frames.bytes_of) == (0, 0)
    assert expected(Files(), frames.bytes_of) == (0, 0)


@pytest.fixture
def experiment(tmp_path: Path) -> Any:
    """An experiment on three PNG files."""
    convert(Synthetic("shapes", length=3, size=(192, 384)), "geojson", tmp_path / "drawn")
    config = tmp_path / "files.yaml"
    source = f"{{dataset: geojson, options: {{root: {tmp_path / 'drawn'}}}}}"
    config.write_text(
        f"name: files\nout: {tmp_path / 'runs'}\n"
        f"data: {{size: [96, 192], cache: true, train: [{source}], val: [{source}]}}\n"
        "training: {batch_size: 2, validate_every: 3, workers: 1}\n"
    )
    return lambda *changes: load_experiment(config, changes)


def test_training_says_what_it_writes_and_gives_the_same_batches(
    experiment: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level("INFO", logger="yolino"):
        cached, _ = build_loaders(experiment(), border=False)
        assert not written(tmp_path / "runs" / "decoded")
    assert "decoded images and drawn scenes take 0 MB" in caplog.text
    plain, _ = build_loaders(experiment("data.cache=false", "training.workers=0"), border=False)
    for a, b in zip(plain, cached, strict=True):
        assert np.array_equal(a.images.numpy(), b.images.numpy())
    assert 1 <= len(written(tmp_path / "runs" / "decoded")) <= 3


def test_nothing_is_written_unasked(experiment: Any, tmp_path: Path) -> None:
    loader, _ = build_loaders(experiment("data.cache=false", "training.workers=0"), border=False)
    list(loader)
    assert not (tmp_path / "runs").exists()


def test_a_disk_too_small_is_told_before(experiment: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: shutil._ntuple_diskusage(10**9, 10**9, 0))
    with pytest.raises(
        OSError, match=r"would take 0 MB more in .*decoded, but 0 MB are free.*without data\.cache"
    ):
        build_loaders(experiment(), border=False)


def test_a_place_that_cannot_be_written_is_told_before(experiment: Any, tmp_path: Path) -> None:
    (tmp_path / "runs").write_text("a file")
    with pytest.raises(OSError, match=r"cannot be kept in .*decoded: .*\. Give another folder") as caught:
        build_loaders(experiment(), border=False)
    assert "\n" not in str(caught.value)


def test_a_disk_that_fills_up_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, data: bytes) -> None:
        raise OSError(f"{path} cannot be written: No space left on device.")

    monkeypatch.setattr(cache_module, "write_atomic", full)
    file = tmp_path / "a.png"
    cv2.imwrite(str(file), picture(SIZE))
    with pytest.raises(OSError, match=r"No space left on device.* free some space"):
        frames_in(tmp_path).pixels(file, 1, SIZE)
