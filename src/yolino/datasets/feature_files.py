"""Files of map features: GeoPackage, GeoJSON and GeoParquet, each wholly there or not at all.

The writers stand here, beside the georeference and the GeoJSON of labels, because they speak of map
coordinates and know nothing of networks. pyogrio (with GDAL) and pyarrow are imported where they are used.
"""

from __future__ import annotations

import contextlib
import json
import os
import struct
import uuid
import warnings
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yolino.datasets.features import Features
from yolino.datasets.geojson_document import Head, to_feature, to_text
from yolino.datasets.georeference import LON_LAT, Georeference, crs_name
from yolino.io import write_atomic

LAYER = "polylines"
_LINE_STRING = 2
_LITTLE_ENDIAN = 1


def write_geopackage(path: Path, features: Features) -> None:
    """Writes a GeoPackage with the one layer `polylines`.

    Raises:
        ModuleNotFoundError: pyogrio is not installed.
        OSError: The place cannot be written.
    """
    from pyogrio import raw

    temporary = path.with_name(f".{uuid.uuid4().hex[:12]}.gpkg")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=".*crs.*", category=UserWarning)  # without is allowed
            raw.write(
                str(temporary),
                np.array([*_wkb(features)], dtype=object),
                list(features.columns.values()),
                np.array(list(features.columns), dtype=object),
                layer=LAYER,
                driver="GPKG",
                geometry_type="LineString",
                crs=features.crs,
                layer_metadata=features.about or None,
            )
        os.replace(temporary, path)
    except OSError as error:
        raise OSError(f"{path} cannot be written: {error.strerror or error}.") from None
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


def check_place(path: Path, scene: Path, place: Georeference) -> None:
    """Refuses a file that cannot express where a scene lies, before there is anything to write.

    Args:
        path: The file, with a suffix in `FEATURE_WRITERS`.
        scene: The scene.
        place: Where it lies.

    Raises:
        ValueError: It is GeoJSON, and no place of the scene can be said in longitude and latitude.
    """
    if path.suffix.lower() != ".geojson" or place.crs is None or crs_name(place.crs) is not None:
        return
    sides = (np.linspace(0, side, 5) for side in reversed(place.size))
    for point in np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 1, 2):
        with contextlib.suppress(ValueError):  # corners of a picture of the globe show the sky
            place.to_map(point, LON_LAT)
            return
    raise ValueError(
        f"{path} cannot be written: the coordinate reference system of {scene} has no longitude and "
        "latitude, which GeoJSON needs; give --out a name in .gpkg or .parquet."
    )


def write_geojson(path: Path, features: Features) -> None:
    """Writes a GeoJSON document that names its coordinate reference system in the member `crs`.

    Where that has no number of the EPSG, coordinates are longitude and latitude. Coordinates are rounded to a
    tenth of a millimeter, in pixels to a hundredth.

    Raises:
        ValueError: The coordinates cannot be expressed in longitude and latitude.
        OSError: The place cannot be written.
    """
    lines, crs, decimals = features.lines, None, 2
    if features.place is not None:
        crs = None if features.crs is None else crs_name(features.crs)
        if features.crs is not None and crs is None:
            degrees = features.place.to_map(features.place.to_pixels(lines.vertices), LON_LAT)
            lines, crs = lines.with_vertices(degrees), LON_LAT
        decimals = 9 if crs is not None and _is_degrees(crs) else 4
    columns = {name: _plain(name, values) for name, values in features.columns.items()}
    found = [
        to_feature("LineString", np.round(points, decimals).tolist(), dict(zip(columns, values, strict=True)))
        for points, *values in zip(lines, *columns.values(), strict=True)
    ]
    size = None if features.place is None else features.place.size
    kind = "pixel" if features.place is None else "map"
    write_atomic(path, to_text(Head(features.about.get("image"), size, kind, crs), found))


def write_geoparquet(path: Path, features: Features) -> None:
    """Writes GeoParquet 1.1: a Parquet file whose column `geometry` holds WKB.

    Raises:
        ModuleNotFoundError: pyarrow is not installed.
        OSError: The place cannot be written.
    """
    import pyarrow
    from pyarrow import parquet

    kinds = {"id": pyarrow.int64(), "class": pyarrow.string()}
    columns = {
        name: pyarrow.array(values.tolist(), kinds.get(name, pyarrow.float64()))
        for name, values in features.columns.items()
    }
    columns["geometry"] = pyarrow.array(list(_wkb(features)), pyarrow.binary())
    metadata = {"geo": json.dumps(_geo_metadata(features))} | {
        f"yolino:{key}": value for key, value in features.about.items()
    }
    buffer = BytesIO()
    parquet.write_table(pyarrow.table(columns, metadata=metadata), buffer, compression="zstd")
    write_atomic(path, buffer.getvalue())


FEATURE_WRITERS: dict[str, Callable[[Path, Features], None]] = {
    ".gpkg": write_geopackage,
    ".geojson": write_geojson,
    ".parquet": write_geoparquet,
}
"""Writers of map features by the suffix of the file."""


def _geo_metadata(features: Features) -> dict[str, Any]:
    """Gives what GeoParquet 1.1 says about the column; a missing `crs` would mean longitude and latitude."""
    column: dict[str, Any] = {"encoding": "WKB", "geometry_types": ["LineString"], "crs": None}
    if features.crs is not None:
        from rasterio.crs import CRS

        column["crs"] = CRS.from_user_input(features.crs).to_dict(projjson=True)
    points = features.lines.vertices
    if len(points):
        column["bbox"] = [*points.min(axis=0).tolist(), *points.max(axis=0).tolist()]
    return {"version": "1.1.0", "primary_column": "geometry", "columns": {"geometry": column}}


def _wkb(features: Features) -> Iterator[bytes]:
    """Yields the lines as well-known binary."""
    for points in features.lines:
        head = struct.pack("<BII", _LITTLE_ENDIAN, _LINE_STRING, len(points))
        yield head + np.ascontiguousarray(points, "<f8").tobytes()


def _plain(name: str, values: NDArray[Any]) -> list[Any]:
    if name == "score":
        return list(np.round(values, 4).tolist())
    if name.startswith("length"):
        return list(np.round(values, 3).tolist())
    return list(values.tolist())


def _is_degrees(crs: str) -> bool:
    from rasterio.crs import CRS

    return bool(CRS.from_user_input(crs).is_geographic)


__all__ = ["FEATURE_WRITERS", "LAYER", "check_place", "write_geojson", "write_geopackage", "write_geoparquet"]
