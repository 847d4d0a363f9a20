from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.datasets.leaks import (
    LEAK_ERRORS,
    LEAKS,
    NEAR_BITS,
    Comparison,
    correlation,
    find_leaks,
    fingerprint,
    nearest,
)
from yolino.datasets.report import Picture
from yolino.io import read_image, write_image


def scene(seed: int, shape: tuple[int, int] = (180, 320)) -> np.ndarray:
    """Soft blobs of any color: like photos, no two alike."""
    coarse = np.random.default_rng(seed).uniform(0, 255, (7, 11, 3)).astype(np.uint8)
    return cv2.resize(coarse, shape[::-1], interpolation=cv2.INTER_CUBIC)


def save(path: Path, image: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_image(path, image)
    return path


def compare(root: Path, splits: dict[str, list[str]], **options: object) -> Comparison:
    return find_leaks(
        {name: [Picture(one, root / one) for one in some] for name, some in splits.items()}, **options
    )


def found(comparison: Comparison) -> list[tuple[str, tuple[str, str]]]:
    return [(leak.kind, leak.samples) for leak in comparison.leaks]


def test_splits_of_different_images_have_nothing_in_common(tmp_path: Path):
    for i in range(6):
        save(tmp_path / f"{i}.jpg", scene(i))
    clean = compare(
        tmp_path, {"train": ["0.jpg", "1.jpg", "2.jpg"], "val": ["3.jpg", "4.jpg"], "test": ["5.jpg"]}
    )
    assert clean == Comparison((), (), ())
    assert clean.counts == {}


def test_the_same_image_is_found_by_name_by_content_and_by_its_look(tmp_path: Path):
    for i in range(4):
        save(tmp_path / f"a/{i}.jpg", scene(i))
    (tmp_path / "copy.jpg").write_bytes((tmp_path / "a/1.jpg").read_bytes())
    save(tmp_path / "again.png", scene(2))
    leaks = compare(
        tmp_path,
        {"train": ["a/0.jpg", "a/1.jpg", "a/2.jpg"], "val": ["a/0.jpg", "copy.jpg", "again.png", "a/3.jpg"]},
        by="image",
    )
    assert found(leaks) == [
        ("same name", ("a/0.jpg", "a/0.jpg")),
        ("same file", ("a/1.jpg", "copy.jpg")),
        ("near-identical image", ("a/2.jpg", "again.png")),
    ]
    assert all(leak.splits == ("train", "val") for leak in leaks.leaks)
    assert leaks.counts == {"same name": 1, "same file": 1, "near-identical image": 1}
    assert [leak.kind for leak in leaks.errors] == ["same name", "same file"]
    assert leaks.leaks[1].detail == str(tmp_path / "copy.jpg")


CHANGES = {
    "compressed": lambda image: cv2.imdecode(
        cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 40])[1], 1
    ),
    "halved": lambda image: cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA),
    "brighter": lambda image: np.clip(image * 1.2 + 10.0, 0, 255).astype(np.uint8),
    "shifted": lambda image: np.roll(image, (2, 2), (0, 1)),
    "noisy": lambda image: np.clip(
        image + np.random.default_rng(0).normal(0, 10, image.shape), 0, 255
    ).astype(np.uint8),
}


@pytest.mark.parametrize("change", CHANGES)
def test_changes_that_leave_the_scene_are_seen_through(change: str, tmp_path: Path):
    for i in range(8):
        save(tmp_path / f"{i}.png", scene(i))
        save(tmp_path / f"changed{i}.png", CHANGES[change](scene(i)))
    splits = {"train": [f"{i}.png" for i in range(8)], "val": [f"changed{i}.png" for i in range(8)]}
    assert found(compare(tmp_path, splits)) == [
        ("near-identical image", (f"{i}.png", f"changed{i}.png")) for i in range(8)
    ]
    assert compare(tmp_path, splits, decode=False).leaks == ()


