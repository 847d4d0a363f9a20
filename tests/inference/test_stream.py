from __future__ import annotations

import dataclasses
import itertools
import struct
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import yolino
from yolino.header import Header
from yolino.inference import Predictor, load
from yolino.inference.stream import ImageResult, in_order, limited, stream
from yolino.io import read_image
from yolino.types import Output, Polylines, Segments

MEAN, LARGEST = 0.5, 20  # of 255: how far pixels of a JPEG decoded at half its size are from the slow twin


@pytest.fixture(autouse=True)
def _no_thread_is_left() -> Iterator[None]:
    yield
    assert own_threads() == []


def own_threads() -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name.startswith("yolino-")]


class Slow:
    """Sees one segment whose place and score depend on the pixels; dark images take longer."""

    def __init__(self, header: Header, *, streams: int = 1) -> None:
        self.header, self.streams = header, streams
        self.name, self.device, self.precision = "slow", "cpu", "fp32"
        self.inside = self.most = 0
        self._lock = threading.Lock()

    def __call__(self, batch: np.ndarray, /) -> Output:
        with self._lock:
            self.inside += 1
            self.most = max(self.most, self.inside)
        bright = batch.mean(axis=(1, 2, 3)).astype(np.float32)
        time.sleep(float(0.006 * (1 - bright[0] / 255)))
        with self._lock:
            self.inside -= 1
        if bright[0] == 13:
            raise ArithmeticError("thirteen")
        places = np.array([[1.0, 2.0], [9.0, 30.0]], np.float32)
        return Output(places + bright[:, None, None, None], 0.5 + bright[:, None] / 510, None)


def same(segments: Segments) -> Segments:
    return segments


def one_by_one(segments: Segments) -> Polylines:
    return Polylines.from_list(list(segments.endpoints), segments.scores, segments.labels)


def slow(header: Header, *, streams: int = 1) -> Predictor:
    return Predictor(Slow(header, streams=streams), nms=same, linker=one_by_one)


def plain(value: int, size: tuple[int, int] = (64, 128)) -> np.ndarray:
    return np.full((*size, 3), value, np.uint8)


def assert_same(found: ImageResult, wanted: Polylines) -> None:
    assert found.error is None
    for name in ("vertices", "offsets", "scores", "labels"):
        np.testing.assert_array_equal(getattr(found.polylines, name), getattr(wanted, name))


@pytest.mark.parametrize(("streams", "workers"), [(1, None), (1, 1), (1, 4), (3, None), (4, 4)])
def test_results_are_those_of_one_image_after_the_other(
    header: Header, streams: int, workers: int | None
) -> None:
    images = [plain(int(v)) for v in np.random.default_rng(0).permutation(np.arange(14, 74))]
    predictor = slow(header, streams=streams)
    found = list(predictor.stream(images, workers=workers))
    assert len(found) == len(images)
    for image, one in zip(images, found, strict=True):
        assert one.source is image
        assert one.size == (64, 128)
        assert set(one.milliseconds) == {"reading", "predicting"}
        assert one.milliseconds["predicting"] > 1
        assert_same(one, predictor(image))


@given(st.lists(st.integers(0, 9), max_size=30), st.integers(1, 5), st.integers(1, 9))
@settings(max_examples=30, deadline=None)
def test_order_is_kept_whatever_takes_how_long(items: list[int], workers: int, ahead: int) -> None:
    def work(item: int) -> int:
        time.sleep(item / 10_000)
        return item**2

    assert list(in_order(work, items, workers=workers, ahead=ahead)) == list(map(work, items))


@pytest.mark.parametrize(("streams", "workers"), [(1, 5), (2, 5), (3, 2)])
def test_no_more_threads_are_in_the_network_than_it_was_loaded_for(
    header: Header, streams: int, workers: int
) -> None:
    predictor = slow(header, streams=streams)
    list(stream(predictor, [plain(20)] * 30, workers=workers))
    assert predictor.engine.most == min(streams, workers)


def test_a_limited_predictor_is_otherwise_the_same(header: Header) -> None:
    predictor = slow(header, streams=2)
    shared = limited(predictor, 2)
    assert shared.engine.streams == predictor.engine.streams == 2
    assert shared.engine.name == "slow"
    assert type(predictor.engine) is Slow
    assert len(shared.stages(plain(90)).polylines) == 1


def test_several_images_are_under_way_at_once() -> None:
    meet = threading.Barrier(3, timeout=5)  # opens only for three threads together
    assert len(list(in_order(lambda _: meet.wait(), range(6), workers=3))) == 6


def test_few_images_are_under_way_even_if_there_is_no_end(header: Header) -> None:
    taken = 0

    def endless() -> Iterator[np.ndarray]:
        nonlocal taken
        while True:
            taken += 1
            yield plain(30)

    results = slow(header).stream(endless(), workers=2)
    for given_back in range(40):
        next(results)
        assert taken - given_back <= 6
    results.close()


