from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from yolino.inference.scene_store import Chunk, SceneStore
from yolino.types import Segments

SETTINGS = {"model": "abc", "window": (64, 128), "scale": 0.5, "bands": None}


def chunk(*windows: int, classes: int = 0) -> Chunk:
    rng = np.random.default_rng(windows[0])
    shares = rng.random((3, classes), np.float32) if classes else None
    segments = Segments(rng.uniform(0, 9, (3, 2, 2)), rng.uniform(size=3), probabilities=shares)
    return Chunk(np.array(windows), segments)


@pytest.mark.parametrize("classes", [0, 4])
def test_what_is_added_is_found_again_to_the_last_bit(tmp_path: Path, classes: int) -> None:
    store = SceneStore(tmp_path / "a.partial", SETTINGS)
    assert (store.done, (tmp_path / "a.partial").exists()) == (set(), False)
    added = [chunk(4, 2, classes=classes), chunk(7, classes=classes)]
    for each in added:
        store.add(each)
    assert store.done == {2, 4, 7}
    again = SceneStore(tmp_path / "a.partial", SETTINGS)
    assert again.done == {2, 4, 7}
    for one, other in zip(again.chunks, added, strict=True):
        np.testing.assert_array_equal(one.windows, other.windows)
        np.testing.assert_array_equal(one.segments.endpoints, other.segments.endpoints)
        np.testing.assert_array_equal(one.segments.scores, other.segments.scores)
        if classes:
            np.testing.assert_array_equal(one.segments.probabilities, other.segments.probabilities)
    again.add(chunk(9))
    assert SceneStore(tmp_path / "a.partial", SETTINGS).done == {2, 4, 7, 9}
    again.remove()
    assert not (tmp_path / "a.partial").exists()


def test_work_under_other_settings_is_kept_and_what_differs_is_named(tmp_path: Path) -> None:
    SceneStore(tmp_path / "a", SETTINGS).add(chunk(1))
    with pytest.raises(ValueError, match=r"differs in: scale, bands. Remove .* to begin anew"):
        SceneStore(tmp_path / "a", {**SETTINGS, "scale": 1.0, "bands": [1]})
    assert SceneStore(tmp_path / "a", SETTINGS).done == {1}


def test_other_settings_without_any_work_begin_anew(tmp_path: Path) -> None:
    SceneStore(tmp_path / "a", SETTINGS).add(chunk(1))
    for file in (tmp_path / "a").glob("*.npz"):
        file.unlink()
    other = {**SETTINGS, "scale": 1.0}
    SceneStore(tmp_path / "a", other).add(chunk(5))
    assert SceneStore(tmp_path / "a", other).done == {5}


def test_a_file_that_the_disk_damaged_is_done_again(tmp_path: Path) -> None:
    store = SceneStore(tmp_path / "a", SETTINGS)
    store.add(chunk(1))
    store.add(chunk(2))
    first = min((tmp_path / "a").glob("*.npz"))
    first.write_bytes(first.read_bytes()[:100])
    again = SceneStore(tmp_path / "a", SETTINGS)
    assert again.done == {2}
    again.add(chunk(1))
    assert SceneStore(tmp_path / "a", SETTINGS).done == {1, 2}


@pytest.mark.parametrize("text", ["", "[]", "{"])
def test_work_with_damaged_settings_is_kept(tmp_path: Path, text: str) -> None:
    SceneStore(tmp_path / "a", SETTINGS).add(chunk(1))
    (tmp_path / "a" / "settings.json").write_text(text)
    with pytest.raises(ValueError, match="differs in: settings"):
        SceneStore(tmp_path / "a", SETTINGS)
    assert len(list((tmp_path / "a").glob("*.npz"))) == 1


def test_a_folder_that_holds_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "thesis.doc").write_text("years")
    with pytest.raises(ValueError, match="holds something else"):
        SceneStore(tmp_path / "a", SETTINGS)
    assert (tmp_path / "a" / "thesis.doc").read_text() == "years"
    (tmp_path / "b").write_text("a file")
    with pytest.raises(ValueError, match="holds something else"):
        SceneStore(tmp_path / "b", SETTINGS)


def test_the_settings_can_be_read_by_people(tmp_path: Path) -> None:
    SceneStore(tmp_path / "a", SETTINGS).add(chunk(1))
    assert json.loads((tmp_path / "a" / "settings.json").read_text())["window"] == [64, 128]
