"""Reduced reading and silence; what else is read, and what is refused, is in test_io."""

from __future__ import annotations

import struct
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest

from yolino.decoding import quiet, read_image, read_reduced


def smooth(height: int, width: int) -> np.ndarray:
    y, x = np.mgrid[0:height, 0:width].astype(np.float64)
    parts = [40 + 150 * x / width, 60 + 120 * y / height, 128 + 80 * np.sin(x / 40 + y / 30)]
    return np.stack(parts, axis=2).round().astype(np.uint8)


def jpeg(path: Path, image: np.ndarray, orientation: int = 1) -> Path:
    data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
    tiff = b"MM\0*" + struct.pack(">IHHHIHHI", 8, 1, 0x0112, 3, 1, orientation, 0, 0)
    block = b"Exif\0\0" + tiff
    path.write_bytes(data[:2] + b"\xff\xe1" + struct.pack(">H", len(block) + 2) + block + data[2:])
    return path


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
@pytest.mark.parametrize("reduce", [1, 2, 4, 8])
def test_a_reduced_jpeg_is_the_mean_of_blocks(tmp_path: Path, orientation: int, reduce: int) -> None:
    """The slow twin decodes all pixels."""
    path = jpeg(tmp_path / "a.jpg", smooth(128, 256), orientation)
    sizes = []

    def reduction(size: tuple[int, int]) -> int:
        sizes.append(size)
        return reduce

    image, reduced = read_reduced(path, reduction)
    full = read_image(path).astype(np.float64)
    assert sizes == [full.shape[:2]] == [(256, 128) if orientation >= 5 else (128, 256)]
    assert reduced == reduce
    rows, columns = full.shape[0] // reduce, full.shape[1] // reduce
    blocks = full.reshape(rows, reduce, columns, reduce, 3).mean(axis=(1, 3))
    assert image.shape == blocks.shape
    assert np.abs(image - blocks).max() <= 3
    assert np.abs(image - blocks).mean() <= 0.6


@pytest.mark.parametrize(
    ("size", "wanted", "reduced"),
    [((64, 96), 8, 8), ((64, 92), 8, 4), ((66, 96), 8, 2), ((65, 96), 8, 1), ((66, 98), 2, 2)],
)
def test_no_block_hangs_over_the_edge(
    tmp_path: Path, size: tuple[int, int], wanted: int, reduced: int
) -> None:
    image, reduction = read_reduced(jpeg(tmp_path / "a.jpg", smooth(*size)), lambda _: wanted)
    assert reduction == reduced
    assert image.shape == (size[0] // reduced, size[1] // reduced, 3)


def test_other_files_are_read_whole(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), smooth(64, 96))
    image, reduced = read_reduced(tmp_path / "a.png", lambda _: 8)
    assert reduced == 1
    np.testing.assert_array_equal(image, read_image(tmp_path / "a.png"))


def test_what_cannot_be_read_is_told_as_ever(tmp_path: Path) -> None:
    path = jpeg(tmp_path / "a.jpg", smooth(64, 96))
    path.write_bytes(path.read_bytes()[:-300])
    with pytest.raises(ValueError, match=r"a\.jpg is truncated"):
        read_reduced(path, lambda _: 2)
    with pytest.raises(FileNotFoundError, match="There is no image file"):
        read_reduced(tmp_path / "b.jpg", lambda _: 2)


def test_threads_that_are_quiet_at_once_leave_the_level_as_it_was() -> None:
    level = cv2.utils.logging.getLogLevel()
    first, second = threading.Event(), threading.Event()

    def early() -> None:
        with quiet():
            first.set()
            assert second.wait(5)

    def late() -> int:
        assert first.wait(5)
        with quiet():
            second.set()
            running.result(5)
            return cv2.utils.logging.getLogLevel()

    with ThreadPoolExecutor(2) as pool:
        running = pool.submit(early)
        assert pool.submit(late).result(5) == cv2.utils.logging.LOG_LEVEL_SILENT
    assert cv2.utils.logging.getLogLevel() == level