def test_files_are_read_and_broken_ones_are_told_in_their_turn(header: Header, tmp_path: Path) -> None:
    for i in range(6):
        cv2.imwrite(str(tmp_path / f"{i}.png"), plain(20 * i + 20))
    (tmp_path / "2.png").write_bytes((tmp_path / "2.png").read_bytes()[:40])
    sources = [tmp_path / "0.png", str(tmp_path / "1.png"), tmp_path / "2.png", tmp_path / "none.png"]
    sources += [plain(60), np.zeros((3, 3)), tmp_path / "5.png"]
    predictor = slow(header)
    found = list(predictor.stream(sources))
    assert [one.source is source for one, source in zip(found, sources, strict=True)] == [True] * 7
    assert [one.error is None for one in found] == [True, True, False, False, True, False, True]
    for i, message in ((2, r"2.png is truncated"), (3, "There is no image file"), (5, "must be uint8|shape")):
        assert message.split("|")[0] in str(found[i].error)
        assert found[i].size == (0, 0)
        assert len(found[i].polylines) == 0
        assert found[i].milliseconds["predicting"] == 0
    assert_same(found[6], predictor(plain(120)))


def test_what_fails_in_the_network_ends_all_after_the_results_before_it(header: Header) -> None:
    images = [plain(v) for v in (20, 21, 22, 13, 24, 25)]
    results = slow(header, streams=3).stream(images)
    assert all(next(results).source is image for image in images[:3])
    with pytest.raises(ArithmeticError, match="thirteen"):
        next(results)


def test_what_fails_in_the_sources_ends_all_after_the_results_before_it(header: Header) -> None:
    def sources() -> Iterator[np.ndarray]:
        yield from [plain(20)] * 4
        raise OSError("the cable")

    results = slow(header).stream(sources(), workers=2)
    assert len([next(results) for _ in range(4)]) == 4
    with pytest.raises(OSError, match="the cable"):
        next(results)


@pytest.mark.parametrize("how", ["close", "throw", "forget"])
def test_no_thread_is_left_when_nobody_wants_more(header: Header, how: str) -> None:
    results = slow(header).stream((plain(20) for _ in itertools.count()), workers=3)
    next(results)
    assert len(own_threads()) == 3
    if how == "close":
        results.close()
    elif how == "throw":
        with pytest.raises(KeyboardInterrupt):
            results.throw(KeyboardInterrupt())
    else:
        del results
    assert own_threads() == []


def test_a_stream_that_nobody_reads_begins_nothing(header: Header) -> None:
    slow(header).stream([plain(20)])
    assert own_threads() == []


def test_wrong_arguments_are_refused(header: Header) -> None:
    predictor = slow(header)
    for single in ("a.jpg", plain(3), np.zeros((3, 4), np.uint8)):
        with pytest.raises(ValueError, match="give a list"):
            predictor.stream(single)
    with pytest.raises(ValueError, match="workers is 0"):
        predictor.stream([], workers=0)
    assert list(predictor.stream([])) == []
    assert len(list(predictor.stream(np.stack([plain(20)] * 3)))) == 3


def exif(data: bytes, orientation: int) -> bytes:
    """Gives a JPEG with an orientation."""
    tiff = b"II*\0" + struct.pack("<IHHHIHHI", 8, 1, 0x0112, 3, 1, orientation, 0, 0)
    block = b"Exif\0\0" + tiff
    return data[:2] + b"\xff\xe1" + struct.pack(">H", len(block) + 2) + block + data[2:]


