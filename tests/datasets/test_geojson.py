from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.datasets.annotation import LabelError
from yolino.datasets.geojson import GeoJson, GeoJsonWriter
from yolino.types import Polylines, Sample

LINE = [[1, 2], [3.5, 4], [3, 4]]
SQUARE = [[0, 0], [10, 0], [10, 10], [0, 10], [0, 0]]
UTM32 = "urn:ogc:def:crs:EPSG::32632"


def feature(
    type: str = "LineString", coordinates: object = LINE, /, **properties: object
) -> dict[str, object]:
    geometry = {"type": type, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def line(*coordinates: list[float], **properties: object) -> dict[str, object]:
    return feature("LineString", list(coordinates), **properties)


def write_labels(path: Path, *features: object, **members: object) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features, **members}))
    return path


def write_image(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"an image")
    return path


def read_one(root: Path, *features: object, **members: object) -> Sample:
    write_image(root / "images/a.jpg")
    write_labels(root / "labels/a.geojson", *features, **members)
    (sample,) = GeoJson(root)
    return sample


def as_lists(polylines: Polylines) -> list[list[list[float]]]:
    return [p.tolist() for p in polylines]


def named(dataset: GeoJson, sample: Sample) -> list[str]:
    return [dataset.classes[label] for label in sample.polylines.labels]


def test_lines_are_polylines_and_ignored_polygons_are_regions(tmp_path):
    write_image(tmp_path / "images/a.jpg")
    write_labels(
        tmp_path / "labels/a.geojson",
        feature(label="way", score=0.25, color="red"),
        feature("Polygon", [SQUARE], label="ignore"),
        feature("Polygon", [SQUARE], label="building"),
        feature("Point", [1, 2], label="way"),
        feature("MultiLineString", [LINE, [[7, 8, 120.5], [9, 10, 121]]], label="link"),
        feature("MultiPolygon", [[SQUARE], [[[0, 0], [1, 0], [0, 1]]]], label="ignore"),
        {"type": "Feature", "properties": None, "geometry": None},
    )
    dataset = GeoJson(tmp_path)
    (sample,) = dataset
    assert dataset.classes == ("link", "way")
    assert (sample.name, sample.image, sample.size) == ("images/a.jpg", tmp_path / "images/a.jpg", None)
    assert as_lists(sample.polylines) == [LINE, LINE, [[7, 8], [9, 10]]]
    assert named(dataset, sample) == ["way", "link", "link"]
    assert sample.polylines.scores.tolist() == [0.25, 1, 1]
    assert [region.tolist() for region in sample.ignore] == [
        SQUARE[:-1],
        SQUARE[:-1],
        [[0, 0], [1, 0], [0, 1]],
    ]


def test_names_of_classes_come_from_any_property_of_any_type(tmp_path):
    write_image(tmp_path / "a.png")
    properties = ({"kind": 3}, {"kind": 2.5}, {"kind": True}, {"kind": None}, {"label": "way"}, {"kind": "ß"})
    write_labels(tmp_path / "a.geojson", *(feature(**one) for one in properties))
    dataset = GeoJson(tmp_path, class_property="kind")
    assert named(dataset, dataset[0]) == ["3", "2.5", "True", "line", "line", "ß"]
    assert GeoJson(tmp_path).classes == ("line", "way")
    assert as_lists(GeoJson(tmp_path, classes=["way"])[0].polylines) == [LINE]
    assert GeoJson(tmp_path, classes={"way": "lane", "line": "lane"}).classes == ("lane",)


def test_collections_are_their_parts_and_empty_geometries_are_none(tmp_path):
    inner = {"type": "GeometryCollection", "geometries": [feature("MultiLineString", [LINE, []])["geometry"]]}
    parts = [feature()["geometry"], feature("Point", [0, 0])["geometry"], inner, None]
    collection = {"type": "Feature", "geometry": {"type": "GeometryCollection", "geometries": parts}}
    sample = read_one(tmp_path, collection, line(), feature("Polygon", [], label="ignore"))
    assert as_lists(sample.polylines) == [LINE, LINE]
    assert sample.ignore == ()