def test_drawings_on_an_empty_ground_are_not_alike_because_of_the_ground(tmp_path: Path):
    for i in range(4):
        image = np.full((180, 320, 3), 255, np.uint8)
        cv2.line(image, (40 + 60 * i, 60), (300 - 70 * i, 120), (0, 0, 0), 2)
        save(tmp_path / f"{i}.png", image)
    blank = np.full((180, 320, 3), 255, np.uint8)
    save(tmp_path / "blank.png", blank)
    save(tmp_path / "white.jpg", blank)
    bits = [fingerprint(read_image(tmp_path / f"{i}.png"))[0] for i in (0, 1)]
    assert (bits[0] != bits[1]).sum() <= NEAR_BITS  # the bits alone would say so
    assert (
        compare(tmp_path, {"a": ["0.png", "1.png", "blank.png"], "b": ["2.png", "3.png", "white.jpg"]}).leaks
        == ()
    )


def test_tiny_images_are_compared_pixel_by_pixel(tmp_path: Path):
    ramp = np.repeat(np.arange(24.0) * 2 + 80, 24).reshape(24, 24)
    upright, level = (
        np.kron(np.ones((12, 12)), [[60, -60], [-60, 60]]),
        np.kron(np.ones((24, 6)), [60, 60, -60, -60]),
    )
    for name, pattern in (("a.png", upright), ("b.bmp", upright), ("c.png", level)):
        save(tmp_path / name, np.repeat((ramp + pattern).astype(np.uint8)[:, :, None], 3, axis=2))
    # Blocks of 8 pixels are alike in all of them.
    assert found(compare(tmp_path, {"x": ["a.png"], "y": ["b.bmp", "c.png"]})) == [
        ("near-identical image", ("a.png", "b.bmp"))
    ]


def test_one_clip_in_two_splits_is_found_as_it_is_asked_for(tmp_path: Path):
    splits = {
        "train": ["d/a/1.jpg", "d/a/2.jpg", "d/b/1.jpg"],
        "val": ["d/b/2.jpg", "d/c/1.jpg", "images/1.jpg"],
    }
    (leak,) = compare(tmp_path, splits).leaks
    assert (leak.kind, leak.samples) == ("same group", ("d/b/1.jpg", "d/b/2.jpg"))
    assert leak.detail == "d/b: 1 images in train, 1 in val"
    (leak,) = compare(tmp_path, splits, by="1").leaks
    assert leak.detail == "d: 3 images in train, 2 in val"
    assert compare(tmp_path, splits, by="image").leaks == ()
    with pytest.raises(ValueError, match="grouping 'clip' is unknown"):
        compare(tmp_path, splits, by="clip")


def test_a_folder_of_images_is_no_clip(tmp_path: Path):
    assert compare(tmp_path, {"train": ["images/1.jpg"], "val": ["images/2.jpg"]}).leaks == ()


def test_each_pair_of_splits_is_compared(tmp_path: Path):
    leaks = compare(tmp_path, {"a": ["c/1"], "b": ["c/2"], "c": ["c/3"]}).leaks
    assert [leak.splits for leak in leaks] == [("a", "b"), ("a", "c"), ("b", "c")]


def test_a_split_of_several_others_is_not_compared_but_a_part_of_one_is(tmp_path: Path):
    names = {"train": ["1", "2"], "val": ["3"], "trainval": ["1", "2", "3"]}
    assert compare(tmp_path, names) == Comparison((), (), ("trainval",))
    assert found(compare(tmp_path, {"train": ["1", "2"], "val": ["2"]})) == [("same name", ("2", "2"))]
    assert found(compare(tmp_path, {"train": ["1"], "train_gt": ["1"]})) == [("same name", ("1", "1"))]


def test_broken_images_are_told_and_missing_ones_are_compared_by_name(tmp_path: Path):
    save(tmp_path / "1.jpg", scene(1))
    (tmp_path / "2.jpg").write_bytes((tmp_path / "1.jpg").read_bytes()[:-200])
    found = compare(tmp_path, {"a": ["1.jpg", "gone.jpg"], "b": ["2.jpg"]})
    ((split, finding),) = found.unreadable
    assert (split, finding.kind, finding.sample) == ("b", "unreadable image", "2.jpg")
    assert "truncated" in finding.detail
    assert found.leaks == ()