def drawn(height: int, width: int) -> np.ndarray:
    """A picture with soft and hard edges, no symmetry."""
    y, x = np.mgrid[0:height, 0:width].astype(np.float64)
    soft = np.stack([40 + 150 * x / width, 60 + 120 * y / height, 128 + 80 * np.sin(x / 90 + y / 70)], axis=2)
    image = soft.round().astype(np.uint8)
    for k in range(1, 5):
        cv2.line(image, (k * width // 6, height), (width // 2, height // 3), (240, 240, 200), 7, cv2.LINE_AA)
    cv2.rectangle(image, (width // 9, height // 8), (width // 3, height // 3), (20, 90, 30), -1)
    return image


FILES: dict[str, Callable[[], bytes]] = {
    "gray.png": lambda: encode(".png", drawn(90, 160)[:, :, 0]),
    "deep.png": lambda: encode(".png", drawn(90, 160).astype(np.uint16) * 257),
    "alpha.png": lambda: encode(".png", cv2.cvtColor(drawn(90, 160), cv2.COLOR_BGR2BGRA)),
    "gray.jpg": lambda: encode(".jpg", drawn(128, 256)[:, :, 0]),
    "large.jpg": lambda: encode(".jpg", drawn(256, 512)),
    **{
        f"turned{k}.jpg": lambda k=k: exif(encode(".jpg", drawn(256, 512) if k < 5 else drawn(512, 256)), k)
        for k in (3, 6, 8)
    },
}


def encode(suffix: str, image: np.ndarray) -> bytes:
    return cv2.imencode(suffix, image)[1].tobytes()


@pytest.mark.parametrize("name", FILES)
def test_files_of_all_kinds_are_those_that_read_image_gives(
    header: Header, tmp_path: Path, name: str
) -> None:
    (tmp_path / name).write_bytes(FILES[name]())
    predictor = slow(header)
    (found,) = predictor.stream([tmp_path / name])
    image = read_image(tmp_path / name)
    assert found.size == image.shape[:2]
    assert_same(found, predictor(image))


@pytest.mark.parametrize("name", FILES)
def test_reduced_files_give_the_same_within_the_bound(header: Header, tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(FILES[name]())
    predictor = slow(header)
    (found,) = predictor.stream([tmp_path / name], reduced=True)
    image = read_image(tmp_path / name)
    wanted = predictor(image)
    assert found.size == image.shape[:2]
    # This network puts its segment a pixel farther for each gray level of the mean.
    scale = image.shape[1] / 128
    np.testing.assert_allclose(found.polylines.vertices, wanted.vertices, atol=MEAN * scale)
    np.testing.assert_allclose(found.polylines.scores, wanted.scores, atol=MEAN / 255)


class Keeper(Slow):
    """Keeps what it sees."""

    def __call__(self, batch: np.ndarray, /) -> Output:
        self.seen = batch.copy()
        return super().__call__(batch)


@pytest.mark.parametrize(
    ("size", "fit", "reduction"),
    [
        ((720, 1280), "bottom", 2),
        ((1440, 2560), "bottom", 4),
        ((720, 1280), "stretch", 2),
        ((1440, 2560), "letterbox", 4),
        ((719, 1280), "bottom", 1),  # blocks would hang over the edge
        ((718, 1278), "letterbox", 2),
        ((1436, 2556), "letterbox", 4),
        ((360, 640), "bottom", 1),
        ((400, 1100), "bottom", 1),
    ],
)
@pytest.mark.parametrize("orientation", [1, 6])
def test_the_network_sees_the_same_within_the_bound(
    header: Header, tmp_path: Path, size: tuple[int, int], fit: str, reduction: int, orientation: int
) -> None:
    """The slow twin decodes all pixels, then fits them to the network."""
    image = cv2.GaussianBlur(drawn(*size), (0, 0), 1.0)  # as a lens draws it
    stored = np.rot90(image) if orientation == 6 else image  # turned back by a quarter clockwise
    path = tmp_path / "a.jpg"
    path.write_bytes(exif(encode(".jpg", np.ascontiguousarray(stored)), orientation))
    engine = Keeper(dataclasses.replace(header, size=(320, 640), fit=fit))
    predictor = Predictor(engine, nms=same, linker=one_by_one)
    full = read_image(path)
    assert full.shape[:2] == size
    wanted, _ = predictor.preprocess(full)
    (found,) = predictor.stream([path], reduced=True)
    assert found.size == size
    difference = np.abs(engine.seen[0].astype(int) - wanted)
    if reduction == 1:
        assert difference.max() == 0
    else:
        assert 0 < difference.mean() <= MEAN
        assert difference.max() <= LARGEST


def test_real_frames_are_the_same_within_the_bound(tusimple_root: Path) -> None:
    """Where the network sees the same, it finds the same lines (the docs give their scores)."""
    frames = sorted(tusimple_root.glob("clips/0531/*/20.jpg"))[:6]
    assert frames
    predictor = load(device="cpu", threads=1)
    for full, reduced in zip(predictor.stream(frames), predictor.stream(frames, reduced=True), strict=True):
        assert full.size == reduced.size == (720, 1280)
        whole, _ = predictor.preprocess(read_image(Path(str(full.source))))
        half, _ = predictor.preprocess(read_image(Path(str(full.source)), reduce=2))
        difference = np.abs(whole.astype(int) - half)
        assert difference.mean() <= MEAN
        assert difference.max() <= LARGEST
        assert_same(full, predictor(read_image(Path(str(full.source)))))
        assert abs(len(full.polylines) - len(reduced.polylines)) <= 1


def test_the_door_of_the_package(tiny_model: Path, tmp_path: Path) -> None:
    for i in range(3):
        cv2.imwrite(str(tmp_path / f"{i}.png"), plain(200 * (i != 1), (256, 256)))
    results = yolino.load(tiny_model, streams=2).stream(sorted(tmp_path.glob("*.png")))
    assert [len(one.polylines) for one in results] == [2, 0, 2]
