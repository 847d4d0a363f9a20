"""Reading images of every sort, writing files wholly or not at all, results there and back."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.io import (
    FORMATS,
    Result,
    from_json,
    image_size,
    read_image,
    read_result,
    reduce_image,
    to_json,
    write_atomic,
    write_image,
)
from yolino.types import Polylines

RED, GREEN, BLUE = (200, 10, 20), (10, 200, 20), (20, 10, 200)


def png(width: int, height: int, depth: int, color: int, rows: bytes, **chunks: bytes) -> bytes:
    """A PNG made by hand; `rows` without the filter bytes."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    stride = len(rows) // height
    raw = b"".join(b"\0" + rows[i * stride : (i + 1) * stride] for i in range(height))
    head = struct.pack(">IIBBBBB", width, height, depth, color, 0, 0, 0)
    extra = b"".join(chunk(name.encode(), data) for name, data in chunks.items())
    body = chunk(b"IHDR", head) + extra + chunk(b"IDAT", zlib.compress(raw)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + body


def quarters(height: int, width: int) -> np.ndarray:
    """Red above left, green above right, blue below."""
    image = np.empty((height, width, 3), np.uint8)
    image[:] = BLUE
    image[: height // 2, : width // 2] = RED
    image[: height // 2, width // 2 :] = GREEN
    return image


def jpeg(image: np.ndarray, orientation: int | None = None, order: str = "<") -> bytes:
    data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
    if orientation is None:
        return data
    mark = b"II*\0" if order == "<" else b"MM\0*"
    entries = struct.pack(order + "HHHIHH", 1, 0x0112, 3, 1, orientation, 0)
    exif = b"Exif\0\0" + mark + struct.pack(order + "I", 8) + entries + bytes(4)
    return data[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + data[2:]


def put(folder: Path, name: str, data: bytes) -> Path:
    path = folder / name
    path.write_bytes(data)
    return path


def test_rgb_png_keeps_every_value(tmp_path: Path) -> None:
    image = np.random.default_rng(0).integers(0, 256, (5, 7, 3), np.uint8)
    assert np.array_equal(read_image(put(tmp_path, "a.png", png(7, 5, 8, 2, image.tobytes()))), image)


def test_gray_becomes_rgb(tmp_path: Path) -> None:
    image = read_image(put(tmp_path, "a.png", png(2, 1, 8, 0, bytes([7, 250]))))
    assert image.tolist() == [[[7, 7, 7], [250, 250, 250]]]


def test_16_bit_is_scaled(tmp_path: Path) -> None:
    values = np.array([0, 257, 32768, 65535, 60000], ">u2")
    image = read_image(put(tmp_path, "a.png", png(5, 1, 16, 0, values.tobytes())))
    assert image[0, :, 0].tolist() == [0, 1, 128, 255, 233]


def test_transparent_pixels_show_white(tmp_path: Path) -> None:
    rows = bytes([200, 100, 0, 255, 200, 100, 0, 0, 200, 100, 0, 51])
    image = read_image(put(tmp_path, "a.png", png(3, 1, 8, 6, rows)))
    assert image[0].tolist() == [[200, 100, 0], [255, 255, 255], [244, 224, 204]]


def test_gray_with_alpha_shows_white(tmp_path: Path) -> None:
    image = read_image(put(tmp_path, "a.png", png(2, 1, 8, 4, bytes([100, 255, 100, 0]))))
    assert image[0].tolist() == [[100] * 3, [255] * 3]


def test_16_bit_with_alpha(tmp_path: Path) -> None:
    rows = np.array([65535, 0, 257, 65535, 9, 9, 9, 0], ">u2").tobytes()
    image = read_image(put(tmp_path, "a.png", png(2, 1, 16, 6, rows)))
    assert image[0].tolist() == [[255, 0, 1], [255, 255, 255]]


def test_palette_with_and_without_transparency(tmp_path: Path) -> None:
    palette = bytes([*RED, *GREEN])
    plain = png(2, 1, 8, 3, bytes([1, 0]), PLTE=palette)
    clear = png(2, 1, 8, 3, bytes([1, 0]), PLTE=palette, tRNS=bytes([0, 255]))
    assert read_image(put(tmp_path, "a.png", plain))[0].tolist() == [list(GREEN), list(RED)]
    assert read_image(put(tmp_path, "b.png", clear))[0].tolist() == [list(GREEN), [255] * 3]


# Where the stored upper left, upper right and lower half end up: (row, column) of an 8x8 raster.
TURNED = {
    1: ((1, 1), (1, 6), (6, 3)),
    2: ((1, 6), (1, 1), (6, 3)),
    3: ((6, 6), (6, 1), (1, 3)),
    4: ((6, 1), (6, 6), (1, 3)),
    5: ((1, 1), (6, 1), (3, 6)),
    6: ((1, 6), (6, 6), (3, 1)),
    7: ((6, 6), (1, 6), (3, 1)),
    8: ((6, 1), (1, 1), (3, 6)),
}


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("reduce", [1, 2])
def test_exif_rotation(tmp_path: Path, orientation: int, reduce: int) -> None:
    path = put(tmp_path, "a.jpg", jpeg(quarters(64, 96), orientation, "<" if orientation % 2 else ">"))
    size = (96, 64) if orientation >= 5 else (64, 96)
    assert image_size(path) == size
    image = read_image(path, reduce=reduce)
    assert image.shape[:2] == (size[0] // reduce, size[1] // reduce)
    for color, (row, column) in zip((RED, GREEN, BLUE), TURNED[orientation], strict=True):
        pixel = image[row * image.shape[0] // 8, column * image.shape[1] // 8]
        assert np.abs(pixel.astype(int) - color).max() < 12


@pytest.mark.parametrize(("height", "width"), [(64, 96), (61, 95), (1, 1), (2, 3), (17, 8)])
@pytest.mark.parametrize("suffix", [".jpg", ".png"])
@pytest.mark.parametrize("reduce", [1, 2, 4, 8])
def test_reduced_size_is_rounded_up(
    tmp_path: Path, height: int, width: int, suffix: str, reduce: int
) -> None:
    image = quarters(height, width)
    path = put(tmp_path, "a" + suffix, cv2.imencode(suffix, image[..., ::-1])[1].tobytes())
    assert image_size(path) == (height, width)
    assert read_image(path, reduce=reduce).shape == (-(-height // reduce), -(-width // reduce), 3)


def test_a_reduced_jpeg_is_the_mean_of_blocks(tmp_path: Path) -> None:
    noise = np.random.default_rng(3).integers(0, 256, (13, 19, 3), np.uint8)
    image = cv2.resize(noise, (160, 96), interpolation=cv2.INTER_CUBIC)
    path = put(tmp_path, "a.jpg", jpeg(image))
    full = read_image(path)
    for reduce in (2, 4, 8):
        blocks = full.reshape(96 // reduce, reduce, 160 // reduce, reduce, 3).mean(axis=(1, 3))
        assert np.abs(read_image(path, reduce=reduce) - blocks).mean() < 3


def test_reduce_image_against_a_loop() -> None:
    image = np.random.default_rng(1).integers(0, 256, (5, 7, 3), np.uint8)
    padded = np.pad(image, ((0, 3), (0, 1), (0, 0)), mode="edge").astype(float)
    want = np.array([[padded[r : r + 4, c : c + 4].mean(axis=(0, 1)) for c in (0, 4)] for r in (0, 4)])
    assert np.abs(reduce_image(image, 4) - want).max() <= 1


def test_very_wide_images(tmp_path: Path) -> None:
    image = np.full((3, 20000, 3), 90, np.uint8)
    for suffix in (".png", ".jpg"):
        path = put(tmp_path, "a" + suffix, cv2.imencode(suffix, image)[1].tobytes())
        assert read_image(path).shape == (3, 20000, 3)
        assert read_image(path, reduce=8).shape == (1, 2500, 3)


def test_too_many_pixels(tmp_path: Path) -> None:
    path = put(tmp_path, "a.png", png(1, 1, 8, 0, b"\0").replace(bytes([0, 0, 0, 1]) * 2, b"\0\1\0\0" * 2, 1))
    with pytest.raises(ValueError, match=r"a\.png has 65536 x 65536 pixels, but at most"):
        read_image(path)


def test_missing_file(tmp_path: Path) -> None:
    for read in (read_image, image_size):
        with pytest.raises(FileNotFoundError, match=r"There is no image file .*b\.jpg\."):
            read(tmp_path / "b.jpg")


def test_folder_empty_and_text(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="is a folder"):
        read_image(tmp_path)
    for read in (read_image, image_size):
        with pytest.raises(ValueError, match=r"a\.jpg is empty"):
            read(put(tmp_path, "a.jpg", b""))
        with pytest.raises(ValueError, match=r"b\.jpg is damaged or not an image"):
            read(put(tmp_path, "b.jpg", b"This is no image. " * 10))


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".webp", ".bmp", ".tiff"])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_truncated_files(tmp_path: Path, suffix: str, share: float) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (40, 50, 3), np.uint8)
    data = cv2.imencode(suffix, noise)[1].tobytes()
    path = put(tmp_path, "a" + suffix, data[: int(share * len(data))])
    with pytest.raises(ValueError, match=r"is (truncated|damaged)"):
        read_image(path)


def test_a_truncated_jpeg_with_a_whole_thumbnail(tmp_path: Path) -> None:
    data = jpeg(quarters(64, 64))
    thumbnail = b"Exif\0\0" + jpeg(quarters(8, 8))
    segment = b"\xff\xe1" + struct.pack(">H", len(thumbnail) + 2) + thumbnail
    whole = data[:2] + segment + data[2:]
    assert read_image(put(tmp_path, "a.jpg", whole)).shape == (64, 64, 3)
    assert image_size(tmp_path / "a.jpg") == (64, 64)
    with pytest.raises(ValueError, match="is truncated"):
        read_image(put(tmp_path, "b.jpg", whole[:-30]))


def test_bytes_behind_the_end_do_no_harm(tmp_path: Path) -> None:
    path = put(tmp_path, "a.jpg", jpeg(quarters(16, 16)) + b"maker's notes")
    assert read_image(path).shape == (16, 16, 3)


@settings(deadline=None)
@given(data=st.binary(max_size=300), cut=st.integers(2, 700), at=st.integers(2, 600))
def test_damaged_headers_raise_or_read(
    tmp_path_factory: pytest.TempPathFactory, data: bytes, cut: int, at: int
) -> None:
    whole = jpeg(quarters(16, 16), 6)
    broken = put(tmp_path_factory.mktemp("x"), "a.jpg", (whole[:at] + data + whole[at:])[:cut])
    for read in (read_image, image_size):
        with contextlib.suppress(ValueError):
            read(broken)


def test_unusual_pixels_and_reductions(tmp_path: Path) -> None:
    path = put(tmp_path, "a.tiff", cv2.imencode(".tiff", np.zeros((2, 2, 3), np.float32))[1].tobytes())
    with pytest.raises(ValueError, match="float32 pixels"):
        read_image(path)
    with pytest.raises(ValueError, match="reduce is 3"):
        read_image(path, reduce=3)


def test_write_atomic_replaces_and_makes_folders(tmp_path: Path) -> None:
    path = tmp_path / "new" / "deep" / "a.txt"
    write_atomic(path, "eins")
    write_atomic(path, "zwölf")
    assert path.read_text(encoding="utf-8") == "zwölf"
    write_atomic(path, b"\0\1")
    assert path.read_bytes() == b"\0\1"
    assert os.listdir(path.parent) == ["a.txt"]


def test_write_atomic_follows_links_and_long_names(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "target")
    write_atomic(tmp_path / "link", "x")
    assert (tmp_path / "target").read_text() == "x"
    assert (tmp_path / "link").is_symlink()
    write_atomic(tmp_path / ("n" * 250), "x")


@pytest.mark.parametrize("failing", ["fsync", "replace"])
def test_a_full_disk_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failing: str
) -> None:
    path = tmp_path / "a.txt"
    write_atomic(path, "old")

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, failing, full)
    with pytest.raises(
        OSError, match=r"a\.txt cannot be written: No space left on device\. What was there before"
    ):
        write_atomic(path, "new")
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_an_interrupt_leaves_no_temporary_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_atomic(tmp_path / "a.txt", "new")
    assert os.listdir(tmp_path) == []


def test_a_folder_cannot_be_overwritten(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    with pytest.raises(OSError, match="cannot be written"):
        write_atomic(tmp_path / "a", "x")
    assert os.listdir(tmp_path) == ["a"]


def test_write_image_read_image(tmp_path: Path) -> None:
    image = np.random.default_rng(0).integers(0, 256, (9, 4, 3), np.uint8)
    write_image(tmp_path / "a.png", image)
    assert np.array_equal(read_image(tmp_path / "a.png"), image)
    write_image(tmp_path / "a.jpg", np.full((8, 8, 3), RED, np.uint8))
    assert np.abs(read_image(tmp_path / "a.jpg").astype(int) - RED).max() < 6
    for name in ("a.xyz", "a"):
        with pytest.raises(ValueError, match=r"\.png or \.jpg"):
            write_image(tmp_path / name, image)


points = st.lists(
    st.tuples(*[st.floats(-1e6, 1e6, allow_nan=False, allow_subnormal=False)] * 2), min_size=0, max_size=6
)


@settings(deadline=None)
@given(
    lines=st.lists(st.tuples(points, st.floats(0, 1), st.integers(0, 9)), max_size=5),
    names=st.lists(st.text(max_size=5), max_size=3),
)
def test_result_there_and_back(
    lines: list[tuple[list[tuple[float, float]], float, int]], names: list[str]
) -> None:
    polylines = Polylines.from_list(
        [line for line, _, _ in lines], [score for _, score, _ in lines], [label for *_, label in lines]
    )
    result = Result("clips/ä b.jpg", (720, 1280), polylines, tuple(names), "default", "1.2.3")
    again = from_json(to_json(result))
    assert np.abs(again.polylines.vertices - polylines.vertices).max(initial=0) <= 0.005 + 1e-9
    assert np.array_equal(again.polylines.offsets, polylines.offsets)
    assert np.array_equal(again.polylines.labels, polylines.labels)
    assert np.abs(again.polylines.scores - polylines.scores).max(initial=0) <= 0.5001e-4
    assert (again.image, again.size, again.model) == (result.image, result.size, "default")
    assert (again.classes, again.version) == (tuple(names), "1.2.3")
    assert to_json(again) == to_json(result)


def test_the_form_of_a_result(tmp_path: Path) -> None:
    result = Result("a.jpg", (10, 20), Polylines.from_list([[(1.234, 5), (6, 7.999)]], [0.87654321], [2]))
    document = json.loads(FORMATS["json"](result))
    assert list(document) == ["image", "size", "polylines", "classes", "model", "version"]
    assert document["size"] == [10, 20]
    assert document["polylines"] == [{"points": [[1.23, 5.0], [6.0, 8.0]], "score": 0.8765, "label": 2}]
    assert document["version"]
    empty = Result("a.jpg", (10, 20), Polylines.from_list([]))
    write_atomic(tmp_path / "a.json", to_json(empty))
    assert len(read_result(tmp_path / "a.json").polylines) == 0


def test_results_that_json_cannot_say() -> None:
    for bad in (np.nan, np.inf):
        with pytest.raises(ValueError, match="not finite"):
            to_json(Result("a.jpg", (10, 20), Polylines.from_list([[(1, bad), (2, 3)]])))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("{", "Expecting property name"),
        ("[]", "form of a result"),
        ('{"image": "a", "size": [1, 2]}', "key 'polylines' is missing"),
        ('{"image": "a", "size": [1], "polylines": []}', "not enough values"),
        ('{"image": "a", "size": [1, 2], "polylines": [{"points": [[1]], "score": 1, "label": 0}]}', "shape"),
        ('{"image": "a", "size": [1, 2], "polylines": [3]}', "form of a result"),
    ],
)
def test_files_that_are_no_results(tmp_path: Path, text: str, reason: str) -> None:
    path = put(tmp_path, "a.json", text.encode())
    with pytest.raises(ValueError, match=r"a\.json is not a result of yolino: .*" + reason):
        read_result(path)


def test_a_missing_result(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="There is no result file"):
        read_result(tmp_path / "a.json")


def test_the_size_of_a_png_is_read_from_its_head(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), np.zeros((7, 9), np.uint8))
    whole = path.read_bytes()
    monkeypatch.setattr("yolino.decoding.read_image", lambda path: np.zeros((1, 2, 3), np.uint8))
    assert image_size(path) == (7, 9)
    head, rest = whole[:33], whole[33:]
    note = b"hello"
    path.write_bytes(head + len(note).to_bytes(4, "big") + b"tEXt" + note + b"sums" + rest)
    assert image_size(path) == (7, 9)
    for other in (head + len(note).to_bytes(4, "big") + b"eXIf" + note + b"sums" + rest, whole[:-12]):
        path.write_bytes(other)  # it may be turned, or it is cut: then it is decoded
        assert image_size(path) == (1, 2)


def test_a_cut_jpeg_has_no_size(tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    cv2.imwrite(str(path), np.random.default_rng(0).integers(0, 255, (200, 300, 3), np.uint8))
    assert image_size(path) == (200, 300)
    path.write_bytes(path.read_bytes() + bytes(100))  # padded by a camera
    assert image_size(path) == (200, 300)
    path.write_bytes(path.read_bytes()[:20_000])
    with pytest.raises(ValueError, match="truncated"):
        image_size(path)
