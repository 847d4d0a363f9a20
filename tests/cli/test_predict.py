from __future__ import annotations

import errno
import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from yolino.header import Header
from yolino.io import read_image, read_result

from .conftest import Run


def bright(*shape: int) -> np.ndarray:
    return np.full(shape, 200, np.uint8)


def left_over(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def test_one_image_gives_a_json_file_a_picture_and_a_table(run: Run, model: Path, photo: Path) -> None:
    code, out, err = run("predict", photo, "--model", model)
    assert (code, err) == (0, "")
    assert left_over(Path("yolino-out")) == ["photo.json", "photo.png"]
    document = json.loads(Path("yolino-out/photo.json").read_text())
    assert document["size"] == [256, 256]
    assert document["image"].endswith("photo.jpg")
    assert document["model"] == "tiny"
    assert document["version"]
    assert len(document["polylines"]) == 2
    for line in document["polylines"]:
        assert set(line) >= {"points", "score", "label"}
        assert abs(np.array(line["points"])[:, 0] - (80 if line["points"][0][0] < 128 else 176)).max() < 1
    picture = read_image("yolino-out/photo.png")
    assert picture.shape == (256, 256, 3)
    assert (picture[:100] == 200).all()
    assert (picture[200, 74:87] != 200).any()
    assert "photo.jpg" in out
    assert "polylines" in out
    assert "1 image, 2 polylines" in out
    assert "ms per image -> yolino-out" in out


def test_results_can_be_read_again(run: Run, model: Path, photo: Path) -> None:
    assert run("predict", photo, "--model", model)[0] == 0
    result = read_result("yolino-out/photo.json")
    assert result.size == (256, 256)
    assert len(result.polylines) == 2


def test_folders_globs_and_files_together(run: Run, model: Path, photo: Path) -> None:
    for name in ("drive/1/20.png", "drive/2/20.png", "extra/a.png", "extra/b.bmp"):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(name, bright(64, 128, 3))
    code, out, err = run(
        "predict", "drive", "extra/*.png", photo, "--model", model, "--out", "found", "--no-images"
    )
    assert (code, err) == (0, "")
    assert left_over(Path("found")) == ["1/20.json", "2/20.json", "a.json", "photo.json"]
    assert "4 images, 8 polylines" in out


def test_earlier_results_are_not_taken_for_images(run: Run, model: Path, photo: Path) -> None:
    assert run("predict", ".", "--model", model)[0] == 0
    code, out, _ = run("predict", ".", "--model", model)
    assert code == 0
    assert "1 image," in out


def test_many_images_give_a_short_table(run: Run, model: Path, tmp_path: Path) -> None:
    for i in range(25):
        cv2.imwrite(f"{i:02d}.png", bright(8, 16, 3))
    code, out, err = run("predict", tmp_path, "--model", model, "--no-images")
    assert (code, err) == (0, "")
    assert "... and 5 more" in out
    assert "25 images, 50 polylines" in out


def test_the_threshold_is_used(run: Run, model: Path, photo: Path) -> None:
    code, out, _ = run("predict", photo, "--model", model, "--threshold", "0.95")
    assert code == 0
    assert "1 image, 0 polylines" in out
    assert json.loads(Path("yolino-out/photo.json").read_text())["polylines"] == []


def test_the_mirrored_image_is_seen_where_asked_for(
    run: Run, make_model: Callable[..., Path], tmp_path: Path, tiny_endpoints: np.ndarray, photo: Path
) -> None:
    """The model says the same of all it sees: of the mirror image, too, a line at the left."""
    left = make_model(tmp_path / "left.onnx", endpoints=tiny_endpoints[:4])
    for number, option in enumerate([(), ("--no-flip",), ("--flip",)]):
        assert run("predict", photo, "--model", left, "--out", f"{number}", "--no-images", *option)[0] == 0
    counts = [len(json.loads(Path(f"{i}/photo.json").read_text())["polylines"]) for i in range(3)]
    assert counts == [1, 1, 2]


def test_the_tusimple_format_is_one_file_of_json_lines(run: Run, model: Path) -> None:
    names = ["clips/0531/1/20.png", "clips/0531/2/20.png"]
    for name in names:
        Path(name).parent.mkdir(parents=True)
        cv2.imwrite(name, bright(720, 1280, 3))
    code, _, err = run(
        "predict", Path("clips").absolute(), "--model", model, "--format", "tusimple", "--no-images"
    )
    assert (code, err) == (0, "")
    assert left_over(Path("yolino-out")) == ["predictions.json"]
    records = [json.loads(line) for line in Path("yolino-out/predictions.json").read_text().splitlines()]
    assert [record["raw_file"] for record in records] == names
    for record in records:
        assert record["h_samples"] == list(range(160, 720, 10))
        assert record["run_time"] > 0
        columns = np.sort(np.array(record["lanes"])[:, 40])
        np.testing.assert_allclose(columns, [399.5, 879.5], atol=2)


def test_rows_of_other_heights_are_scaled(run: Run, model: Path) -> None:
    cv2.imwrite("small.png", bright(360, 640, 3))
    assert run("predict", "small.png", "--model", model, "--format", "tusimple")[0] == 0
    record = json.loads(Path("yolino-out/predictions.json").read_text())
    assert record["h_samples"] == list(range(80, 360, 5))
    assert record["raw_file"] == "small.png"


def test_a_model_with_classes_writes_their_names(run: Run, class_model: Path, photo: Path) -> None:
    assert run("predict", photo, "--model", class_model)[0] == 0
    document = json.loads(Path("yolino-out/photo.json").read_text())
    assert [line["label"] for line in document["polylines"]] == [1, 1]
    assert document["classes"] == ["solid", "dashed"]


def exif_rotated(image: np.ndarray) -> bytes:
    """A JPEG that is to be turned by a quarter (orientation 6)."""
    data = cv2.imencode(".jpg", image)[1].tobytes()
    tiff = b"II*\0" + struct.pack("<IHHHIHHI", 8, 1, 0x0112, 3, 1, 6, 0, 0)
    exif = b"Exif\0\0" + tiff
    return data[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + data[2:]


GOOD: dict[str, tuple[Any, list[int]]] = {
    "gray.png": (bright(90, 160), [90, 160]),
    "deep.png": (np.full((90, 160, 3), 60_000, np.uint16), [90, 160]),
    "alpha.png": (np.full((90, 160, 4), 220, np.uint8), [90, 160]),
    "one.png": (bright(1, 1, 3), [1, 1]),
    "wide.png": (bright(40, 20_000, 3), [40, 20_000]),
    "tall.png": (bright(20_000, 40, 3), [20_000, 40]),
}


@pytest.mark.parametrize("name", GOOD)
def test_unusual_images_are_predicted(run: Run, model: Path, name: str) -> None:
    pixels, size = GOOD[name]
    cv2.imwrite(name, pixels)
    code, _, err = run("predict", name, "--model", model)
    assert (code, err) == (0, "")
    stem = Path(name).stem
    assert json.loads(Path(f"yolino-out/{stem}.json").read_text())["size"] == size
    picture = read_image(f"yolino-out/{stem}.png")
    factor = picture.shape[0] // size[0]  # small images are enlarged
    assert list(picture.shape) == [factor * size[0], factor * size[1], 3]
    assert 1 <= factor <= 480


def test_a_rotated_photo_is_turned_upright(run: Run, model: Path) -> None:
    Path("turned.jpg").write_bytes(exif_rotated(bright(64, 128, 3)))
    assert run("predict", "turned.jpg", "--model", model)[0] == 0
    assert json.loads(Path("yolino-out/turned.json").read_text())["size"] == [128, 64]


def test_bad_images_are_told_one_by_one_and_the_others_are_finished(
    run: Run, model: Path, photo: Path
) -> None:
    whole = photo.read_bytes()
    Path("empty.jpg").touch()
    Path("half.jpg").write_bytes(whole[: len(whole) // 2])
    Path("text.jpg").write_text("not an image")
    Path("empty-folder").mkdir()
    sources = ["empty.jpg", "half.jpg", "missing.jpg", photo, "text.jpg", "empty-folder", "*.webp"]
    code, out, err = run("predict", *sources, "--model", model)
    assert code == 2
    assert "1 image, 2 polylines" in out
    assert left_over(Path("yolino-out")) == ["photo.json", "photo.png"]
    lines = err.splitlines()
    assert len(lines) == 6
    assert all(line.startswith("Error: ") and line.endswith(".") for line in lines)
    for name in ("empty.jpg", "half.jpg", "missing.jpg", "text.jpg", "empty-folder", "*.webp"):
        assert sum(name in line for line in lines) == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--model", "defualt"], "The model 'defualt' is unknown: give "),
        (["--model", "nothing.onnx"], "The model nothing.onnx does not exist"),
        (["--model", "text.onnx"], "text.onnx is not a readable ONNX file"),
        (
            ["--model", "plain.onnx"],
            "plain.onnx is not a YOLinO model: its metadata has no 'yolino' header; export one",
        ),
        (["--model", "photo.jpg"], "has the suffix '.jpg'; known model files end in .onnx"),
        (["--device", "gpu"], "The device 'gpu' is unknown; use one of auto, cpu, cuda."),
        (["--format", "xml"], "The format 'xml' is unknown; use one of json, tusimple, culane"),
    ],
)
def test_mistakes_are_told_in_one_line(
    run: Run, model: Path, photo: Path, make_model: Any, arguments: list[str], message: str
) -> None:
    make_model(Path("plain.onnx"), header=None)
    Path("text.onnx").write_text("not a model")
    if "--model" not in arguments:
        arguments = [*arguments, "--model", str(model)]
    code, out, err = run("predict", photo, *arguments)
    assert code == 2
    assert out == ""
    assert err.startswith(f"Error: {message}") or message in err
    assert err.count("\n") == 1
    assert not Path("yolino-out").exists()


@pytest.mark.parametrize(
    "arguments", [["--treshold", "0.5"], ["--threshold", "2"], ["--threshold", "x"], ["--threshold", "nan"]]
)
def test_wrong_options_are_told(run: Run, model: Path, photo: Path, arguments: list[str]) -> None:
    code, out, err = run("predict", photo, "--model", model, *arguments)
    assert code == 2
    assert out == ""
    assert "Error" in err
    assert "Traceback" not in err


def test_no_image_at_all_is_a_mistake(run: Run, model: Path) -> None:
    assert run("predict", "--model", model)[0] == 2
    code, out, err = run("predict", "missing.jpg", "--model", model)
    assert (code, out) == (2, "")
    assert err == "Error: There is no image file missing.jpg.\n"


def test_a_picture_never_replaces_its_source(run: Run, model: Path) -> None:
    cv2.imwrite("photo.png", bright(64, 128, 3))
    before = Path("photo.png").read_bytes()
    code, _, err = run("predict", "photo.png", "--model", model, "--out", ".")
    assert code == 2
    assert "photo.png would replace a source image; choose another --out, or --no-images." in err
    assert Path("photo.png").read_bytes() == before
    assert run("predict", "photo.png", "--model", model, "--out", ".", "--no-images")[0] == 0
    assert Path("photo.png").read_bytes() == before


def test_a_full_disk_keeps_what_is_written_and_leaves_nothing_half(
    run: Run, model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("a.png", "b.png", "c.png"):
        cv2.imwrite(name, bright(64, 128, 3))
    import os

    flush, calls = os.fsync, []

    def full(descriptor: int) -> None:
        calls.append(descriptor)
        if len(calls) > 3:
            raise OSError(errno.ENOSPC, "No space left on device")
        flush(descriptor)

    monkeypatch.setattr(os, "fsync", full)
    code, _, err = run("predict", "missing.png", "a.png", "b.png", "c.png", "--model", model)
    assert code == 2
    assert "missing.png" in err.splitlines()[0]
    assert "b.png" in err.splitlines()[1]
    assert "No space left on device" in err.splitlines()[1]
    assert left_over(Path("yolino-out")) == ["a.json", "a.png", "b.json"]
    read_result("yolino-out/b.json")


def test_a_folder_that_is_a_file_is_told(run: Run, model: Path, photo: Path) -> None:
    Path("out").touch()
    code, _, err = run("predict", photo, "--model", model, "--out", "out")
    assert code == 2
    assert err.startswith("Error: ")
    assert err.count("\n") == 1


def test_the_header_decides_whether_direction_is_drawn(
    run: Run, make_model: Any, photo: Path, header: Header
) -> None:
    import dataclasses

    undirected = dataclasses.replace(header, directed=False)
    make_model(Path("undirected.onnx"), header=undirected)
    make_model(Path("directed.onnx"))
    assert run("predict", photo, "--model", "undirected.onnx", "--out", "undirected")[0] == 0
    assert run("predict", photo, "--model", "directed.onnx", "--out", "directed")[0] == 0
    assert (read_image("undirected/photo.png") != read_image("directed/photo.png")).any()


@pytest.mark.parametrize("format", ["cvat", "labelme", "geojson", "coco", "labelstudio"])
def test_results_can_be_labels_for_a_person_to_correct(
    run: Run, model: Path, photo: Path, format: str
) -> None:
    code, _, _ = run("predict", photo, "--model", model, "--format", format, "--out", "found")
    assert code == 0
    run("predict", photo, "--model", model, "--out", "json")
    code, out, err = run(
        "score", "found", "json", "--json", "--metric", "chamfer", "--set", "thresholds=[0.01]"
    )
    assert (code, err) == (0, "")
    assert json.loads(out)["ap"] == 1
    assert json.loads(out)["images"] == 1


def test_a_file_is_no_folder_for_results(run: Run, model: Path, photo: Path) -> None:
    before = photo.read_bytes()
    code, _, err = run("predict", photo, "--model", model, "--out", photo)
    assert (code, err) == (2, f"Error: --out {photo} is a file, but a folder is needed: give another name.\n")
    assert photo.read_bytes() == before


@pytest.mark.parametrize("out", ["found.txt", "new/lanes.gpkp", "photo.tif", "a.geojsn"])
def test_an_unknown_ending_makes_no_folder(run: Run, model: Path, photo: Path, out: str) -> None:
    before = left_over(Path())
    code, _, err = run("predict", photo, "--model", model, "--out", out)
    assert (code, err.count("\n")) == (2, 1)
    assert err.startswith(f"Error: --out {out} has the unknown ending {Path(out).suffix}")
    assert "images into a folder (end its name with / if it must have a dot)." in err
    hints = {"new/lanes.gpkp": "new/lanes.gpkg", "a.geojsn": "a.geojson"}
    assert (f"(did you mean {hints.get(out)}?)" in err) == (out in hints)
    assert left_over(Path()) == before
    assert not Path("new").exists()
    assert run("predict", photo, "--model", model, "--out", f"{out}/")[0] == 0
    assert Path(out, "photo.json").is_file()


def test_labels_that_a_person_corrected_are_not_replaced(run: Run, model: Path, photo: Path) -> None:
    """The first run writes beside the photo; a second one finds labels there."""
    command = ["predict", photo, "--model", model, "--format", "labelme", "--out", ".", "--no-images"]
    assert run(*command)[0] == 0
    labels = Path("photo.json")
    labels.write_text(labels.read_text() + "\n")
    before = labels.read_text()
    code, _, err = run(*command)
    assert code == 2
    assert "holds labels already, which would be replaced: choose another folder." in err
    assert labels.read_text() == before
