from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from striped_model import make_striped_model, striped_header
from yolino.header import Header
from yolino.io import read_result

from .conftest import Run

rasterio = pytest.importorskip("rasterio", reason="rasterio reads scenes")
pyogrio = pytest.importorskip("pyogrio", reason="pyogrio writes GeoPackages")
parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow writes GeoParquet")
SUFFIXES = (".gpkg", ".geojson", ".parquet", ".json")
PLACE = rasterio.Affine(0.5, 0, 5e5, 0, -0.5, 5.4e6)
LINES = (((10, 40), (440, 80)), ((30, 290), (430, 100)), ((200, 10), (230, 290)))


def drawn(size: tuple[int, int] = (300, 450)) -> np.ndarray:
    image = np.zeros(size, np.uint8)
    for start, end in LINES:
        cv2.line(image, start, end, 255, 3, cv2.LINE_AA)
    return image


def write(path: str, values: np.ndarray, **options: Any) -> Path:
    values = values if values.ndim == 3 else values[None]
    count, height, width = values.shape
    settings = {"driver": "GTiff", "count": count, "height": height, "width": width, "dtype": values.dtype}
    tiles = {"tiled": True, "blockxsize": 64, "blockysize": 64, "crs": "EPSG:25832", "transform": PLACE}
    with rasterio.open(path, "w", **settings | tiles | options) as raster:
        raster.write(values)
    return Path(path)


def write_without_place(path: str, values: np.ndarray) -> Path:
    with pytest.warns(rasterio.errors.NotGeoreferencedWarning):
        return write(path, values, crs=None, transform=None)


def points_of(wkb: bytes) -> np.ndarray:
    return np.frombuffer(wkb, "<f8", offset=9).reshape(-1, 2)


def lines_of(path: str | Path) -> list[np.ndarray]:
    """The lines of a GeoPackage or GeoJSON."""
    return [points_of(each) for each in pyogrio.raw.read(path)[2]]


def assert_same_lines(one: list[np.ndarray], other: list[np.ndarray], atol: float = 1e-3) -> None:
    assert len(one) == len(other) > 0
    for a, b in zip(one, other, strict=True):
        np.testing.assert_allclose(a, b, atol=atol)


@pytest.fixture
def striped(tmp_path: Path) -> Path:
    pytest.importorskip("onnx", reason="onnx builds the model of this test")
    return make_striped_model(tmp_path / "striped.onnx", striped_header(classes=("steep", "flat")))


def test_a_scene_gives_one_file_of_its_lines_on_the_map(run: Run, striped: Path) -> None:
    write("scene.tif", drawn())
    code, out, err = run("predict", "scene.tif", "--model", striped, "--out", "found/lanes.gpkg")
    assert (code, err) == (0, "")
    assert "15 windows, " in out
    assert "polylines -> found/lanes.gpkg" in out
    assert [each.name for each in Path("found").iterdir()] == ["lanes.gpkg"]
    about, _, _, columns = pyogrio.raw.read("found/lanes.gpkg")
    assert (about["crs"], about["geometry_type"]) == ("EPSG:25832", "LineString")
    assert about["fields"].tolist() == ["id", "class", "score", "length_m"]
    ids, classes, scores, meters = columns
    assert ids.tolist() == list(range(1, len(ids) + 1))
    assert set(classes) == {"steep", "flat"}
    assert ((scores > 0.5) & (scores <= 0.9)).all()
    longest = lines_of("found/lanes.gpkg")[int(meters.argmax())]
    assert meters.max() == pytest.approx(0.5 * np.hypot(400, 190) / 0.9996, rel=0.05)
    pixels = (longest - (5e5, 5.4e6)) / (0.5, -0.5)
    np.testing.assert_allclose(np.interp(pixels[:, 0], (30, 430), (290, 100)), pixels[:, 1], atol=3)


