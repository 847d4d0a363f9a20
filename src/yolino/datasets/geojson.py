"""GeoJSON, a file per image: polylines with classes, regions to ignore, in pixels or in map coordinates.

- `LineString` is a polyline, `MultiLineString` several; third coordinates are left out. The class is a
  property, `label` by default; without it the class is `line`. `score` is a property too.
- `Polygon` and `MultiPolygon` of a class that is ignored are regions where nothing is labelled. A hole is cut
  out by a seam without width: the ring runs to the hole, around it and back (even-odd rule).
- Other polygons, points, and what has no geometry are left out. A `GeometryCollection` is its parts.

Pixels are x right, y down, continuous. Map coordinates (RFC 7946: longitude and latitude; the older member
`crs` names another system) go through the georeference of the image, a GeoTIFF or one with a world file.
What is written has the foreign member `"yolino": {"image": "images/a.tif", "size": [height, width],
"coordinates": "pixel"}`, which is read too.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, count
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from jaxtyping import Float

from yolino.datasets.annotation import Annotation, LabelError, check_points
from yolino.datasets.files import FileDataset, Names
from yolino.datasets.geojson_document import Head, check_feature, load, parts, region, to_feature, to_text
from yolino.datasets.georeference import (
    LON_LAT,
    Georeference,
    crs_name,
    may_be_georeferenced,
    read_georeference,
)
from yolino.datasets.writing import ImageWriter, without_suffix
from yolino.types import Sample

Vertices = Float[np.ndarray, "_ 2"]
_FAR = 10  # image sizes: beyond, a coordinate reference system is wrong


class GeoJsonWriter(ImageWriter):
    """Writes `labels/<name of the image>.geojson`, in pixels or, for a GIS, in map coordinates.

    A folder `images/` at the start of a sample's name is left out in the name of its file. Where two samples
    would have the same file, the second gets its whole name, or a number.

    Args:
        out: The folder.
        classes: Names of the classes.
        directed: Not written: the order of the vertices is kept.
        coordinates: `pixel`, or `map`: coordinates of the image's georeference, in its coordinate reference
            system where that has a number of the EPSG, else longitude and latitude. The image must be a file.
        class_property: Name of the property that holds the class.
    """

    loses = ()

    def __init__(
        self,
        out: Path,
        *,
        classes: Sequence[str] = (),
        directed: bool = True,
        coordinates: str = "pixel",
        class_property: str = "label",
    ) -> None:
        super().__init__(out, classes=classes, directed=directed)
        _check_choice(coordinates, ("pixel", "map"))
        self._coordinates, self._class_property = coordinates, class_property
        self._names: set[str] = set()
        self._stems: set[str] = set()

    def add(self, sample: Sample) -> None:
        """Writes the file of one image."""
        self.check(sample)
        _check_numbers(sample)
        crs, size = None, sample.size
        if self._coordinates == "map":
            place = _georeference_of(sample)
            sample, crs = _on_map(sample, place)
            size = size or place.size
        head = Head(sample.name, size, self._coordinates, crs)
        self.write(sample, self._file_for(sample.name), to_text(head, list(self._features(sample))))

    def _features(self, sample: Sample) -> Iterator[dict[str, Any]]:
        lines = sample.polylines
        for vertices, score, label in zip(lines, lines.scores.tolist(), lines.labels.tolist(), strict=True):
            scored = {} if score == 1 else {"score": score}
            properties = {self._class_property: self.name_of(label), **scored}
            yield to_feature("LineString", vertices.tolist(), properties)
        for polygon in sample.ignore:
            ring = np.concatenate([polygon, polygon[:1]]).tolist()
            yield to_feature("Polygon", [ring], {self._class_property: "ignore"})

    def _file_for(self, name: str) -> str:
        """Gives the file of a sample below the folder."""
        if name in self._names:
            raise ValueError(f"There are two samples of the name {name}: their labels would be in one file.")
        self._names.add(name)
        path = [part for part in PurePosixPath(name).parts if part not in ("/", "..")] or ["image"]
        whole = "/".join(path[1:] if path[0] == "images" and len(path) > 1 else path)
        further = (f"{whole}-{number}" for number in count(2))
        for stem in chain((without_suffix(whole), whole, "/".join(path)), further):
            # Some file systems take A.geojson and a.geojson for the same.
            if stem.casefold() not in self._stems:
                break
        self._stems.add(stem.casefold())
        return f"labels/{stem}.geojson"


@dataclass(frozen=True, eq=False)
class _Features(Annotation):
    """An annotation in the coordinates of its file, with what the file says about them."""

    head: Head = field(default_factory=Head)


class GeoJson(FileDataset):
    """Images with a GeoJSON file each: `labels/<name of the image>.geojson`, or beside the image.

    Args:
        root: Folder of the dataset.
        labels: Label files, absolute or below `root`; None: all `*.geojson` in and below `labels`, or else in
            and below `root`.
        class_property: Name of the property that holds the class; other values than text are taken as text.
        coordinates: `pixel`, `map`, or `auto`: what the file says in `yolino` or by a `crs`, which means map
            coordinates unless it is null or named `pixel`; where it says neither, map coordinates if the
            image has a georeference, else pixels.
        crs: Coordinate reference system of map coordinates where a file names none. A raster that names none
            itself (a world file) is taken to be in the system of the file.
        skip_broken: As in `FileDataset`.
        options: The other arguments of `FileDataset`.

    Raises:
        ModuleNotFoundError: The image of a file is to be asked for its georeference, which needs rasterio.
    """

    patterns = ("labels/**/*.geojson", "**/*.geojson")
    writer = GeoJsonWriter

    def __init__(
        self,
        root: str | Path,
        labels: Names | None = None,
        *,
        class_property: str = "label",
        coordinates: str = "auto",
        crs: str = LON_LAT,
        skip_broken: bool = False,
        **options: Any,
    ) -> None:
        _check_choice(coordinates, ("auto", "pixel", "map"))
        self._class_property, self._coordinates, self._crs = class_property, coordinates, crs
        super().__init__(root, labels, skip_broken=skip_broken, **options)
        # Only now it is known which images are taken, and that they exist.
        kept = []
        for one, path in zip(self.annotations, self._paths, strict=True):
            try:
                kept.append((self._in_pixels(one, path), path))
            except LabelError as error:
                if not skip_broken:
                    raise
                self.broken.append(error)
        self.annotations, self._paths = [one for one, _ in kept], [path for _, path in kept]

    def read(self, path: Path) -> Iterator[Annotation | LabelError]:
        """Yields the annotation of a file, in its own coordinates."""
        head, features = load(path)
        lines: list[Vertices] = []
        names: list[str] = []
        scores: list[float] = []
        ignore: list[Vertices] = []
        for index, feature in enumerate(features):
            where = f"{path}, feature {index}"
            properties, score, geometry = check_feature(feature, where)
            name = properties.get(self._class_property)
            name = self.default_class if name is None else str(name)
            for kind, coordinates in parts(geometry, where):
                if kind == "LineString":
                    lines.append(check_points(coordinates, where))
                    names.append(name)
                    scores.append(score)
                elif name in self.ignore:
                    ignore.append(region(coordinates, where))
        image = head.image or self._image_name(path)
        yield _Features(image, str(path), lines, names, scores, ignore, head.size, head=head)

    def _image_name(self, path: Path) -> str:
        """Gives the name of the image, without suffix, of a label file that does not state it."""
        if not path.is_relative_to(self.root):
            return path.stem
        inside = path.relative_to(self.root).with_suffix("")
        return (inside.relative_to("labels") if inside.is_relative_to("labels") else inside).as_posix()

    def _in_pixels(self, one: Annotation, image: Path) -> Annotation:
        assert isinstance(one, _Features)
        said = one.head.coordinates if self._coordinates == "auto" else self._coordinates
        if said == "pixel" or (said is None and not may_be_georeferenced(image)):
            return one
        if not image.is_file():
            raise LabelError(
                one.where, f"has map coordinates, but its image {image} does not exist to place it"
            )
        try:
            place = read_georeference(image)
            if place is not None:
                return _to_pixels(one, place, self._crs)
        except LabelError:
            raise
        except ValueError as error:
            raise LabelError(one.where, f"cannot be brought into pixels: {str(error).rstrip('.')}") from None
        if said is None:
            return one
        raise LabelError(
            one.where,
            f"has map coordinates, but {image} has no georeference: give a GeoTIFF or a world file beside "
            "it, or say coordinates=pixel if they are pixels",
        )


def _check_choice(given: str, allowed: Sequence[str]) -> None:
    if given not in allowed:
        raise ValueError(f"coordinates is {given!r}, but must be {' or '.join(allowed)}.")


def _to_pixels(one: _Features, place: Georeference, default: str) -> Annotation:
    """Gives an annotation in map coordinates in pixels of its image."""
    shapes = [*one.lines, *one.ignore]
    points = np.concatenate([np.zeros((0, 2)), *shapes])
    crs = one.head.crs or default
    if len(points):
        if crs == LON_LAT and place.crs is not None:
            _check_degrees(points, one)
        points = place.to_pixels(points, crs)
        _check_near(points, place.size, one.where)
    moved = np.split(points, np.cumsum([len(shape) for shape in shapes])[:-1]) if shapes else []
    count = len(one.lines)
    return replace(one, lines=moved[:count], ignore=moved[count:], size=place.size)


def _check_degrees(points: Vertices, one: _Features) -> None:
    beyond = (np.abs(points) > (360, 90)).any(axis=1)
    if beyond.any():
        x, y = points[beyond.argmax()].tolist()
        raise LabelError(
            one.where,
            f"has the point ({x:g}, {y:g}), which is no longitude and latitude: name their coordinate "
            "reference system (crs=EPSG:25832), or say coordinates=pixel if they are pixels",
        )


def _check_near(points: Vertices, size: tuple[int, int], where: str) -> None:
    low, high, reach = points.min(axis=0), points.max(axis=0), _FAR * max(size)
    if (high < -reach).any() or (low > np.array([size[1], size[0]]) + reach).any():
        raise LabelError(
            where,
            f"lies far from its image, at x from {low[0]:.0f} to {high[0]:.0f} and y from {low[1]:.0f} to "
            f"{high[1]:.0f} pixels: the coordinate reference system of the file or of the image is wrong",
        )


def _check_numbers(sample: Sample) -> None:
    if not all(np.isfinite(values).all() for values in (sample.polylines.scores, *sample.ignore)):
        raise ValueError(f"{sample.name} has a score or a region to ignore that is not finite: remove it.")
    if any(len(polygon) < 3 for polygon in sample.ignore):
        raise ValueError(f"{sample.name} has a region to ignore of fewer than 3 vertices: remove it.")


def _georeference_of(sample: Sample) -> Georeference:
    place = read_georeference(sample.image) if isinstance(sample.image, Path) else None
    if place is None:
        raise ValueError(
            f"{sample.name} has no georeference: write it in pixels (coordinates=pixel), or as a GeoTIFF."
        )
    return place


def _on_map(sample: Sample, place: Georeference) -> tuple[Sample, str | None]:
    """Gives a sample in map coordinates, and the name of their system."""
    name = None if place.crs is None else crs_name(place.crs) or LON_LAT
    lines = sample.polylines
    vertices = place.to_map(lines.vertices, name)
    ignore = tuple(place.to_map(np.asarray(polygon), name) for polygon in sample.ignore)
    return replace(sample, polylines=lines.with_vertices(vertices), ignore=ignore), name


__all__ = ["GeoJson", "GeoJsonWriter"]