def test_a_line_of_one_vertex_is_kept(tmp_path):
    assert as_lists(read_one(tmp_path, feature("LineString", [[1, 2]])).polylines) == [[[1, 2]]]


def inside(ring: np.ndarray, x: float, y: float) -> bool:
    """The even-odd rule, literally: how many edges does the ray to the right cross?"""
    crossed = 0
    for (x0, y0), (x1, y1) in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        if (y0 > y) != (y1 > y) and x < x0 + (y - y0) * (x1 - x0) / (y1 - y0):
            crossed += 1
    return crossed % 2 == 1


@pytest.mark.parametrize("turn", [1, -1])
def test_holes_of_a_region_are_cut_out(tmp_path, turn):
    holes = [[[2, 2], [4, 2], [4, 4], [2, 2]], [[6, 5], [9, 5], [9, 9], [5, 9]]]
    (region,) = read_one(
        tmp_path, feature("Polygon", [SQUARE, *(h[::turn] for h in holes)], label="ignore")
    ).ignore
    rng = np.random.default_rng(0)
    rings = [np.array(ring, float) for ring in (SQUARE, *holes)]
    seen = set()
    for x, y in rng.uniform(-1, 11, (500, 2)):
        outer, *inner = (inside(ring, x, y) for ring in rings)
        seen.add((outer, *inner))
        assert inside(region, x, y) == (outer and not any(inner))
    assert len(seen) == 4


def test_labels_lie_in_their_folder_or_beside_the_image(tmp_path):
    for place in ("labels/x/a.geojson", "labels/a.geojson"):
        write_labels(tmp_path / place)
    for place in ("images/x/a.webp", "images/a.jpg"):
        write_image(tmp_path / place)
    assert [one.name for one in GeoJson(tmp_path)] == ["images/a.jpg", "images/x/a.webp"]
    beside = tmp_path / "beside"
    for place in ("x/v1.0 a", "a"):
        write_labels(beside / f"{place}.geojson")
        write_image(beside / f"{place}.png")
    assert [one.name for one in GeoJson(beside)] == ["a.png", "x/v1.0 a.png"]
    elsewhere = write_labels(tmp_path.parent / "elsewhere" / "b.geojson")
    write_image(tmp_path / "b.jpg")
    assert [one.name for one in GeoJson(tmp_path, elsewhere)] == ["b.jpg"]
    write_labels(tmp_path / "b.jpg.geojson")
    assert [one.name for one in GeoJson(tmp_path, "b.jpg.geojson")] == ["b.jpg"]


def test_a_list_chooses_images(tmp_path):
    for name in ("a", "b", "c"):
        write_labels(tmp_path / f"labels/{name}.geojson", feature())
        write_image(tmp_path / f"images/{name}.jpg")
    (tmp_path / "val.txt").write_text("images/c.jpg\nimages/a.jpg\n")
    assert [one.name for one in GeoJson(tmp_path, names="val.txt")] == ["images/c.jpg", "images/a.jpg"]


def test_image_and_size_are_read_from_the_file(tmp_path):
    write_image(tmp_path / "photos/b.jpg")
    write_labels(tmp_path / "labels/a.geojson", yolino={"image": "photos\\b.jpg", "size": [4, 8], "new": 1})
    (sample,) = GeoJson(tmp_path)
    assert (sample.name, sample.size) == ("photos/b.jpg", (4, 8))