def test_all_formats_say_the_same(run: Run, striped: Path) -> None:
    write("scene.tif", drawn())
    for suffix in SUFFIXES:
        assert run("predict", "scene.tif", "--model", striped, "--out", f"a{suffix}")[0] == 0
    assert_same_lines(lines_of("a.gpkg"), lines_of("a.geojson"), atol=1e-4)
    table = parquet.read_table("a.parquet").to_pydict()
    assert_same_lines(
        lines_of("a.gpkg"),
        [np.frombuffer(each, "<f8", offset=9).reshape(-1, 2) for each in table["geometry"]],
    )
    result = read_result("a.json")
    assert (result.size, result.classes) == ((300, 450), ("steep", "flat"))
    pixels = [(line - (5e5, 5.4e6)) / (0.5, -0.5) for line in lines_of("a.gpkg")]
    assert_same_lines(list(result.polylines), pixels, atol=0.011)


def test_a_turned_raster_turns_its_lines(run: Run, striped: Path) -> None:
    turned = PLACE @ rasterio.Affine.rotation(30)
    write("scene.tif", drawn())
    write("turned.tif", drawn(), transform=turned)
    for name in ("scene", "turned"):
        assert run("predict", f"{name}.tif", "--model", striped, "--out", f"{name}.gpkg")[0] == 0
    place = np.array(turned @ ~PLACE).reshape(3, 3)
    wanted = [line @ place[:2, :2].T + place[:2, 2] for line in lines_of("scene.gpkg")]
    assert_same_lines(lines_of("turned.gpkg"), wanted)


def test_another_overlap_gives_the_same_lines(run: Run, striped: Path) -> None:
    write("scene.tif", drawn())
    assert run("predict", "scene.tif", "--model", striped, "--out", "a.gpkg")[0] == 0
    code, out, _ = run("predict", "scene.tif", "--model", striped, "--out", "b.gpkg", "--overlap", 96)
    assert (code, "84 windows" in out) == (0, True)
    assert_same_lines(lines_of("a.gpkg"), lines_of("b.gpkg"))


def test_without_a_place_on_the_map_lengths_are_pixels_and_that_is_said(run: Run, striped: Path) -> None:
    write_without_place("scene.tif", drawn())
    code, _, err = run("predict", "scene.tif", "--model", striped, "--out", "a.gpkg")
    assert code == 0
    assert err == "scene.tif has no place on the map: coordinates and lengths are in pixels.\n"
    assert pyogrio.raw.read("a.gpkg")[0]["fields"].tolist() == ["id", "class", "score", "length_px"]
    write("scene.tif", drawn(), crs=None)
    code, _, err = run("predict", "scene.tif", "--model", striped, "--out", "b.gpkg")
    assert (code, err.count("\n")) == (0, 1)
    assert "names no coordinate reference system: coordinates are in its units, lengths in pixels." in err
    pixels = [(line - (5e5, 5.4e6)) / (0.5, -0.5) for line in lines_of("b.gpkg")]
    assert_same_lines(lines_of("a.gpkg"), pixels)


def test_plain_images_work_the_same_in_pixels(run: Run, striped: Path) -> None:
    write_without_place("scene.tif", drawn())
    cv2.imwrite("scene.png", drawn())
    for name in ("scene.tif", "scene.png"):
        assert run("predict", name, "--model", striped, "--out", f"{name}.geojson")[0] == 0
    assert_same_lines(lines_of("scene.tif.geojson"), lines_of("scene.png.geojson"))


def test_deep_pixels_are_stretched_and_bands_chosen(run: Run, striped: Path) -> None:
    deep = np.stack(
        [np.full((300, 450), 9), drawn().astype(int) * 12 + 500, np.arange(135_000).reshape(300, 450) % 7]
    )
    write("scene.tif", deep.astype(np.uint16))
    write("flat.tif", drawn())
    options = ("--model", striped, "--threshold", 0.5)
    assert run("predict", "flat.tif", *options, "--out", "a.gpkg")[0] == 0
    assert run("predict", "scene.tif", *options, "--bands", "2", "--out", "b.gpkg")[0] == 0
    assert_same_lines(lines_of("a.gpkg"), lines_of("b.gpkg"))
    code, _, err = run("predict", "scene.tif", *options, "--bands", "4,2,1", "--out", "c.gpkg")
    assert (code, "has 3: give three numbers" in err) == (2, True)
    code, _, err = run("predict", "scene.tif", *options, "--bands", "red", "--out", "c.gpkg")
    assert (code, "--bands is 'red'" in err) == (2, True)


