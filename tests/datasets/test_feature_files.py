from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from yolino.datasets.feature_files import FEATURE_WRITERS, check_place
from yolino.datasets.features import Features, to_features
from yolino.datasets.georeference import Georeference
from yolino.types import Polylines

rasterio = pytest.importorskip("rasterio", reason="rasterio knows the coordinate reference systems")
pyogrio = pytest.importorskip("pyogrio", reason="pyogrio writes GeoPackages")
parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow writes GeoParquet")

LINES = Polylines.from_list([[[0, 0], [3, 4]], [[1, 1], [1, 2], [5, 2]]], [0.9, 0.51234567], [1, 0])
ALBERS = "+proj=aea +lat_1=47 +lat_2=55 +lat_0=50 +lon_0=10 +datum=WGS84"  # has no number


def place(crs: str | None) -> Georeference:
    x, y = {"EPSG:4326": (10.0, 50.0), ALBERS: (0.0, 0.0)}.get(crs, (5e5, 5.4e6))
    known = None if crs is None else rasterio.crs.CRS.from_user_input(crs).to_wkt()
    return Georeference(np.array([[1e-5, 0, x], [0, -1e-5, y], [0, 0, 1]]), known, (50, 90))


def features(lines: Polylines = LINES, crs: str | None = "EPSG:25832", *, classes: bool = True) -> Features:
    where = None if crs is None else place(crs)
    names = ("way", "link") if classes else ()
    return to_features(lines, names, where, {"image": "a/b.tif", "model": "m"})


def points(wkb: bytes) -> np.ndarray:
    order, kind, count = struct.unpack("<BII", wkb[:9])
    assert (order, kind) == (1, 2)
    return np.frombuffer(wkb, "<f8", offset=9).reshape(count, 2)


def read(path: Path) -> tuple[dict[str, list[Any]], list[np.ndarray], str | None]:
    """Columns, lines and system of a file, by another program than the one that wrote it."""
    if path.suffix == ".parquet":
        table = parquet.read_table(path)
        columns = table.to_pydict()
        geometry = columns.pop("geometry")
        crs = json.loads(table.schema.metadata[b"geo"])["columns"]["geometry"]["crs"]
        return columns, [points(each) for each in geometry], None if crs is None else json.dumps(crs)
    about, _, geometry, values = pyogrio.raw.read(path)
    assert about["geometry_type"] == "LineString" or not len(geometry)
    columns = {name: list(column) for name, column in zip(about["fields"], values, strict=True)}
    return columns, [points(each) for each in geometry], about["crs"]


@pytest.mark.parametrize("suffix", FEATURE_WRITERS)
@pytest.mark.parametrize("crs", ["EPSG:25832", "EPSG:4326", ALBERS, None])
def test_other_programs_read_what_was_written(tmp_path: Path, suffix: str, crs: str | None) -> None:
    path, given = tmp_path / f"a{suffix}", features(crs=crs)
    FEATURE_WRITERS[suffix](path, given)
    columns, lines, found = read(path)
    assert list(columns) == list(given.columns)
    for name, values in given.columns.items():
        if values.dtype == object:
            assert columns[name] == values.tolist()
        else:
            np.testing.assert_allclose(columns[name], values, atol=6e-5 if name == "score" else 6e-4)
    if crs is None and suffix == ".geojson":
        assert json.loads(path.read_text())["yolino"]["coordinates"] == "pixel"
    elif crs is None:
        assert found is None
    elif crs == ALBERS and suffix == ".geojson":
        assert found in ("EPSG:4326", "OGC:CRS84")
        given = Features(
            LINES.with_vertices(given.place.to_map(LINES.vertices, "EPSG:4326")), {}, given.place
        )
    else:
        assert rasterio.crs.CRS.from_user_input(found) == rasterio.crs.CRS.from_user_input(crs)
    for line, wanted in zip(lines, given.lines, strict=True):
        np.testing.assert_allclose(line, wanted, atol=6e-5 if suffix == ".geojson" else 0)
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("suffix", FEATURE_WRITERS)
@pytest.mark.parametrize("crs", ["EPSG:25832", None])
def test_no_lines_are_a_file_with_all_columns(tmp_path: Path, suffix: str, crs: str | None) -> None:
    path = tmp_path / f"a{suffix}"
    FEATURE_WRITERS[suffix](path, features(LINES[:0], crs))
    if suffix == ".geojson":
        document = json.loads(path.read_text())
        assert document["features"] == []
        assert ("crs" in document) == (crs is not None)
        return
    columns, lines, found = read(path)
    assert columns == {"id": [], "class": [], "score": [], "length_px" if crs is None else "length_m": []}
    assert lines == []
    assert (found is None) == (crs is None)


@pytest.mark.parametrize("suffix", FEATURE_WRITERS)
def test_models_without_classes_have_none(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    FEATURE_WRITERS[suffix](path, features(classes=False))
    assert read(path)[0]["class"] == [None, None]


def test_the_parquet_metadata_are_those_of_geoparquet(tmp_path: Path) -> None:
    FEATURE_WRITERS[".parquet"](tmp_path / "a.parquet", features())
    metadata = parquet.read_schema(tmp_path / "a.parquet").metadata
    geo = json.loads(metadata[b"geo"])
    assert (geo["version"], geo["primary_column"]) == ("1.1.0", "geometry")
    column = geo["columns"]["geometry"]
    assert (column["encoding"], column["geometry_types"]) == ("WKB", ["LineString"])
    assert column["crs"]["id"] == {"authority": "EPSG", "code": 25832}
    np.testing.assert_allclose(column["bbox"], [5e5, 5.4e6 - 4e-5, 5e5 + 5e-5, 5.4e6])
    assert metadata[b"yolino:model"] == b"m"


def test_a_file_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    for suffix, write in FEATURE_WRITERS.items():
        with pytest.raises(OSError, match=suffix):
            write(tmp_path / "file" / f"a{suffix}", features())
    assert [each.name for each in tmp_path.iterdir()] == ["file"]


LOCAL = 'LOCAL_CS["site",UNIT["metre",1]]'
GLOBE = "+proj=geos +h=35785831 +lon_0=0 +ellps=GRS80"  # as a weather satellite sees it: the corners are sky


@pytest.mark.parametrize("crs", ["EPSG:25832", "EPSG:4326", ALBERS, GLOBE, None])
def test_what_can_be_expressed_is_not_refused(crs: str | None) -> None:
    known = None if crs is None else rasterio.crs.CRS.from_user_input(crs).to_wkt()
    matrix = np.array([[110_000.0, 0, -5_500_000], [0, -110_000.0, 5_500_000], [0, 0, 1]])
    at = Georeference(matrix, known, (100, 100)) if crs == GLOBE else place(crs)
    for suffix in FEATURE_WRITERS:
        check_place(Path(f"a{suffix}"), Path("scene.tif"), at)


def test_a_local_system_is_refused_for_geojson_alone() -> None:
    for suffix in (".gpkg", ".parquet"):
        check_place(Path(f"a{suffix}"), Path("scene.tif"), place(LOCAL))
    with pytest.raises(
        ValueError, match=r"^a.geojson cannot .* of scene.tif has no .* in .gpkg or .parquet.$"
    ):
        check_place(Path("a.geojson"), Path("scene.tif"), place(LOCAL))
