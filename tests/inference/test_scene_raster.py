from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from yolino.inference.preprocess import FILL
from yolino.inference.scene_raster import SceneRaster, open_scene
from yolino.inference.views import ImageRaster

rasterio = pytest.importorskip("rasterio", reason="rasterio reads the scenes of these tests")
ALL = (0, 0, 80, 60)


def pixels(count: int, kind: Any = np.uint8, size: tuple[int, int] = (60, 80)) -> np.ndarray:
    most = 256 if np.dtype(kind) == np.uint8 else 4000
    return np.random.default_rng(3).integers(1, most, (count, *size)).astype(kind)


def write(path: Path, values: np.ndarray, **options: Any) -> Path:
    count, height, width = values.shape
    tiles = {"tiled": True, "blockxsize": 16, "blockysize": 16, "crs": "EPSG:25832"}
    place = {"transform": rasterio.Affine(0.5, 0, 5e5, 0, -0.5, 5e6)}
    after = {name: options.pop(name) for name in ("colorinterp", "colormap", "mask") if name in options}
    settings = {"driver": "GTiff", "count": count, "height": height, "width": width, "dtype": values.dtype}
    with rasterio.open(path, "w", **settings | tiles | place | options) as raster:
        if "colorinterp" in after:
            raster.colorinterp = [rasterio.enums.ColorInterp[name] for name in after["colorinterp"]]
        raster.write(values)
        if "colormap" in after:
            raster.write_colormap(1, after["colormap"])
        if "mask" in after:
            raster.write_mask(after["mask"])
    return path


def test_parts_of_three_bands_are_as_they_are(tmp_path: Path) -> None:
    values = pixels(3)
    raster = SceneRaster(write(tmp_path / "a.tif", values))
    assert raster.size == (60, 80)
    rgb, valid = raster.read((10, 20, 43, 31))
    np.testing.assert_array_equal(rgb, np.moveaxis(values, 0, 2)[20:31, 10:43])
    assert valid is None


def test_one_band_is_gray_and_of_two_the_first(tmp_path: Path) -> None:
    for count in (1, 2):
        values = pixels(count)
        rgb, _ = SceneRaster(write(tmp_path / f"{count}.tif", values)).read(ALL)
        np.testing.assert_array_equal(rgb, np.repeat(values[0][:, :, None], 3, axis=2))


def test_colors_are_found_by_what_the_bands_say(tmp_path: Path) -> None:
    values = pixels(4)
    names = ["undefined", "blue", "green", "red"]
    path = write(tmp_path / "a.tif", values, colorinterp=names, photometric="minisblack")
    np.testing.assert_array_equal(SceneRaster(path).read(ALL).rgb, np.moveaxis(values[[3, 2, 1]], 0, 2))
    rgb = SceneRaster(path, (1, 2, 4)).read(ALL).rgb
    np.testing.assert_array_equal(rgb, np.moveaxis(values[[0, 1, 3]], 0, 2))
    assert (SceneRaster(path, (2,)).read(ALL).rgb == values[1][:, :, None]).all()
    plain = write(tmp_path / "b.tif", pixels(5), photometric="minisblack")
    np.testing.assert_array_equal(SceneRaster(plain).read(ALL).rgb, np.moveaxis(pixels(5)[:3], 0, 2))


@pytest.mark.parametrize("bands", [(1, 2), (0, 1, 2), (1, 2, 5), ()])
def test_bands_that_are_not_there_are_refused(tmp_path: Path, bands: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"has 4: give three numbers \(or one\) from 1 to 4"):
        SceneRaster(write(tmp_path / "a.tif", pixels(4)), bands)


def test_a_color_table_gives_the_colors(tmp_path: Path) -> None:
    values = np.arange(60 * 80).reshape(1, 60, 80).astype(np.uint8) % 3
    table = {0: (9, 8, 7, 255), 1: (100, 0, 200, 255), 2: (1, 2, 3, 255)}
    rgb, _ = SceneRaster(write(tmp_path / "a.tif", values, colormap=table)).read(ALL)
    np.testing.assert_array_equal(rgb, np.array([table[i][:3] for i in range(3)])[values[0]])


@pytest.mark.parametrize("kind", [np.uint16, np.int16, np.float32, np.uint32])
def test_other_numbers_are_stretched_alike_in_all_parts(tmp_path: Path, kind: Any) -> None:
    values = pixels(3, kind)
    values[1] = values[1] // 2 + 100
    raster = SceneRaster(write(tmp_path / "a.tif", values))
    rgb, _ = raster.read(ALL)
    for band in range(3):
        low, high = np.percentile(values[band], (2, 98))
        wanted = np.clip((values[band] - low) / (high - low), 0, 1) * 255
        np.testing.assert_allclose(rgb[:, :, band], wanted, atol=0.51)
    np.testing.assert_array_equal(raster.read((3, 4, 50, 44)).rgb, rgb[4:44, 3:50])


def test_a_scene_of_one_number_is_black(tmp_path: Path) -> None:
    raster = SceneRaster(write(tmp_path / "a.tif", np.full((1, 60, 80), 700, np.uint16)))
    assert (raster.read(ALL).rgb == 0).all()