def test_regions_without_data_are_skipped(run: Run, striped: Path) -> None:
    values = drawn() // 2 + 100
    values[:, 200:] = 0
    write("scene.tif", values, nodata=0)
    code, out, err = run("predict", "scene.tif", "--model", striped, "--out", "a.gpkg")
    assert (code, err) == (0, "")
    assert "15 windows (6 without data)" in out
    lines = lines_of("a.gpkg")
    assert len(lines) > 0
    assert max(line[:, 0].max() for line in lines) < 5e5 + 0.5 * 216
    write("empty.tif", np.zeros((300, 450), np.uint8), nodata=0)
    code, out, _ = run("predict", "empty.tif", "--model", striped, "--out", "b.gpkg")
    assert (code, "15 windows (15 without data), 0 polylines" in out) == (0, True)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_no_lines_are_a_valid_file(run: Run, striped: Path, suffix: str) -> None:
    write("scene.tif", np.zeros((200, 200), np.uint8))
    code, out, err = run("predict", "scene.tif", "--model", striped, "--out", f"a{suffix}")
    assert (code, err) == (0, "")
    assert f"0 polylines -> a{suffix}" in out
    if suffix == ".parquet":
        assert parquet.read_table("a.parquet").num_rows == 0
    elif suffix == ".json":
        assert len(read_result("a.json").polylines) == 0
    else:
        assert len(lines_of(f"a{suffix}")) == 0
        assert '"crs"' in Path("a.geojson").read_text() if suffix == ".geojson" else True


def test_damaged_parts_are_reported_and_the_rest_is_written(run: Run, striped: Path) -> None:
    rng = np.random.default_rng(0)
    values = np.maximum(drawn(), rng.integers(0, 40, (300, 450), dtype=np.uint8))
    path = write("scene.tif", values, compress="deflate")
    whole = path.read_bytes()
    path.write_bytes(whole[:-20_000])
    code, out, err = run("predict", "scene.tif", "--model", striped, "--out", "a.gpkg")
    assert code == 2
    assert "polylines -> a.gpkg" in out
    assert err.startswith("Error: ")
    assert err.count("\n") == 1
    assert (
        "of the 15 windows of scene.tif cannot be read and are missing in the result, the first at x " in err
    )
    assert "a.gpkg.partial is kept" in err
    assert len(lines_of("a.gpkg")) > 0
    path.write_bytes(whole)
    Path("a.gpkg").unlink()
    code, _, err = run("predict", "scene.tif", "--model", striped, "--out", "a.gpkg")
    assert (code, err.count("\n")) == (2, 1)  # the file has another size now, and the work is not thrown away
    assert "differs in: scene bytes, scene time. Remove a.gpkg.partial to begin anew" in err
    assert list(Path("a.gpkg.partial").glob("*.npz"))
    shutil.rmtree("a.gpkg.partial")
    assert run("predict", "scene.tif", "--model", striped, "--out", "a.gpkg")[0] == 0
    assert not Path("a.gpkg.partial").exists()


