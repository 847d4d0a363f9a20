from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from yolino.datasets.georeference import (
    LON_LAT,
    Georeference,
    crs_name,
    may_be_georeferenced,
    read_georeference,
)

rasterio = pytest.importorskip("rasterio", reason="rasterio reads georeferences")

UTM32 = "EPSG:32632"  # its central meridian, 9 degrees east, has the easting 500000


def write_tiff(path: Path, transform: tuple[float, ...], crs: str | None = UTM32) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    affine = rasterio.Affine(*transform)
    form = {"driver": "GTiff", "width": 8, "height": 4, "count": 1, "dtype": "uint8"}
    with rasterio.open(path, "w", crs=crs, transform=affine, **form) as raster:
        raster.write(np.zeros((1, 4, 8), np.uint8))
    return path


def write_plain(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(cv2.imencode(path.suffix, np.zeros((4, 8, 3), np.uint8))[1].tobytes())
    return path


def test_a_geotiff_leads_from_its_outer_corner(tmp_path):
    place = read_georeference(write_tiff(tmp_path / "a.tif", (0.5, 0, 100, 0, -0.5, 200)))
    assert place.size == (4, 8)
    pixels = np.array([[0, 0], [8, 4], [0.5, 0.5], [-2, 10]], float)
    on_map = np.array([[100, 200], [104, 198], [100.25, 199.75], [99, 195]])
    assert place.to_map(pixels).tolist() == on_map.tolist()
    assert place.to_pixels(on_map).tolist() == pixels.tolist()


@pytest.mark.parametrize(
    ("image", "world"),
    [
        ("a.jpg", "a.jgw"),
        ("a.png", "a.pgw"),
        ("a.tif", "a.tfw"),
        ("a.png", "a.wld"),
        ("a.png", "a.pngw"),
        ("a.jpg", "a.JGW"),
    ],
)
def test_a_world_file_tells_the_center_of_the_first_pixel(tmp_path, image, world):
    path = write_plain(tmp_path / image)
    (tmp_path / world).write_text("0.5\n0\n0\n-0.5\n100.25\n199.75\n")
    assert may_be_georeferenced(path)
    place = read_georeference(path)
    assert place.crs is None
    assert place.to_map(np.array([[0.5, 0.5], [0, 0]])).tolist() == [[100.25, 199.75], [100, 200]]


def test_an_image_without_georeference_has_none(tmp_path):
    assert read_georeference(write_plain(tmp_path / "a.tif")) is None
    assert read_georeference(write_plain(tmp_path / "a.jpg")) is None
    assert may_be_georeferenced(tmp_path / "a.tif")
    assert not may_be_georeferenced(tmp_path / "a.jpg")
    assert not may_be_georeferenced(tmp_path / "nothing.tif")


def test_what_is_no_raster_is_named(tmp_path):
    (tmp_path / "a.tif").write_bytes(b"no image")
    with pytest.raises(ValueError, match=r"a\.tif cannot be read as a raster"):
        read_georeference(tmp_path / "a.tif")
    with pytest.raises(ValueError, match=r"b\.tif cannot be read as a raster"):
        read_georeference(tmp_path / "b.tif")
    write_plain(tmp_path / "c.jpg")
    (tmp_path / "c.jgw").write_text("1\n1\n1\n1\n100\n200\n")
    with pytest.raises(ValueError, match="to a line"):
        read_georeference(tmp_path / "c.jpg")


def test_coordinates_of_another_system_are_reprojected(tmp_path):
    place = read_georeference(write_tiff(tmp_path / "a.tif", (2, 0, 499_990, 0, -2, 10)))
    # On the equator at the central meridian: 500000 east, 0 north, so 10 m right of and below the corner.
    for crs in (LON_LAT, "EPSG:4326", "urn:ogc:def:crs:EPSG::4326", "OGC:CRS84"):
        assert place.to_pixels(np.array([[9.0, 0.0]]), crs) == pytest.approx(np.array([[5, 5]]), abs=1e-6)
        assert place.to_map(np.array([[5.0, 5.0]]), crs) == pytest.approx(np.array([[9, 0]]), abs=1e-9)
    assert place.to_pixels(np.array([[500_000.0, 0.0]]), UTM32).tolist() == [[5, 5]]
    assert place.to_pixels(np.zeros((0, 2)), LON_LAT).shape == (0, 2)
    # East is right, south is down; a degree of longitude on the equator is about 111.3 km there.
    moved = place.to_pixels(np.array([[9.0001, 0.0], [9.0, -0.0001]]), LON_LAT) - 5
    assert moved == pytest.approx(np.array([[5.563, 0], [0, 5.527]]), abs=2e-3)


def test_a_raster_without_a_system_is_in_that_of_the_points():
    place = Georeference(np.array([[2, 0, 10], [0, -2, 20], [0, 0, 1]], float), None, (4, 8))
    assert place.to_pixels(np.array([[14.0, 10.0]]), LON_LAT).tolist() == [[2, 5]]
    assert place.to_map(np.array([[2.0, 5.0]])).tolist() == [[14, 10]]


def test_places_and_systems_that_do_not_exist_are_named(tmp_path):
    place = read_georeference(write_tiff(tmp_path / "a.tif", (2, 0, 499_990, 0, -2, 10)))
    for point in ([1000.0, 49.0], [98.0, 0.0]):
        with pytest.raises(ValueError, match="cannot all be expressed"):
            place.to_pixels(np.array([[9.0, 0.0], point]), LON_LAT)
    for crs in ("EPSG:99999999", "nonsense", "", "x" * 1000):
        with pytest.raises(ValueError, match="is not known: write one like") as caught:
            place.to_pixels(np.array([[9.0, 0.0]]), crs)
        assert len(str(caught.value)) < 200


def test_systems_are_named_as_others_know_them(tmp_path):
    for crs in (UTM32, "EPSG:2263"):
        place = read_georeference(write_tiff(tmp_path / "a.tif", (2, 0, 499_990, 0, -2, 10), crs))
        assert crs_name(place.crs) == crs.replace("EPSG:", "urn:ogc:def:crs:EPSG::")
    assert crs_name("EPSG:4326") == crs_name(LON_LAT) == LON_LAT == "urn:ogc:def:crs:OGC:1.3:CRS84"
    assert crs_name("+proj=tmerc +lat_0=49.1 +lon_0=8 +ellps=GRS80") is None


numbers = st.floats(-3, 3)


@settings(deadline=None)
@given(
    st.tuples(numbers, numbers, st.floats(-7e6, 7e6), numbers, numbers, st.floats(-7e6, 7e6)),
    st.lists(st.tuples(st.floats(-1e5, 1e5), st.floats(-1e5, 1e5)), min_size=1, max_size=5),
)
def test_to_map_and_back_is_the_identity_and_equals_the_plain_formulas(affine, points):
    a, b, c, d, e, f = affine
    scale = max(abs(v) for v in (a, b, d, e))
    assume(abs(a * e - b * d) > 0.05 * scale**2 and scale > 0.05)
    place = Georeference(np.array([[a, b, c], [d, e, f], [0, 0, 1]]), None, (4, 8))
    pixels = np.array(points)
    on_map = place.to_map(pixels)
    for (x, y), found in zip(points, on_map, strict=True):
        assert found == pytest.approx([a * x + b * y + c, d * x + e * y + f], rel=1e-12, abs=1e-6)
    assert place.to_pixels(on_map) == pytest.approx(pixels, abs=1e-5)