def test_a_missing_image_is_named_unless_images_are_not_required(tmp_path):
    write_labels(tmp_path / "labels/a.geojson", feature())
    write_labels(tmp_path / "labels/b.geojson", feature(), crs={"properties": {"name": "EPSG:32632"}})
    with pytest.raises(FileNotFoundError, match=r"a\.geojson names the image .*a, which does not exist"):
        GeoJson(tmp_path)
    with pytest.raises(FileNotFoundError, match=r"b\.geojson names the image"):
        GeoJson(tmp_path, "labels/b.geojson")
    assert len(GeoJson(tmp_path, "labels/a.geojson", require_images=False)) == 1
    with pytest.raises(LabelError, match=r"b\.geojson has map coordinates, but its image .* does not exist"):
        GeoJson(tmp_path, require_images=False)
    dataset = GeoJson(tmp_path, require_images=False, skip_broken=True)
    assert (len(dataset), len(dataset.broken)) == (1, 1)


BAD_FILES = {
    "is not valid JSON": "",
    "is not valid JSON (Expecting": "{'type': 1}",
    "is not valid JSON (RecursionError)": "[" * 200_000,
    "holds a 'list', but a FeatureCollection": "[]",
    "holds a 'LineString', but a FeatureCollection": json.dumps(feature()["geometry"]),
    "holds a None, but a FeatureCollection": "{}",
    "lacks the list of features": '{"type": "FeatureCollection", "features": {}}',
}


@pytest.mark.parametrize("reason", BAD_FILES)
def test_a_bad_file_is_named(tmp_path, reason):
    write_image(tmp_path / "a.jpg")
    (tmp_path / "a.geojson").write_text(BAD_FILES[reason])
    with pytest.raises(LabelError) as caught:
        GeoJson(tmp_path)
    assert str(caught.value).startswith(f"{tmp_path / 'a.geojson'} {reason}")


def test_bytes_that_are_no_text_are_named_and_a_byte_order_mark_is_none(tmp_path):
    path = write_labels(tmp_path / "a.geojson", feature())
    write_image(tmp_path / "a.jpg")
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert len(GeoJson(tmp_path)[0].polylines) == 1
    path.write_bytes(b"{\xff\xfe\x00}")
    with pytest.raises(LabelError, match=r"a\.geojson is not valid JSON"):
        GeoJson(tmp_path)


BAD_FEATURES = {
    "is no feature": 7,
    'is no feature, but {"type"': {"type": "Feature"},
    "has the properties [1], but an object": {**feature(), "properties": [1]},
    "has the score 'high', but a finite number": feature(score="high"),
    "has the score True": feature(score=True),
    "has the score nan": feature(score=float("nan")),
    "has the score 1000": feature(score=10**400),
    "has the geometry 'x', but an object": {**feature(), "geometry": "x"},
    "has the geometry {}, but an object with a type": {**feature(), "geometry": {}},
    "has a LineString with the coordinates None": {**feature(), "geometry": {"type": "LineString"}},
    "has a MultiLineString with the coordinates 'x'": feature("MultiLineString", "x"),
    "has a GeometryCollection with the geometries": feature("GeometryCollection", []),
    "has the point 1, but [x, y]": feature("LineString", [1, 2]),
    "has the point [1], but [x, y]": feature("LineString", [[1], [2]]),
    "has the coordinate nan, but finite": feature("LineString", [[1, 2], [float("nan"), 2]]),
    "has the coordinate '1', but finite": feature("LineString", [[1, 2], ["1", 2]]),
    "has int, but at least 1 points": feature("MultiLineString", [7]),
    "has a polygon of the rings 7": feature("MultiPolygon", [7], label="ignore"),
    "has 2 points, but at least 3": feature("Polygon", [[[0, 0], [1, 1]]], label="ignore"),
    "has a polygon of 2 vertices": feature("Polygon", [[[0, 0], [1, 1], [0, 0]]], label="ignore"),
    "has int, but at least 3 points": feature("Polygon", [SQUARE, 7], label="ignore"),
}