def test_windows_that_failed_are_tried_again(
    run: Run, striped: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from yolino.inference import scene_raster

    write("scene.tif", drawn())
    read = scene_raster.SceneRaster.read
    with monkeypatch.context() as patch:  # what a network drive does that is away for a moment

        def read_some(self: Any, box: Any) -> Any:
            if box[0] > 200:
                raise ValueError("the drive is away")
            return read(self, box)

        patch.setattr(scene_raster.SceneRaster, "read", read_some)
        code, _, err = run("predict", "scene.tif", "--model", striped, "--out", "a.gpkg")
        assert (code, "(the drive is away)" in err) == (2, True)
    Path("a.gpkg").unlink()
    code, _, err = run("predict", "scene.tif", "--model", striped, "--out", "a.gpkg")
    assert (code, "Going on with a.gpkg.partial: 9 windows are done." in err) == (0, True)
    assert run("predict", "scene.tif", "--model", striped, "--out", "b.gpkg")[0] == 0
    assert_same_lines(lines_of("a.gpkg"), lines_of("b.gpkg"))


# Tests that run in the background inherit that Ctrl-C is ignored; a user's terminal does not ignore it.
IN_A_TERMINAL = (
    "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
    "from yolino.cli import main; sys.exit(main(sys.argv[1:]))"
)


def start(*arguments: object) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-c", IN_A_TERMINAL, "predict", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def wait_for(process: subprocess.Popen[bytes], folder: Path, files: int) -> None:
    until = time.monotonic() + 100
    while len(list(folder.glob("*.npz"))) < files:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < until
        time.sleep(0.002)


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_a_killed_run_goes_on_where_it_was(run: Run, striped: Path, how: signal.Signals) -> None:
    write("scene.tif", np.tile(drawn(), (4, 3)))
    arguments = ("scene.tif", "--model", striped, "--out", "a.gpkg", "--overlap", 96)
    process = start(*arguments)
    wait_for(process, Path("a.gpkg.partial"), 2)
    process.send_signal(how)
    _, err = process.communicate(timeout=100)
    assert not Path("a.gpkg").exists()
    if how == signal.SIGINT:
        assert process.returncode == 130
        assert b"Stopped after" in err
        assert b"the same command goes on from there." in err
    code, _, err = run("predict", *arguments)
    assert code == 0
    assert "Going on with a.gpkg.partial: " in err
    done = int(err.split("partial: ")[1].split()[0])
    assert done >= 128
    assert sorted(each.name for each in Path().iterdir()) == ["a.gpkg", "scene.tif", "striped.onnx"]
    assert run("predict", "scene.tif", "--model", striped, "--out", "b.gpkg")[0] == 0
    assert_same_lines(lines_of("a.gpkg"), lines_of("b.gpkg"))


def test_other_models_need_a_scale(run: Run, model: Path) -> None:
    write("scene.tif", np.full((128, 128), 200, np.uint8))
    code, _, err = run("predict", "scene.tif", "--model", model, "--out", "a.gpkg")
    assert code == 2
    assert "The model tiny sees whole images (fit 'bottom'), no windows of a scene: give --scale 1" in err


def test_a_model_for_whole_images_goes_over_a_scene_if_a_scale_is_given(run: Run) -> None:
    write("scene.tif", drawn())
    code, out, err = run("predict", "scene.tif", "--out", "a.geojson", "--scale", 1)
    assert code == 0
    assert err == (
        "The model default was trained on whole images; it goes over scene.tif in windows of 320 x 640.\n"
    )
    assert "1 window, " in out


def test_windows_of_a_model_for_mirrored_images_are_not_mirrored(
    run: Run, make_model: Callable[..., Path], tmp_path: Path, header: Header
) -> None:
    write("scene.tif", drawn())
    said = replace(header, postprocess={**header.postprocess, "flip": True})
    cells = np.stack(np.meshgrid(np.arange(8), np.arange(4)), axis=-1).reshape(-1, 1, 2) * 16.0
    model = make_model(
        tmp_path / "flip.onnx", header=said, endpoints=cells + np.array([[2.0, 8.0], [14.0, 8.0]])
    )
    command = ("predict", "scene.tif", "--model", model, "--out", "a.geojson", "--scale", 1)
    code, _, err = run(*command, "--flip")
    assert (code, "--flip and --no-flip are for images and videos" in err) == (2, True)
    code, _, err = run(*command)
    assert code == 0, err


def test_the_scale_is_that_of_the_network(run: Run, striped: Path) -> None:
    large = np.repeat(np.repeat(drawn(), 2, axis=0), 2, axis=1)
    write("scene.tif", drawn())
    write("large.tif", large, transform=PLACE @ rasterio.Affine.scale(0.5))
    assert run("predict", "scene.tif", "--model", striped, "--out", "a.gpkg")[0] == 0
    assert run("predict", "large.tif", "--model", striped, "--out", "b.gpkg", "--scale", 0.5)[0] == 0
    assert_same_lines(lines_of("a.gpkg"), lines_of("b.gpkg"))
    code, _, err = run("predict", "scene.tif", "--model", striped, "--out", "c.gpkg", "--scale", 0)
    assert (code, "must be above 0" in err) == (2, True)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("scene.tif", "--out", "a.shp"), "has the unknown ending .shp; a scene goes into .gpkg, .geojson"),
        (("scene.tif", "--out", "a.gpkp"), "unknown ending .gpkp (did you mean a.gpkg?); a scene goes into"),
        (("scene.tif", "--out", "a.TXT"), "--out a.TXT has the unknown ending .TXT; a scene goes into"),
        (("scene.tif", "--out", "a.mp4"), "--out a.mp4 is for a video, but scene.tif is none (by its name)"),
        (
            ("scene.tif", "--out", "a.gpkg", "--view", "lines"),
            "--view lines is for pictures, but --out a.gpkg",
        ),
        (("scene.tif", "--out", "a.gpkg", "--no-images"), "--no-images is for pictures, but --out a.gpkg"),
        (("scene.tif", "--out", "a.gpkg", "--images"), "--images is for pictures, but --out a.gpkg"),
        (
            ("scene.tif", "--out", "a.gpkg", "--scale", "1e-9"),
            "shows scene.tif (300 x 450 pixels) to the network as 3e-07 x 4.5e-07 pixels, less than one of "
            "its cells of 16: give 0.0534 or more.",
        ),
        (("scene.tif", "--out", "a.gpkg", "--scale", "0.05"), "give 0.0534 or more."),
        (("scene.tif", "scene.tif", "--out", "a.gpkg"), "for one scene, but 2 sources are given"),
        ((".", "--out", "a.gpkg"), "is a folder, but --out a.gpkg is one file"),
        (("none.tif", "--out", "a.gpkg"), "There is no scene none.tif"),
        (("text.tif", "--out", "a.gpkg"), "text.tif cannot be read as a raster"),
        (("scene.tif", "--out", "there.gpkg"), "exists already and is not replaced"),
        (("scene.tif", "--out", "a.gpkg", "--format", "cvat"), "--format cvat is for a folder"),
        (("scene.tif", "--out", "a.gpkg", "--overlap", "50"), "need a multiple of 32 from 0 to 96"),
        (("scene.tif", "--overlap", "64"), "--overlap is for a scene"),
        (("scene.tif", "--out", "folder", "--bands", "1"), "--bands is for a scene"),
    ],
)
def test_mistakes_are_told_in_one_line(
    run: Run, striped: Path, arguments: tuple[str, ...], message: str
) -> None:
    write("scene.tif", drawn())
    Path("text.tif").write_text("no raster")
    Path("there.gpkg").write_text("mine")
    code, _, err = run("predict", *arguments, "--model", striped)
    assert (code, err.count("\n")) == (2, 1)
    assert message in err
    assert not Path("a.gpkg").exists()
    assert sorted(each.name for each in Path().iterdir()) == sorted(
        ["scene.tif", "striped.onnx", "text.tif", "there.gpkg"]
    )
    assert Path("there.gpkg").read_text() == "mine"


