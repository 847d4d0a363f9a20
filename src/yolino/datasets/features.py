"""Polylines of a scene as features of a map: their coordinates, and the attributes that a GIS shows."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from yolino.datasets.georeference import LON_LAT, Georeference
from yolino.types import Polylines

# WGS84: half the longer axis in meters, and the square of the eccentricity.
_RADIUS, _ECCENTRICITY2 = 6378137.0, 0.00669437999014


@dataclass(frozen=True, eq=False)
class Features:
    """Lines in map coordinates or pixels, with a value per line in each column.

    Attributes:
        lines: The lines, in map coordinates if there is a place, else in pixels.
        columns: `id` (from 1), `class` (a name, None where the model has none), `score`, and the length:
            `length_m` in meters on the ground where the coordinate reference system is known, else
            `length_px` in pixels.
        place: Where on the map the scene lies, None for pixels.
        about: What else a file may say: source, model, ...
    """

    lines: Polylines
    columns: dict[str, NDArray[Any]]
    place: Georeference | None
    about: dict[str, str] = field(default_factory=dict)

    @property
    def crs(self) -> str | None:
        """Coordinate reference system of the lines as WKT, None where it is not known."""
        return None if self.place is None else self.place.crs


def to_features(
    polylines: Polylines,
    classes: tuple[str, ...],
    place: Georeference | None,
    about: dict[str, str] | None = None,
) -> Features:
    """Gives polylines in pixels as features of the map; those of fewer than two vertices are dropped.

    Args:
        polylines: Polylines in pixels of the scene.
        classes: Names of the classes.
        place: Where the scene lies, None if that is not known.
        about: What a file may say about them.

    Raises:
        ValueError: A label has no name.
    """
    lines = polylines[np.diff(polylines.offsets) >= 2]
    if classes and len(lines) and int(lines.labels.max()) >= len(classes):
        raise ValueError(f"The label {int(lines.labels.max())} has no name: the classes are {list(classes)}.")
    names = np.array([classes[label] if classes else None for label in lines.labels.tolist()], dtype=object)
    columns: dict[str, NDArray[Any]] = {
        "id": np.arange(1, len(lines) + 1, dtype=np.int64),
        "class": names,
        "score": lines.scores,
    }
    meters = None if place is None else lengths_in_meters(lines, place)
    columns["length_px" if meters is None else "length_m"] = lines.lengths if meters is None else meters
    if place is not None:
        lines = lines.with_vertices(place.to_map(lines.vertices))
    return Features(lines, columns, place, about or {})


def lengths_in_meters(polylines: Polylines, place: Georeference) -> Float[np.ndarray, " n"] | None:
    """Gives the lengths of polylines on the ground; None where the map has no known units.

    They are measured on the ellipsoid WGS84, so that neither the scale of a projection nor degrees matter:
    each piece by the radii of curvature at its middle, which is exact to a millionth for pieces of up to 30
    km. In a local system, which has no place on the earth, they are those of the plane.

    Args:
        polylines: Polylines in pixels.
        place: Where the pixels lie.
    """
    if place.crs is None:
        return None
    try:
        degrees = place.to_map(polylines.vertices, LON_LAT)
    except ValueError:
        factor = _meters_per_unit(place.crs)
        flat = polylines.with_vertices(place.to_map(polylines.vertices))
        return None if factor is None else flat.lengths * factor
    pieces = np.radians(polylines.with_vertices(degrees).endpoints)
    delta = pieces[:, 1] - pieces[:, 0]
    east = (delta[:, 0] + np.pi) % (2 * np.pi) - np.pi  # a piece over the date line is short
    middle = pieces[:, :, 1].mean(axis=1)
    bulge = 1 - _ECCENTRICITY2 * np.sin(middle) ** 2
    across, along = _RADIUS / np.sqrt(bulge), _RADIUS * (1 - _ECCENTRICITY2) / bulge**1.5
    meters = np.hypot(across * np.cos(middle) * east, along * delta[:, 1])
    return np.bincount(polylines.owners, meters, minlength=len(polylines)).astype(np.float64)


def _meters_per_unit(crs: str) -> float | None:
    from rasterio.crs import CRS
    from rasterio.errors import CRSError

    try:
        known = CRS.from_user_input(crs)
        return None if known.is_geographic else float(known.units_factor[1])
    except CRSError:
        return None


__all__ = ["Features", "lengths_in_meters", "to_features"]