@pytest.mark.parametrize("reason", BAD_FEATURES)
def test_a_bad_feature_is_named_and_its_file_can_be_skipped(tmp_path, reason):
    for name in ("a", "b"):
        write_image(tmp_path / f"{name}.jpg")
    write_labels(tmp_path / "b.geojson", feature())
    path = write_labels(tmp_path / "a.geojson", feature(), BAD_FEATURES[reason])
    with pytest.raises(LabelError) as caught:
        GeoJson(tmp_path)
    assert str(caught.value).startswith(f"{path}, feature 1 {reason}")
    dataset = GeoJson(tmp_path, skip_broken=True)
    assert [one.name for one in dataset] == ["b.jpg"]
    assert [one.where for one in dataset.broken] == [f"{path}, feature 1"]


BAD_MEMBERS = {
    'has the member "yolino": 7': {"yolino": 7},
    "has the member \"yolino\": {'image': 7}": {"yolino": {"image": 7}},
    "has the member \"yolino\": {'image': ''}": {"yolino": {"image": ""}},
    "has the member \"yolino\": {'size': [4]}": {"yolino": {"size": [4]}},
    "has the member \"yolino\": {'size': [0, 8]}": {"yolino": {"size": [0, 8]}},
    "has the member \"yolino\": {'size': [4.0, 8]}": {"yolino": {"size": [4.0, 8]}},
    "has the member \"yolino\": {'coordinates': 'meters'}": {"yolino": {"coordinates": "meters"}},
    "has the crs 'EPSG:32632', but {": {"crs": "EPSG:32632"},
    "has the crs {'type': 'link'": {"crs": {"type": "link", "properties": {"href": "http://a"}}},
    "has the crs {'type': 'name'}": {"crs": {"type": "name"}},
}


@pytest.mark.parametrize("reason", BAD_MEMBERS)
def test_a_bad_member_is_named(tmp_path, reason):
    write_image(tmp_path / "a.jpg")
    path = write_labels(tmp_path / "a.geojson", **BAD_MEMBERS[reason])
    with pytest.raises(LabelError) as caught:
        GeoJson(tmp_path)
    assert str(caught.value).startswith(f"{path} {reason}")


def test_a_wrong_choice_of_coordinates_is_named(tmp_path):
    with pytest.raises(ValueError, match="coordinates is 'meters', but must be auto or pixel or map"):
        GeoJson(tmp_path, coordinates="meters")
    with pytest.raises(ValueError, match="coordinates is 'auto', but must be pixel or map"):
        GeoJsonWriter(tmp_path, coordinates="auto")


@pytest.mark.parametrize("crs", [None, {"type": "name", "properties": {"name": "pixel"}}])
def test_a_file_can_say_by_its_crs_that_it_is_in_pixels(tmp_path, crs):
    write_image(tmp_path / "a.tif")  # which would be asked for its georeference else
    write_labels(tmp_path / "a.geojson", feature(), crs=crs)
    assert as_lists(GeoJson(tmp_path)[0].polylines) == [LINE]


# The raster has 8 x 4 pixels of 2 m; its upper left corner is 10 m west and north of 9 degrees east on the
# equator, which is (500000, 0) in UTM 32. So map (499990 + 2 x, 10 - 2 y) is pixel (x, y).
ON_MAP = [[499_992, 6], [500_000, 0.0]]
IN_PIXELS = [[1, 2], [5, 5]]


def write_tiff(path: Path, crs: str | None = "EPSG:32632") -> Path:
    rasterio = pytest.importorskip("rasterio", reason="rasterio writes the GeoTIFF of this test")
    path.parent.mkdir(parents=True, exist_ok=True)
    form = {"driver": "GTiff", "width": 8, "height": 4, "count": 1, "dtype": "uint8"}
    with rasterio.open(
        path, "w", crs=crs, transform=rasterio.Affine(2, 0, 499_990, 0, -2, 10), **form
    ) as raster:
        raster.write(np.zeros((1, 4, 8), np.uint8))
    return path


def crs_member(name: str) -> dict[str, object]:
    return {"crs": {"type": "name", "properties": {"name": name}}}


