"""The one file of a scene: its place on the map, checked before the work, and what is written after it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from yolino.datasets.georeference import Georeference
    from yolino.inference.views import Raster
    from yolino.io import Result


def find_place(out: Path, path: Path, raster: Raster) -> Georeference | None:
    """Gives where a scene lies, None if that is not known or not written; to be called before the work.

    Raises:
        ValueError: The file cannot express it.
    """
    from yolino.datasets.feature_files import FEATURE_WRITERS, check_place
    from yolino.datasets.georeference import read_georeference
    from yolino.inference.views import ImageRaster

    if out.suffix.lower() not in FEATURE_WRITERS or isinstance(raster, ImageRaster):
        return None
    place = read_georeference(path)
    if place is not None:
        check_place(out, path, place)
    return place


def write_scene(out: Path, result: Result, place: Georeference | None, licence: str) -> None:
    """Writes the file of the scene and tells what its coordinates mean, where that is not plain."""
    from yolino.datasets.feature_files import FEATURE_WRITERS
    from yolino.datasets.features import to_features
    from yolino.io import to_json, write_atomic

    suffix, path = out.suffix.lower(), result.image
    if suffix == ".json":
        write_atomic(out, to_json(result))
        return
    taken = ""
    if suffix == ".geojson":
        taken = " Programs take GeoJSON without a system for longitude and latitude: .gpkg is better here."
    if place is None:
        _say(f"{path} has no place on the map: coordinates and lengths are in pixels.{taken}")
    elif place.crs is None:
        _say(
            f"{path} names no coordinate reference system: coordinates are in its units, lengths in pixels."
            f"{taken}"
        )
    about = {"image": path, "model": result.model, "licence": licence}
    FEATURE_WRITERS[suffix](out, to_features(result.polylines, result.classes, place, about))


def _say(sentence: str) -> None:
    typer.echo(sentence, err=True)


__all__ = ["find_place", "write_scene"]
