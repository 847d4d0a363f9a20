"""Scenes in files are those that are drawn, and are drawn once."""

from __future__ import annotations

import ast
import pickle
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import yolino.datasets.synthetic as synthetic_module
from yolino.config import load_experiment
from yolino.datasets import Synthetic
from yolino.datasets.synthetic import DRAWING, SCENES
from yolino.training import scenes as scenes_module
from yolino.training.loaders import build_loaders
from yolino.training.scenes import KeptScenes
from yolino.types import Sample

SIZE = (64, 128)


def drawn(length: int = 4, seed: int = 0, kind: str = "shapes") -> Synthetic:
    return Synthetic(kind, length, seed, SIZE)


def equal(a: Sample, b: Sample) -> bool:
    pairs = [(getattr(a.polylines, n), getattr(b.polylines, n)) for n in ("vertices", "offsets", "labels")]
    pairs += [(np.asarray(a.image), np.asarray(b.image)), (a.polylines.scores, b.polylines.scores)]
    same = all(np.array_equal(x, y) and x.dtype == y.dtype for x, y in pairs)
    return same and a.name == b.name and list(a.ignore) == list(b.ignore)


def files(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.npy"))


@pytest.mark.parametrize("kind", SCENES)
def test_kept_scenes_are_the_drawn_ones(tmp_path: Path, kind: str) -> None:
    scenes = drawn(kind=kind)
    kept = KeptScenes(scenes, tmp_path)
    for _ in range(2):
        for i in (0, 3, -1):
            assert equal(kept[i], scenes[i])
    assert [file.name for file in files(tmp_path)] == ["0.npy", "3.npy"]
    assert len(kept) == 4
    assert (kept.classes, kept.directed) == (scenes.classes, True)
    with pytest.raises(IndexError, match="4 was asked for, but there are 4"):
        kept[4]


def test_a_scene_is_drawn_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def draw(*arguments: Any, **named: Any) -> Sample:
        calls.append(1)
        return scene(*arguments, **named)

    scene, classes = SCENES["shapes"]
    monkeypatch.setitem(SCENES, "shapes", (draw, classes))
    for _ in range(3):  # a new object each time, as in another run
        KeptScenes(drawn(), tmp_path)[1]
    assert len(calls) == 1


def test_a_process_that_loads_gets_the_same(tmp_path: Path) -> None:
    kept = KeptScenes(drawn(), tmp_path)
    assert equal(pickle.loads(pickle.dumps(kept))[2], kept[2])


def test_other_scenes_have_another_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    others = [drawn(), drawn(seed=1), drawn(kind="road"), Synthetic("shapes", 4, 0, (64, 96))]
    assert len({KeptScenes(one, tmp_path).folder for one in others}) == 4
    assert KeptScenes(drawn(length=9), tmp_path).folder == KeptScenes(drawn(), tmp_path).folder
    before = drawn().key
    monkeypatch.setattr(cv2, "__version__", "0.0")
    synthetic_module.drawing_version.cache_clear()
    try:
        assert drawn().key != before
    finally:
        monkeypatch.undo()
        synthetic_module.drawing_version.cache_clear()
    assert drawn().key == before


def test_all_code_that_draws_is_looked_at() -> None:
    """Follows the imports of the scenes; readers of TuSimple are imported for the names of classes alone."""
    root = Path(synthetic_module.__file__).parents[1]
    todo, seen = [root / "datasets" / f"synthetic_{kind}.py" for kind in SCENES], set[Path]()
    while todo:
        file = todo.pop()
        if file in seen:
            continue
        seen.add(file)
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("yolino."):
                todo.append(root.joinpath(*str(node.module).split(".")[1:]).with_suffix(".py"))
        todo = [one for one in todo if one.name not in ("tusimple.py", "types.py")]
    looked_at = {file.resolve() for pattern in DRAWING for file in (root / "datasets").glob(pattern)}
    assert {file.resolve() for file in seen} <= looked_at


def test_a_damaged_file_is_drawn_anew(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    kept = KeptScenes(drawn(), tmp_path)
    want = kept[0]
    (file,) = files(tmp_path)
    whole = file.read_bytes()
    for part in (whole[:-8], whole[:200], whole[:10], b"", b"PK\3\4", whole.replace(b"}", b" ")):
        file.write_bytes(part)
        assert equal(kept[0], want)
        assert file.read_bytes() == whole
    assert "damaged" in caplog.text


def test_a_disk_that_fills_up_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, data: bytes) -> None:
        raise OSError(f"{path} cannot be written: No space left on device.")

    monkeypatch.setattr(scenes_module, "write_atomic", full)
    with pytest.raises(OSError, match=r"No space left on device.* free some space"):
        KeptScenes(drawn(), tmp_path)[0]


def test_what_they_take_is_told(tmp_path: Path) -> None:
    kept = KeptScenes(drawn(length=100), tmp_path)
    each = kept.expected(1)[0]
    kept[7]
    assert 0.9 < files(tmp_path)[0].stat().st_size / each < 1.1
    assert kept.expected(10) == (10 * each, 9 * each)
    assert kept.expected(10**6) == (100 * each, 99 * each)


@pytest.fixture
def experiment(tmp_path: Path) -> Any:
    """An experiment on drawn scenes."""
    config = tmp_path / "drawn.yaml"
    source = "{dataset: synthetic, options: {kind: shapes, size: [64, 128], length: %d, seed: %d}}"
    config.write_text(
        f"name: drawn\nout: {tmp_path / 'runs'}\n"
        f"data: {{size: [64, 128], cache: true, train: [{source % (5, 1)}], val: [{source % (2, 2)}]}}\n"
        "training: {batch_size: 2, steps: 30, validate_every: 4, workers: 0}\n"
    )
    return lambda *changes: load_experiment(config, changes)


def test_training_gives_the_same_batches_from_files(
    experiment: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level("INFO", logger="yolino"):
        cached, val = build_loaders(experiment(), border=False)
        assert not files(tmp_path)
    assert "decoded images and drawn scenes take 0 MB" in caplog.text
    plain, _ = build_loaders(experiment("data.cache=false"), border=False)
    for _ in range(2):
        for a, b in zip(plain, cached, strict=True):
            assert np.array_equal(a.images.numpy(), b.images.numpy())
    list(val)
    assert 2 < len(files(tmp_path)) <= 5 + 2


def test_no_more_scenes_are_counted_than_the_run_draws(
    experiment: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        shutil, "disk_usage", lambda folder: shutil._ntuple_diskusage(10**9, 0, 10**9 + 10**7)
    )
    million = "data.train.0.options.length=1000000"
    build_loaders(experiment(million), border=False)  # 60 scenes of 27 kB
    with pytest.raises(OSError, match=r"drawn scenes would take 18 MB more in .*decoded, but 1\.0 GB"):
        build_loaders(experiment(million, "training.steps=330"), border=False)
    build_loaders(experiment("training.steps=100000"), border=False)  # five scenes, whatever the steps


def test_windows_of_drawn_scenes_are_kept_too(experiment: Any, tmp_path: Path) -> None:
    train, _ = build_loaders(experiment("data.fit=window", "data.cache=false"), border=False)
    list(train)
    assert len(files(tmp_path)) == 5 + 2