def test_map_coordinates_in_the_system_of_the_image(tmp_path):
    write_tiff(tmp_path / "images/a.tif")
    ring = [[499_990, 10], [500_006, 10], [499_990, 2], [499_990, 10]]
    write_labels(
        tmp_path / "labels/a.geojson",
        line(*ON_MAP, label="way"),
        feature("Polygon", [ring], label="ignore"),
        line(*ON_MAP[::-1], label="way"),
        **crs_member(UTM32),
    )
    (sample,) = GeoJson(tmp_path)
    assert as_lists(sample.polylines) == [IN_PIXELS, IN_PIXELS[::-1]]
    assert [region.tolist() for region in sample.ignore] == [[[0, 0], [8, 0], [0, 4]]]
    assert (sample.name, sample.size) == ("images/a.tif", (4, 8))


@pytest.mark.parametrize(
    "members",
    [
        {},
        crs_member("urn:ogc:def:crs:OGC:1.3:CRS84"),
        {"crs": {"type": "EPSG", "properties": {"code": 4326}}},
    ],
)
def test_without_another_system_they_are_longitude_and_latitude(tmp_path, members):
    write_tiff(tmp_path / "a.tif")
    write_labels(tmp_path / "a.geojson", feature("LineString", [[9, 0], [9, 0, 17.5]]), **members)
    (sample,) = GeoJson(tmp_path)
    assert sample.polylines.vertices == pytest.approx(np.array([[5, 5], [5, 5]]), abs=1e-6)


def test_arguments_say_how_coordinates_are_meant(tmp_path):
    write_tiff(tmp_path / "a.tif")
    path = write_labels(tmp_path / "a.geojson", line(*ON_MAP))
    assert as_lists(GeoJson(tmp_path, crs="EPSG:32632")[0].polylines) == [IN_PIXELS]
    assert as_lists(GeoJson(tmp_path, coordinates="pixel")[0].polylines) == [ON_MAP]
    write_labels(path, line(*ON_MAP), yolino={"coordinates": "pixel"})
    assert as_lists(GeoJson(tmp_path)[0].polylines) == [ON_MAP]
    assert as_lists(GeoJson(tmp_path, coordinates="map", crs=UTM32)[0].polylines) == [IN_PIXELS]


@pytest.mark.parametrize("members", [{}, crs_member("EPSG:25832")])
def test_an_image_without_a_system_is_in_that_of_the_file(tmp_path, members):
    write_tiff(tmp_path / "a.tif", None)
    write_labels(tmp_path / "a.geojson", line(*ON_MAP), **members)
    assert as_lists(GeoJson(tmp_path)[0].polylines) == [IN_PIXELS]


def test_a_world_file_places_any_image(tmp_path):
    pytest.importorskip("rasterio", reason="rasterio reads the world file")
    (tmp_path / "a.png").write_bytes(cv2.imencode(".png", np.zeros((4, 8, 3), np.uint8))[1].tobytes())
    write_labels(tmp_path / "a.geojson", line(*ON_MAP))
    assert as_lists(GeoJson(tmp_path)[0].polylines) == [ON_MAP]
    with pytest.raises(
        LabelError, match=r"has map coordinates, but .*a\.png has no georeference: give a Geo"
    ):
        GeoJson(tmp_path, coordinates="map")
    (tmp_path / "a.pgw").write_text("2\n0\n0\n-2\n499991\n9\n")
    assert as_lists(GeoJson(tmp_path)[0].polylines) == [IN_PIXELS]


def test_a_tiff_without_georeference_is_in_pixels(tmp_path):
    pytest.importorskip("rasterio", reason="rasterio looks for the georeference")
    (tmp_path / "a.tif").write_bytes(cv2.imencode(".tif", np.zeros((4, 8, 3), np.uint8))[1].tobytes())
    write_labels(tmp_path / "a.geojson", feature())
    assert as_lists(GeoJson(tmp_path)[0].polylines) == [LINE]