def test_in_a_folder_a_scene_is_an_image_like_others(run: Run, striped: Path) -> None:
    write("scene.tif", drawn())
    assert run("predict", "scene.tif", "--model", striped, "--out", "found")[0] == 0
    assert json.loads(Path("found/scene.json").read_text())["size"] == [300, 450]
    assert run("predict", "scene.tif", "--model", striped, "--out", "a.json")[0] == 0
    one, other = (read_result(path).polylines for path in ("found/scene.json", "a.json"))
    np.testing.assert_allclose(one.vertices, other.vertices, atol=0.011)


def test_a_folder_may_have_a_dot(run: Run, striped: Path) -> None:
    write("scene.tif", drawn())
    Path("there.v2").mkdir()
    for out in ("new.v1/", "there.v2", "odd.gpkg/"):
        assert run("predict", "scene.tif", "--model", striped, "--out", out)[0] == 0
        assert sorted(each.name for each in Path(out).iterdir()) == ["scene.json", "scene.png"]


LOCAL = 'LOCAL_CS["site",UNIT["metre",1]]'


def test_geojson_of_a_local_system_is_refused_before_the_first_window(
    run: Run, striped: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from yolino.inference import scene

    write("scene.tif", drawn(), crs=LOCAL)
    with monkeypatch.context() as patch:
        patch.setattr(scene, "scan", lambda *_, **__: pytest.fail("a window was computed"))
        code, _, err = run("predict", "scene.tif", "--model", striped, "--out", "a.geojson")
    assert (code, err) == (
        2,
        "Error: a.geojson cannot be written: the coordinate reference system of scene.tif has no longitude "
        "and latitude, which GeoJSON needs; give --out a name in .gpkg or .parquet.\n",
    )
    assert sorted(each.name for each in Path().iterdir()) == ["scene.tif", "striped.onnx"]
    for suffix in (".gpkg", ".parquet", ".json"):
        assert run("predict", "scene.tif", "--model", striped, "--out", f"a{suffix}")[0] == 0


def test_geojson_without_a_system_is_advised_against(run: Run, striped: Path) -> None:
    write("units.tif", drawn(), crs=None)
    write_without_place("pixels.tif", drawn())
    advice = "Programs take GeoJSON without a system for longitude and latitude: .gpkg is better here.\n"
    for name in ("units", "pixels"):
        code, _, err = run("predict", f"{name}.tif", "--model", striped, "--out", f"{name}.geojson")
        assert (code, err.count("\n"), err.endswith(advice)) == (0, 1, True)


@pytest.mark.parametrize("size", [(1, 300), (300, 1), (1, 1)])
@pytest.mark.parametrize("own", [1.0, 0.5, 0.1])
def test_thin_scenes_have_data(run: Run, striped: Path, size: tuple[int, int], own: float) -> None:
    thin = make_striped_model(Path("thin.onnx"), striped_header(scale=own))
    write("scene.tif", np.full(size, 200, np.uint8))
    for i, scale in enumerate(((), ("--scale", own), ("--scale", 1))):
        code, out, err = run("predict", "scene.tif", "--model", thin, "--out", f"{i}.gpkg", *scale)
        assert (code, err) == (0, "")
        assert "without data" not in out
    code, _, err = run("predict", "scene.tif", "--model", thin, "--out", "c.gpkg", "--scale", own * 0.9)
    assert (code, f"give {own:g} or more." in err) == (2, True)


def test_other_options_never_throw_work_away(run: Run, striped: Path) -> None:
    path = write("scene.tif", drawn(), compress="deflate")
    path.write_bytes(path.read_bytes()[:-200])
    arguments = ("predict", "scene.tif", "--model", striped, "--out", "a.gpkg")
    assert run(*arguments)[0] == 2
    Path("a.gpkg").unlink()
    before = {each.name: each.read_bytes() for each in Path("a.gpkg.partial").iterdir()}
    code, _, err = run(*arguments, "--threshold", 0.25)
    assert (code, err) == (
        2,
        "Error: Earlier work in a.gpkg.partial differs in: threshold. Remove a.gpkg.partial to begin "
        "anew, or go on as before.\n",
    )
    assert {each.name: each.read_bytes() for each in Path("a.gpkg.partial").iterdir()} == before
    assert "Going on with a.gpkg.partial" in run(*arguments)[2]
