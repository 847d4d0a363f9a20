"""Where the pixels of an image lie on the map: GeoTIFF and world files, pixels to map coordinates and back.

Rasters are read by GDAL through rasterio, which is imported where it is used. GDAL counts pixels as we do:
continuous, (0, 0) is the outer corner of the top-left pixel. It converts world files, which tell where the
center of that pixel lies, and GeoTIFFs whose points mean centers.
"""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from yolino.geometry import transform_points

LON_LAT = "urn:ogc:def:crs:OGC:1.3:CRS84"
"""Longitude and latitude in degrees on WGS84: the only coordinates of a GeoJSON of today (RFC 7946)."""
_GEOREFERENCED = (".tif", ".tiff", ".jp2")
# The first and last letter of the image's suffix and a w, its whole suffix and a w, or .wld.
_SIDECARS = (".wld", ".tfw", ".jgw", ".pgw", ".bpw", ".tifw", ".tiffw", ".pngw", ".aux.xml")


@dataclass(frozen=True, eq=False)
class Georeference:
    """Where the pixels of a raster lie on the map.

    Attributes:
        matrix: From pixels `(x, y)` to map coordinates, affine, for column vectors.
        crs: Coordinate reference system of the map coordinates as WKT; None where the raster names none.
        size: `(height, width)` of the raster.
    """

    matrix: Float[np.ndarray, "3 3"]
    crs: str | None
    size: tuple[int, int]

    def to_map(self, points: Float[np.ndarray, "n 2"], crs: str | None = None) -> Float[np.ndarray, "n 2"]:
        """Gives points `(x, y)` in pixels as map coordinates: easting, northing or longitude, latitude.

        Args:
            points: Points in pixels.
            crs: Coordinate reference system of the result; None: the raster's.

        Raises:
            ValueError: The system is not known, or a point cannot be expressed in it.
        """
        return _reproject(transform_points(points, self.matrix), self.crs, crs)

    def to_pixels(self, points: Float[np.ndarray, "n 2"], crs: str | None = None) -> Float[np.ndarray, "n 2"]:
        """Gives map coordinates as points `(x, y)` in pixels, which may lie outside the raster.

        Args:
            points: Easting, northing or longitude, latitude: always x first, whatever the system says.
            crs: Coordinate reference system of the points; None: the raster's. Where the raster names none,
                the points are taken to be in it.

        Raises:
            ValueError: The system is not known, or a point has no place in the raster's.
        """
        # The origin is taken off first: map coordinates are large, and digits would be lost.
        offset = _reproject(points, crs, self.crs) - self.matrix[:2, 2]
        return np.asarray(offset @ np.linalg.inv(self.matrix[:2, :2]).T)


def may_be_georeferenced(image: Path) -> bool:
    """Gives whether an image file could have a georeference, by its kind or by a file beside it.

    It is not opened.
    """
    if not image.is_file():
        return False
    kind = image.suffix.lower() in _GEOREFERENCED
    return kind or any(file.is_file() for suffix in _SIDECARS for file in _beside(image, suffix))


def sidecars(image: Path) -> list[Path]:
    """Gives the files beside an image that say where on the map it lies."""
    return sorted({file for end in _SIDECARS for file in _beside(image, end) if file.is_file()})


def read_georeference(image: str | Path) -> Georeference | None:
    """Gives the georeference of a raster, None where it has none. Its pixels are not read.

    Control points and camera models (GCPs, RPCs) are no georeference here: they first need warping.

    Raises:
        ValueError: The file is no raster, or its transform cannot be inverted.
        ModuleNotFoundError: rasterio is not installed.
    """
    import rasterio  # optional: only maps need it

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
        try:
            with rasterio.open(os.fspath(image)) as raster:
                at, crs, size = raster.transform, raster.crs, (int(raster.height), int(raster.width))
        except rasterio.errors.RasterioIOError as error:
            raise ValueError(f"{image} cannot be read as a raster ({error}).") from None
    if at.is_identity:
        return None
    matrix = np.array([[at.a, at.b, at.c], [at.d, at.e, at.f], [0, 0, 1]], np.float64)
    if not (np.isfinite(matrix).all() and np.linalg.det(matrix[:2, :2]) != 0):
        raise ValueError(f"{image} has a transform that maps all pixels to a line: georeference it anew.")
    return Georeference(matrix, crs.to_wkt() if crs else None, size)


def crs_name(crs: str) -> str | None:
    """Gives the name under which other programs know a coordinate reference system, None without one.

    It is a URN of the EPSG: `urn:ogc:def:crs:EPSG::25832`, or `LON_LAT`.

    Raises:
        ValueError: The system is not known.
    """
    code = _known(crs).to_epsg(confidence_threshold=100)
    if crs == LON_LAT or code == 4326:  # that number of the EPSG means latitude first, a GeoJSON never does
        return LON_LAT
    return None if code is None else f"urn:ogc:def:crs:EPSG::{code}"


def _beside(image: Path, suffix: str) -> tuple[Path, ...]:
    """Gives the names that a file with this suffix may have beside an image."""
    names = (image.stem + suffix, image.stem + suffix.upper(), image.name + suffix)
    return tuple(image.with_name(name) for name in names)


def _known(crs: str) -> Any:
    from rasterio.crs import CRS
    from rasterio.errors import CRSError

    try:
        return CRS.from_user_input(crs)
    except CRSError:
        shown = crs if len(crs) <= 60 else f"{crs[:60]}..."
        raise ValueError(
            f"The coordinate reference system {shown!r} is not known: write one like EPSG:25832."
        ) from None


def _reproject(
    points: Float[np.ndarray, "n 2"], source: str | None, target: str | None
) -> Float[np.ndarray, "n 2"]:
    """Gives points of one coordinate reference system in another; None is the same as the other."""
    if source is None or target is None or source == target or len(points) == 0:
        return points
    from rasterio._err import CPLE_BaseError  # what PROJ raises has no public name
    from rasterio.warp import transform

    start, end = _known(source), _known(target)
    if start == end:
        return points
    try:
        x, y = transform(start, end, points[:, 0], points[:, 1])
        moved = np.stack([np.asarray(x, np.float64), np.asarray(y, np.float64)], axis=1)
    except CPLE_BaseError:
        moved = np.full((1, 2), np.inf)
    if not np.isfinite(moved).all():
        low, high = points.min(axis=0), points.max(axis=0)
        raise ValueError(
            f"Points with x from {low[0]:g} to {high[0]:g} and y from {low[1]:g} to {high[1]:g} "
            f"cannot all be expressed from {start.to_string()[:60]} in {end.to_string()[:60]}."
        )
    return moved


__all__ = ["LON_LAT", "Georeference", "crs_name", "may_be_georeferenced", "read_georeference"]
