"""A GeoJSON document: its members and geometries checked, regions with holes as one ring, its text."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from yolino.datasets.annotation import LabelError, check_points, parse_json

_KINDS = ("LineString", "MultiLineString", "Polygon", "MultiPolygon", "GeometryCollection")
_LARGEST = 1e300


@dataclass(frozen=True)
class Head:
    """What a document says beside its features.

    Attributes:
        image: Name of the image, with forward slashes; None where it is not stated.
        size: `(height, width)` of the image; None where it is not stated.
        coordinates: `pixel` or `map`; None where neither is said.
        crs: Coordinate reference system of map coordinates; None where none is named.
    """

    image: str | None = None
    size: tuple[int, int] | None = None
    coordinates: str | None = None
    crs: str | None = None


def load(path: Path) -> tuple[Head, list[Any]]:
    """Gives the head and the features of a document; the features are not checked.

    Raises:
        LabelError: It is no `FeatureCollection`, or a member that means something here is wrong.
    """
    document = parse_json(path.read_bytes(), str(path))
    if not isinstance(document, dict) or document.get("type") != "FeatureCollection":
        kind = document.get("type") if isinstance(document, dict) else type(document).__name__
        raise LabelError(str(path), f"holds a {kind!r:.80}, but a FeatureCollection is needed")
    features = document.get("features")
    if not isinstance(features, list):
        raise LabelError(str(path), "lacks the list of features")
    image, size, coordinates = _own_member(document.get("yolino", {}), str(path))
    crs = _crs(document["crs"], str(path)) if "crs" in document else None
    if "crs" in document and coordinates is None:
        coordinates = "pixel" if crs is None else "map"
    return Head(image, size, coordinates, crs), features


def to_text(head: Head, features: Sequence[dict[str, Any]]) -> str:
    """Gives the text of a document that `load` takes apart again, a feature per line."""
    document: dict[str, Any] = {"type": "FeatureCollection"}
    if head.crs is not None:
        document["crs"] = {"type": "name", "properties": {"name": head.crs}}
    elif head.coordinates == "map":
        document["crs"] = None
    own = {"image": head.image, "size": head.size, "coordinates": head.coordinates}
    document["yolino"] = {key: value for key, value in own.items() if value is not None}
    lines = ",\n".join(json.dumps(feature) for feature in features)
    return f'{json.dumps(document)[:-1]}, "features": [\n{lines}\n]}}\n'


def to_feature(kind: str, coordinates: list[Any], properties: dict[str, object]) -> dict[str, Any]:
    """Gives a feature of a geometry."""
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def _own_member(own: Any, where: str) -> tuple[str | None, tuple[int, int] | None, str | None]:
    """Gives image, size and coordinates from the member `yolino`."""
    form = '{"image": "a.jpg", "size": [height, width], "coordinates": "pixel" or "map"}'
    wrong = LabelError(where, f'has the member "yolino": {own!r:.80}, but {form} is needed')
    if not isinstance(own, dict):
        raise wrong
    image, size, coordinates = own.get("image"), own.get("size"), own.get("coordinates")
    if not (image is None or (isinstance(image, str) and image)) or coordinates not in (None, "pixel", "map"):
        raise wrong
    image = None if image is None else image.replace("\\", "/")
    if size is None:
        return image, None, coordinates
    if not (
        isinstance(size, list) and len(size) == 2 and all(type(side) is int and side > 0 for side in size)
    ):
        raise wrong
    return image, (size[0], size[1]), coordinates


def _crs(member: Any, where: str) -> str | None:
    """Gives the coordinate reference system that the member `crs` names, None for pixels."""
    if member is None:  # GeoJSON 2008: none can be assumed
        return None
    properties = member.get("properties") if isinstance(member, dict) else None
    if isinstance(properties, dict):
        name, code = properties.get("name"), properties.get("code")
        if isinstance(name, str) and name:
            return None if name.lower() == "pixel" else name
        if type(code) is int:
            return f"EPSG:{code}"
    form = '{"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::25832"}}'
    raise LabelError(where, f"has the crs {member!r:.80}, but {form} is needed")


def check_feature(feature: Any, where: str) -> tuple[dict[str, Any], float, Any]:
    """Gives properties, score (1 without) and geometry of a feature; the geometry is not checked.

    Raises:
        LabelError: It is no feature, or its score is no finite number.
    """
    if not isinstance(feature, dict) or "geometry" not in feature:
        raise LabelError(where, 'is no feature, but {"type": "Feature", "geometry": ...} is needed')
    properties = {} if feature.get("properties") is None else feature["properties"]
    if not isinstance(properties, dict):
        raise LabelError(where, f"has the properties {properties!r:.80}, but an object is needed")
    score = 1.0 if properties.get("score") is None else properties["score"]
    if type(score) not in (int, float) or not abs(score) <= _LARGEST:
        raise LabelError(where, f"has the score {score!r:.80}, but a finite number is needed")
    return properties, float(score), feature["geometry"]


def parts(geometry: Any, where: str) -> Iterator[tuple[str, Any]]:
    """Yields the lines and polygons of a geometry: `LineString` or `Polygon`, and the coordinates, unchecked.

    Other geometries, none, and those without coordinates yield nothing.

    Raises:
        LabelError: It is no geometry.
    """
    if geometry is None:
        return
    kind = geometry.get("type") if isinstance(geometry, dict) else None
    if not isinstance(kind, str):
        raise LabelError(where, f"has the geometry {geometry!r:.80}, but an object with a type is needed")
    if kind not in _KINDS:
        return
    key = "geometries" if kind == "GeometryCollection" else "coordinates"
    inner = geometry.get(key)
    if not isinstance(inner, list):
        raise LabelError(where, f"has a {kind} with the {key} {inner!r:.80}, but a list is needed")
    if kind == "GeometryCollection":
        for part in inner:
            yield from parts(part, where)
    else:
        several = inner if kind.startswith("Multi") else [inner]
        yield from ((kind.removeprefix("Multi"), part) for part in several if part != [])


def region(rings: Any, where: str) -> Float[np.ndarray, "v 2"]:
    """Gives the rings of a polygon, the outer one first, as one ring that no last vertex closes.

    Each hole is joined to the ring by a seam, there and back, between their nearest vertices: by the even-odd
    rule the region is the same.

    Raises:
        LabelError: It is no list of rings, or one has fewer than three vertices.
    """
    if not isinstance(rings, list):
        raise LabelError(where, f"has a polygon of the rings {rings!r:.80}, but a list is needed")
    outer, *holes = (_ring(ring, where) for ring in rings)
    for hole in holes:
        apart = np.hypot(*(outer[:, None] - hole[None]).transpose(2, 0, 1))
        i, j = np.unravel_index(apart.argmin(), apart.shape)
        outer = np.concatenate([outer[: i + 1], hole[j:], hole[: j + 1], outer[i:]])
    return outer


def _ring(points: Any, where: str) -> Float[np.ndarray, "v 2"]:
    ring = check_points(points, where, least=3)
    ring = ring[:-1] if (ring[0] == ring[-1]).all() else ring
    if len(ring) < 3:
        raise LabelError(where, "has a polygon of 2 vertices, but at least 3 are needed")
    return ring


__all__ = ["Head", "check_feature", "load", "parts", "region", "to_feature", "to_text"]