def test_one_split_has_nobody_to_leak_to_and_no_image_is_read(tmp_path: Path):
    (tmp_path / "1.jpg").write_bytes(b"nonsense")
    assert compare(tmp_path, {"all": ["1.jpg", "1.jpg"]}) == Comparison((), (), ())
    assert find_leaks({}) == Comparison((), (), ())


def test_images_in_memory_are_compared_by_name():
    splits = {"a": [Picture("1", None), Picture("2", None)], "b": [Picture("2", None), Picture("3", None)]}
    assert [leak.kind for leak in find_leaks(splits).leaks] == ["same name"]


def test_progress_counts_each_file_once(tmp_path: Path):
    for i in range(3):
        save(tmp_path / f"{i}.jpg", scene(i))
    seen = []

    def progress(indices):
        for i in indices:
            seen.append(i)
            yield i

    compare(tmp_path, {"a": ["0.jpg", "1.jpg"], "b": ["1.jpg", "2.jpg"]}, progress=progress)
    assert seen == [0, 1, 2]


def test_opencv_talks_as_before(tmp_path: Path, monkeypatch):
    before = cv2.utils.logging.getLogLevel()

    def quiet(file: Path) -> str:
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        return "nothing"

    monkeypatch.setattr("yolino.datasets.leaks._look", quiet)
    for name in "ab":
        (tmp_path / name).write_bytes(b"nonsense")
    compare(tmp_path, {"a": ["a"], "b": ["b"]})
    assert before != cv2.utils.logging.LOG_LEVEL_SILENT
    assert cv2.utils.logging.getLogLevel() == before


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 9), st.integers(1, 9), st.integers(1, 40))
def test_the_nearest_hash_equals_a_search_bit_by_bit(seed, n, m, bits):
    rng = np.random.default_rng(seed)
    first, second = (rng.integers(0, 2, (count, bits), np.uint8) for count in (n, m))
    places, distances = nearest(first, second)
    for j in range(m):
        slow = [sum(int(x != y) for x, y in zip(first[i], second[j], strict=True)) for i in range(n)]
        assert (slow[places[j]], distances[j]) == (min(slow), min(slow))


def test_many_hashes_are_compared_in_blocks(monkeypatch):
    rng = np.random.default_rng(0)
    first, second = (rng.integers(0, 2, (count, 64), np.uint8) for count in (20, 33))
    whole = nearest(first, second)
    monkeypatch.setattr("yolino.datasets.leaks._BLOCK", 100)
    for a, b in zip(nearest(first, second), whole, strict=True):
        np.testing.assert_array_equal(a, b)


def test_correlation_by_hand():
    assert correlation(*np.array([[0, 1, 2], [10, 20, 30]], np.uint8)) == pytest.approx(1)
    assert correlation(*np.array([[0, 1, 2], [30, 20, 10]], np.uint8)) == pytest.approx(-1)
    assert correlation(*np.array([[0, 255, 0], [0, 0, 255]], np.uint8)) == pytest.approx(-0.5)
    assert correlation(*np.array([[7, 7, 7], [1, 2, 3]], np.uint8)) == 0


def test_errors_are_kinds():
    assert set(LEAKS) > LEAK_ERRORS


def test_the_real_drives_share_nothing_and_frames_of_one_drive_much(tusimple_root: Path):
    def names(file: str) -> list[str]:
        return [json.loads(line)["raw_file"] for line in (tusimple_root / file).read_text().splitlines()]

    drive, other = names("label_data_0313.json"), names("label_data_0531.json")
    assert compare(tusimple_root, {"train": drive, "val": other}, by="2").leaks == ()
    within = compare(tusimple_root, {"train": drive[::2], "val": drive[1::2]})
    assert within.counts["near-identical image"] >= 40