def test_map_coordinates_that_cannot_be_meant_are_named(tmp_path):
    write_tiff(tmp_path / "a.tif")
    for coordinates, members, options, reason in (
        ([[1, 2], [100, 91]], {}, {}, r"has the point \(100, 91\), which is no longitude and latitude"),
        ([[5e6, 6e6]], {}, {}, r"has the point \(5e\+06, 6e\+06\), which is no longitude and latitude"),
        ([[98, 0]], {}, {}, r"cannot be brought into pixels: Points with x from 98 to 98"),
        ([[9, 0]], crs_member("EPSG:99999999"), {}, r"'EPSG:99999999' is not known: write one like"),
        ([[10, 0], [20, 2]], {}, {"crs": UTM32}, r"lies far from its image, at x from -249990 to -249985"),
        ([[499_990, 190]], crs_member(UTM32), {}, r"lies far from its image, .* y from -90 to -90 pixels"),
    ):
        path = write_labels(tmp_path / "a.geojson", line(*coordinates), **members)
        with pytest.raises(LabelError, match=reason) as caught:
            GeoJson(tmp_path, **options)
        assert str(caught.value).startswith(f"{path} ")
    write_labels(tmp_path / "a.geojson", feature("LineString", [[499_990, 160]]), **crs_member(UTM32))
    assert as_lists(GeoJson(tmp_path)[0].polylines) == [[[0, -75]]]


def test_an_image_that_is_not_listed_is_not_asked(tmp_path):
    write_tiff(tmp_path / "a.tif")
    write_image(tmp_path / "b.tif")
    for name in ("a", "b", "c"):
        write_labels(tmp_path / f"{name}.geojson", line(*ON_MAP), **crs_member(UTM32))
    (tmp_path / "train.txt").write_text("a.tif")
    assert as_lists(GeoJson(tmp_path, names="train.txt")[0].polylines) == [IN_PIXELS]
    (tmp_path / "train.txt").write_text("a.tif\nb.tif")
    with pytest.raises(
        LabelError, match=r"b\.geojson cannot be brought into pixels: .*b\.tif cannot be read"
    ):
        GeoJson(tmp_path, names="train.txt")
    dataset = GeoJson(tmp_path, names="train.txt", skip_broken=True)
    assert ([one.name for one in dataset], len(dataset.broken)) == (["a.tif"], 1)


def sample_of(name: str, *lines: object, **fields: object) -> Sample:
    polylines = Polylines.from_list(list(lines), fields.pop("scores", None), fields.pop("labels", None))
    return Sample(name, fields.pop("image", Path(name)), polylines, **fields)


def test_what_is_written_is_geojson_in_pixels(tmp_path):
    region = np.array([[0.0, 0.0], [9.0, 0.0], [0.0, 9.0]])
    with GeoJsonWriter(tmp_path, classes=("way", "link")) as writer:
        writer.add(
            sample_of(
                "images/a.jpg",
                LINE,
                [[7, 8.125]],
                scores=[1, 0.5],
                labels=[1, 0],
                ignore=(region,),
                size=(4, 8),
            )
        )
    assert json.loads((tmp_path / "labels/a.geojson").read_text()) == {
        "type": "FeatureCollection",
        "yolino": {"image": "images/a.jpg", "size": [4, 8], "coordinates": "pixel"},
        "features": [
            feature(label="link"),
            line([7, 8.125], label="way", score=0.5),
            feature("Polygon", [[[0, 0], [9, 0], [0, 9], [0, 0]]], label="ignore"),
        ],
    }