def test_pixels_without_data_are_gray_and_do_not_stretch(tmp_path: Path) -> None:
    values = pixels(1, np.int16)
    values[0, :, :40] = -9999
    rgb, valid = SceneRaster(write(tmp_path / "a.tif", values, nodata=-9999)).read(ALL)
    assert valid is not None
    np.testing.assert_array_equal(valid, values[0] != -9999)
    assert (rgb[:, :40] == FILL).all()
    low, high = np.percentile(values[0, :, 40:], (2, 98))
    wanted = np.clip((values[0, :, 40:] - low) / (high - low), 0, 1) * 255
    np.testing.assert_allclose(rgb[:, 40:, 0], wanted, atol=0.51)


def test_a_pixel_of_three_bands_is_valid_if_one_says_something(tmp_path: Path) -> None:
    values = pixels(3)
    values[:, :10] = 0
    values[1, 5] = 7
    _, valid = SceneRaster(write(tmp_path / "a.tif", values, nodata=0)).read(ALL)
    np.testing.assert_array_equal(valid, (values != 0).any(axis=0))


def test_transparency_and_masks_are_not_valid(tmp_path: Path) -> None:
    shown = np.zeros((60, 80), np.uint8)
    shown[:, :30] = 255
    colors = ["red", "green", "blue", "alpha"]
    path = write(tmp_path / "a.tif", np.concatenate([pixels(3), shown[None]]), colorinterp=colors)
    np.testing.assert_array_equal(SceneRaster(path).read(ALL).valid, shown > 0)
    np.testing.assert_array_equal(SceneRaster(path, (1,)).read(ALL).valid, shown > 0)
    both = write(tmp_path / "b.tif", np.concatenate([pixels(3), shown[None]]), colorinterp=colors, nodata=0)
    np.testing.assert_array_equal(SceneRaster(both).read(ALL).valid, shown > 0)
    masked = write(tmp_path / "c.tif", pixels(3), mask=shown)
    np.testing.assert_array_equal(SceneRaster(masked).read(ALL).valid, shown > 0)


def test_what_is_no_number_is_not_valid(tmp_path: Path) -> None:
    values = pixels(2, np.float32)
    values[0, 7, 9], values[0, 8, 9] = np.nan, np.inf
    rgb, valid = SceneRaster(write(tmp_path / "a.tif", values)).read(ALL)
    assert valid is not None
    np.testing.assert_array_equal(np.argwhere(~valid), [[7, 9], [8, 9]])
    assert (rgb[~valid] == FILL).all()
    nothing = np.full((1, 60, 80), np.nan, np.float32)
    assert not SceneRaster(write(tmp_path / "b.tif", nothing)).read(ALL).valid.any()


def test_a_damaged_block_is_named_when_it_is_read(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tif", pixels(3, np.uint8, (512, 512)), compress="deflate")
    path.write_bytes(path.read_bytes()[:-200_000])
    raster = SceneRaster(path)
    raster.read((0, 0, 16, 16))
    with pytest.raises(ValueError, match=r"\S"):
        raster.read((480, 480, 512, 512))
    deep = write(tmp_path / "b.tif", pixels(1, np.uint16, (512, 512)), compress="deflate")
    deep.write_bytes(deep.read_bytes()[:-100_000])
    assert (SceneRaster(deep).read((0, 0, 16, 16)).rgb > 0).any()


def test_what_is_no_raster_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"There is no scene .*none\.tif"):
        open_scene(tmp_path / "none.tif")
    (tmp_path / "text.tif").write_text("no raster")
    with pytest.raises(ValueError, match=r"text\.tif cannot be read as a raster"):
        open_scene(tmp_path / "text.tif")
    (tmp_path / "empty.tif").touch()
    with pytest.raises(ValueError, match="cannot be read as a raster"):
        open_scene(tmp_path / "empty.tif")
    path = write(tmp_path / "complex.tif", pixels(1).astype(np.complex64))
    with pytest.raises(ValueError, match="real numbers are needed"):
        open_scene(path)


def test_photos_are_read_whole_unless_they_lie_on_a_map(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), np.moveaxis(pixels(3), 0, 2)[:, :, ::-1])
    assert isinstance(open_scene(path), ImageRaster)
    np.testing.assert_array_equal(open_scene(path).read(ALL).rgb, np.moveaxis(pixels(3), 0, 2))
    swapped = open_scene(path, (3, 2, 1))
    assert isinstance(swapped, SceneRaster)
    np.testing.assert_array_equal(swapped.read(ALL).rgb, np.moveaxis(pixels(3)[::-1], 0, 2))
    (tmp_path / "a.pgw").write_text("0.5\n0\n0\n-0.5\n500000\n5400000\n")
    assert isinstance(open_scene(path), SceneRaster)
    (tmp_path / "b.png").write_bytes(path.read_bytes()[:-3000])
    with pytest.raises(ValueError, match="truncated"):
        open_scene(tmp_path / "b.png").read(ALL)