def test_no_two_images_have_the_same_file(tmp_path):
    names = [
        "images/a.jpg",
        "a.png",
        "a.jpg",
        "x/a.jpg",
        "A.jpg",
        "images/A.jpg",
        "v1.0",
        "v1.1",
        "/a/../b.jpg",
    ]
    with GeoJsonWriter(tmp_path) as writer:
        for i, name in enumerate(names):
            writer.add(sample_of(name, [[i, i]]))
        with pytest.raises(ValueError, match=r"two samples of the name a\.jpg:"):
            writer.add(sample_of("a.jpg"))
    found = {one.name: one.polylines.vertices[0, 0] for one in GeoJson(tmp_path, require_images=False)}
    assert found == {name.lstrip("/").replace("../", ""): i for i, name in enumerate(names)}
    files = sorted(str(file.relative_to(tmp_path)) for file in tmp_path.rglob("*") if file.is_file())
    assert len({file.casefold() for file in files}) == len(names)
    assert {"labels/a.geojson", "labels/x/a.geojson", "labels/v1.1.geojson"} < set(files)


def test_the_class_may_be_any_property(tmp_path):
    with GeoJsonWriter(tmp_path, classes=("way",), class_property="kind") as writer:
        writer.add(sample_of("a.jpg", LINE))
    assert GeoJson(tmp_path, class_property="kind", require_images=False).classes == ("way",)


def test_what_cannot_be_written_is_named(tmp_path):
    writer = GeoJsonWriter(tmp_path)
    nan, two = np.array([[0, np.nan], [1, 1], [2, 0]]), np.zeros((2, 2))
    for sample, reason in (
        (sample_of("a.jpg", [[1, np.inf]]), "a vertex that is not finite"),
        (sample_of("a.jpg", np.zeros((0, 2))), "a polyline without vertices"),
        (sample_of("a.jpg", LINE, scores=[np.nan]), "a score or a region to ignore that is not finite"),
        (sample_of("a.jpg", ignore=(nan,)), "a score or a region to ignore that is not finite"),
    ):
        with pytest.raises(ValueError, match=rf"a\.jpg has {reason}"):
            writer.add(sample)
    with pytest.raises(ValueError, match=r"a\.jpg has a region to ignore of fewer than 3 vertices"):
        writer.add(sample_of("a.jpg", ignore=(two,)))
    assert not (tmp_path / "labels").exists()


coordinates = st.floats(-1e5, 1e5)
vertices = st.lists(st.tuples(coordinates, coordinates), min_size=1, max_size=4).map(np.array)
regions = st.lists(st.tuples(coordinates, coordinates), min_size=3, max_size=5).map(np.array)


@st.composite
def fields(draw: st.DrawFn, classes: int) -> dict[str, object]:
    lines = draw(st.lists(vertices, max_size=3))
    n = len(lines)
    scores = draw(st.lists(st.floats(-1e9, 1e9) | st.just(1.0), min_size=n, max_size=n))
    labels = draw(st.lists(st.integers(0, max(classes, 1) - 1), min_size=n, max_size=n))
    size = draw(st.none() | st.tuples(st.integers(1, 9999), st.integers(1, 9999)))
    ignore = tuple(draw(st.lists(regions, max_size=2)))
    return {"lines": lines, "scores": scores, "labels": labels, "ignore": ignore, "size": size}


@settings(deadline=None, max_examples=30)
@given(st.data(), st.lists(st.text(max_size=8), unique=True, max_size=3))
def test_writing_and_reading_is_the_identity(data, classes):
    drawn = [(name, data.draw(fields(len(classes)))) for name in ("images/a.jpg", "images/x/a b.tif", "c")]
    written = [sample_of(name, *one.pop("lines"), **one) for name, one in drawn]
    with tempfile.TemporaryDirectory() as folder:
        with GeoJsonWriter(Path(folder), classes=classes) as writer:
            for sample in written:
                writer.add(sample)
        dataset = GeoJson(folder, require_images=False)
        assert len(dataset) == 3
        by_name = {sample.name: sample for sample in dataset}
    for sample in written:
        found = by_name[sample.name]
        assert as_lists(found.polylines) == as_lists(sample.polylines)
        assert found.polylines.scores.tolist() == sample.polylines.scores.tolist()
        assert named(dataset, found) == [writer.name_of(label) for label in sample.polylines.labels.tolist()]
        assert [region.tolist() for region in found.ignore] == [region.tolist() for region in sample.ignore]
        assert found.size == sample.size


@pytest.mark.parametrize(
    ("crs", "name", "tolerance"),
    [
        ("EPSG:32632", UTM32, 1e-9),
        (None, None, 1e-9),
        ("+proj=tmerc +lat_0=0 +lon_0=9.1 +x_0=500000 +datum=WGS84", "urn:ogc:def:crs:OGC:1.3:CRS84", 1e-3),
    ],
)
def test_map_coordinates_are_written_and_read_back(tmp_path, crs, name, tolerance):
    image = write_tiff(tmp_path / "images/a.tif", crs)
    region = np.array([[0.0, 0.0], [8.0, 0.0], [0.0, 4.0]])
    with GeoJsonWriter(tmp_path, coordinates="map") as writer:
        writer.add(sample_of("images/a.tif", IN_PIXELS, image=image, ignore=(region,)))
    document = json.loads((tmp_path / "labels/a.geojson").read_text())
    assert document["crs"] == (name and crs_member(name)["crs"])
    assert document["yolino"] == {"image": "images/a.tif", "size": [4, 8], "coordinates": "map"}
    written = document["features"][0]["geometry"]["coordinates"]
    if name == "urn:ogc:def:crs:OGC:1.3:CRS84":
        assert np.array(written) == pytest.approx(np.array([[9.1, 0], [9.1, 0]]), abs=1e-3)
    else:
        assert written == ON_MAP
    (sample,) = GeoJson(tmp_path)
    assert sample.polylines.vertices == pytest.approx(np.array(IN_PIXELS), abs=tolerance)
    assert sample.ignore[0] == pytest.approx(region, abs=tolerance)
    assert sample.size == (4, 8)


def test_map_coordinates_need_a_georeference(tmp_path):
    pytest.importorskip("rasterio", reason="rasterio looks for the georeference")
    image = tmp_path / "a.jpg"
    image.write_bytes(cv2.imencode(".jpg", np.zeros((4, 8, 3), np.uint8))[1].tobytes())
    writer = GeoJsonWriter(tmp_path, coordinates="map")
    for given_image in (image, np.zeros((4, 8, 3), np.uint8)):
        with pytest.raises(ValueError, match=r"a\.jpg has no georeference: write it in pixels"):
            writer.add(sample_of("a.jpg", LINE, image=given_image))


@pytest.fixture
def aerial_root() -> Path:
    data = os.environ.get("YOLINO_DATA") or Path(__file__).parents[3] / "shared" / "data"
    root = Path(data) / "aerial_lanes"
    if not root.is_dir():
        pytest.skip(
            f"the aerial tiles are not in {root}; set YOLINO_DATA to the folder that holds aerial_lanes/"
        )
    return root


def test_real_labels_survive_reading_and_writing(aerial_root, tmp_path):
    dataset = GeoJson(aerial_root)
    assert (len(dataset), dataset.classes) == (19, ("link", "way"))
    samples = list(dataset)
    with GeoJsonWriter(tmp_path, classes=dataset.classes) as writer:
        for sample in samples:
            writer.add(sample)
    again = {one.name: one for one in GeoJson(tmp_path, require_images=False)}
    for sample in samples:
        document = json.loads((aerial_root / "labels" / f"{Path(sample.name).stem}.geojson").read_text())
        shapes = [one["geometry"] for one in document["features"]]
        lines = [one["coordinates"] for one in shapes if one["type"] == "LineString"]
        rings = [one["coordinates"][0] for one in shapes if one["type"] == "Polygon"]
        for found in (sample, again[sample.name]):
            assert as_lists(found.polylines) == lines
            assert [[*one.tolist(), one[0].tolist()] for one in found.ignore] == rings
            assert found.polylines.labels.tolist() == sample.polylines.labels.tolist()
    val = GeoJson(aerial_root, names="val.txt")
    assert [one.name for one in val] == (aerial_root / "val.txt").read_text().split()
