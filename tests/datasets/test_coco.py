from __future__ import annotations

import json
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.datasets.annotation import LabelError
from yolino.datasets.coco import Coco, CocoWriter
from yolino.types import Polylines, Sample

IMAGE = {"id": 7, "file_name": "images/a.jpg", "width": 8, "height": 4}
CATEGORIES = [{"id": 2, "name": "way"}, {"id": 5, "name": "link", "supercategory": "lane"}]
LINE = {"id": 1, "image_id": 7, "category_id": 2, "polyline": [1, 2, 3.5, 4, 3, 4]}
POINTS = [[1, 2], [3.5, 4], [3, 4]]
SQUARE = [0, 0, 10, 0, 10, 10, 0, 10]
CORNERS = [[0, 0], [10, 0], [10, 10], [0, 10]]


def write_labels(root: Path, *annotations: object, name: str = "annotations.json", **lists: object) -> Path:
    document = {"images": [IMAGE], "annotations": annotations, "categories": CATEGORIES, **lists}
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(document))
    for image in document["images"]:
        if isinstance(image, dict) and isinstance(image.get("file_name"), str):
            file = root / image["file_name"].replace("\\", "/")
            file.parent.mkdir(parents=True, exist_ok=True)
            file.touch()
    return path


def as_lists(polylines: Polylines) -> list[list[list[float]]]:
    return [p.tolist() for p in polylines]


def named(dataset: Coco, sample: Sample) -> list[str]:
    return [dataset.classes[label] for label in sample.polylines.labels]


def test_polylines_regions_scores_and_categories(tmp_path):
    write_labels(
        tmp_path,
        {**LINE, "score": 0.25, "color": "red"},
        {"id": 2, "image_id": 7, "category_id": 5, "segmentation": [SQUARE], "bbox": [0, 0, 10, 10]},
        {"id": 3, "image_id": 7, "iscrowd": 1, "segmentation": [SQUARE, [0, 0, 1, 0, 0, 1]]},
        {"id": 4, "image_id": 7, "category_id": 5, "ignore": 1, "bbox": [1, 2, 3, 4]},
        {"id": 5, "image_id": 7, "category_id": 5, "polyline": [5, 6, 7, 8], "iscrowd": 0, "ignore": False},
        {"id": 6, "image_id": 7, "polyline": [[0, 0], [1, 1]], "score": None},
    )
    dataset = Coco(tmp_path)
    (sample,) = dataset
    assert (sample.name, sample.image, sample.size) == ("images/a.jpg", tmp_path / "images/a.jpg", (4, 8))
    assert as_lists(sample.polylines) == [POINTS, [[5, 6], [7, 8]], [[0, 0], [1, 1]]]
    assert named(dataset, sample) == ["way", "link", "line"]
    assert sample.polylines.scores.tolist() == [0.25, 1, 1]
    assert [one.tolist() for one in sample.ignore] == [
        CORNERS,
        [[0, 0], [1, 0], [0, 1]],
        [[1, 2], [4, 2], [4, 6], [1, 6]],
    ]


@pytest.mark.parametrize(
    ("polyline", "lines"),
    [
        ([1, 2], [[[1, 2]]]),
        ([1, 2, 3, 4], [[[1, 2], [3, 4]]]),
        ([[1, 2]], [[[1, 2]]]),
        ([[1, 2], [3, 4]], [[[1, 2], [3, 4]]]),
        ([[1, 2, 3, 4]], [[[1, 2], [3, 4]]]),
        ([[1, 2, 3, 4], [5, 6]], [[[1, 2], [3, 4]], [[5, 6]]]),
        ([[[1, 2], [3, 4]]], [[[1, 2], [3, 4]]]),
        ([[[1, 2], [3, 4]], [[5, 6], [7, 8]]], [[[1, 2], [3, 4]], [[5, 6], [7, 8]]]),
        ([[[1, 2, 0.5], [3, 4, 0.5]], [5, 6, 7, 8]], [[[1, 2], [3, 4]], [[5, 6], [7, 8]]]),
        ([], []),
        ([[]], []),
    ],
)
def test_the_forms_of_a_polyline(tmp_path, polyline, lines):
    write_labels(tmp_path, {**LINE, "polyline": polyline})
    assert as_lists(Coco(tmp_path)[0].polylines) == lines


def test_polygons_of_an_ignored_category_are_regions(tmp_path):
    region = {"id": 3, "image_id": 7, "category_id": 5, "segmentation": SQUARE}
    write_labels(tmp_path, LINE, region, {**LINE, "id": 4, "category_id": 5})
    assert Coco(tmp_path)[0].ignore == ()
    (sample,) = dataset = Coco(tmp_path, ignore=["link"])
    assert [one.tolist() for one in sample.ignore] == [CORNERS]
    assert named(dataset, sample) == ["way", "link"]


def test_images_without_annotations_are_samples(tmp_path):
    write_labels(tmp_path, LINE, images=[{"id": "b", "file_name": "x\\b.png"}, IMAGE])
    first, second = Coco(tmp_path)
    assert (first.name, len(first.polylines), first.size) == ("x/b.png", 0, None)
    assert (second.name, len(second.polylines)) == ("images/a.jpg", 1)


def test_files_lie_in_annotations_or_in_the_root(tmp_path):
    write_labels(tmp_path, LINE, name="b.json")
    assert len(Coco(tmp_path)) == 1
    other = {"id": 7, "file_name": "b.jpg"}  # ids hold within a file
    for name, image in (("train", IMAGE), ("val", other)):
        write_labels(tmp_path, LINE, name=f"annotations/{name}.json", images=[image])
    assert [one.name for one in Coco(tmp_path)] == ["images/a.jpg", "b.jpg"]
    assert [one.name for one in Coco(tmp_path, "annotations/val.json")] == ["b.jpg"]
    (tmp_path / "list.txt").write_text("b.jpg\n")
    assert [one.name for one in Coco(tmp_path, names="list.txt")] == ["b.jpg"]


def test_classes_are_the_categories_where_the_files_agree(tmp_path):
    ignore = {"id": 9, "name": "ignore"}
    write_labels(tmp_path, name="annotations/a.json")
    write_labels(tmp_path, LINE, name="annotations/b.json", categories=[*CATEGORIES, ignore])
    assert Coco(tmp_path).classes == ("way", "link")
    write_labels(tmp_path, name="annotations/c.json", categories=CATEGORIES[::-1])
    assert Coco(tmp_path).classes == ("way",)
    assert Coco(tmp_path, classes={"way": "lane"}).classes == ("lane",)
    write_labels(tmp_path / "none", categories=[])
    assert Coco(tmp_path / "none").classes == ("line",)


def test_a_missing_image_is_named_unless_images_are_not_required(tmp_path):
    write_labels(tmp_path, LINE)
    (tmp_path / "images/a.jpg").unlink()
    with pytest.raises(
        FileNotFoundError, match=r"image images/a\.jpg names the image .*images/a\.jpg, which"
    ):
        Coco(tmp_path)
    assert [one.name for one in Coco(tmp_path, require_images=False)] == ["images/a.jpg"]


BAD_FILES = {
    " is not valid JSON": "",
    " is not valid JSON (Expecting": "{'images': 1}",
    " is not valid JSON (RecursionError)": "[" * 200_000,
    " holds a list, but an object": "[]",
    " lacks the list of images": "{}",
    " lacks the list of annotations": '{"images": []}',
    " lacks the list of categories": '{"images": [], "annotations": [], "categories": null}',
    ", categories[0] is 7, but": '{"images": [], "annotations": [], "categories": [7]}',
    ", categories[0] is {'id': 1}, but": '{"images": [], "annotations": [], "categories": [{"id": 1}]}',
    ", categories[0] is {'id': [1]": '{"images": [], "annotations": [], "categories": [{"id": [1]}]}',
    ", categories[1] has the id 1 of an earlier": (
        '{"images": [], "annotations": [], "categories": [{"id": 1, "name": "a"}, {"id": 1, "name": "b"}]}'
    ),
}


@pytest.mark.parametrize("reason", BAD_FILES)
def test_a_bad_file_is_named(tmp_path, reason):
    path = tmp_path / "a.json"
    path.write_text(BAD_FILES[reason])
    with pytest.raises(LabelError) as caught:
        Coco(tmp_path)
    assert str(caught.value).startswith(f"{path}{reason}")


BAD_IMAGES = {
    "images[1] is 7, but": 7,
    "images[1] is {'file_name': 'a'}, but": {"file_name": "a"},
    "images[1] is {'id': [1]}, but": {"id": [1]},
    "images[1] has the file_name None, but": {"id": 1},
    "images[1] has the file_name '', but": {"id": 1, "file_name": ""},
    "images[1] has the id 7 of an earlier image": {"id": 7, "file_name": "b.jpg"},
}

BAD_ANNOTATIONS = {
    "annotations[1] is 7, but an object": 7,
    "annotation 9 has the image_id 8, which no image has": {**LINE, "image_id": 8},
    "annotation 9 has the image_id [7], which no": {**LINE, "image_id": [7]},
    "annotations[1] has the image_id None": {"polyline": [1, 2]},
}

BAD_LINES = {
    "annotation 9 has the category_id 3, which no category has": {**LINE, "category_id": 3},
    "annotation 9 has the category_id [3]": {**LINE, "category_id": [3]},
    "annotation 9 has the score 'high', but a finite number": {**LINE, "score": "high"},
    "annotation 9 has the score True": {**LINE, "score": True},
    "annotation 9 has the score inf": {**LINE, "score": float("inf")},
    "annotation 9, polyline is 'x', but a list": {**LINE, "polyline": "x"},
    "annotation 9, polyline is {}, but a list": {**LINE, "polyline": {}},
    "annotation 9, polyline has 3 numbers, but pairs": {**LINE, "polyline": [1, 2, 3]},
    "annotation 9, polyline has 5 numbers": {**LINE, "polyline": [[1, 2], [1, 2, 3, 4, 5]]},
    "annotation 9, polyline has the coordinate nan": {**LINE, "polyline": [1, float("nan")]},
    "annotation 9, polyline has the coordinate '1'": {**LINE, "polyline": ["1", 2]},
    "annotation 9, polyline has the coordinate True": {**LINE, "polyline": [[True, 2]]},
    "annotation 9, polyline has the point 2, but": {**LINE, "polyline": [[1, 2], 2]},
    "annotation 9, polyline has the coordinate [3]": {**LINE, "polyline": [1, [3]]},
    "annotation 9, segmentation has 2 points, but at least 3": {
        **LINE,
        "ignore": 1,
        "segmentation": [[0, 0, 1, 1]],
    },
    "annotation 9 has a run-length segmentation": {**LINE, "iscrowd": 1, "segmentation": {"counts": "x"}},
    "annotation 9 is to be ignored, but has no segmentation": {**LINE, "ignore": 1, "bbox": [0, 0, 1, 1]},
    "annotation 9, bbox has the coordinate '1'": {"image_id": 7, "iscrowd": 1, "bbox": [0, 0, 1, "1"]},
}


@pytest.mark.parametrize("reason", BAD_IMAGES)
def test_a_bad_image_is_named_and_the_others_go_on(tmp_path, reason):
    path = write_labels(tmp_path, LINE, images=[IMAGE, BAD_IMAGES[reason]])
    check_that_one_is_left(tmp_path, f"{path}, {reason}", lines=1)


@pytest.mark.parametrize("reason", BAD_ANNOTATIONS)
def test_an_annotation_of_no_image_is_named_and_the_others_go_on(tmp_path, reason):
    bad = BAD_ANNOTATIONS[reason]
    path = write_labels(tmp_path, LINE, {**bad, "id": 9} if "annotation 9" in reason else bad)
    check_that_one_is_left(tmp_path, f"{path}, {reason}", lines=1)


@pytest.mark.parametrize("reason", BAD_LINES)
def test_a_bad_line_breaks_its_image_only(tmp_path, reason):
    other = {"id": 8, "file_name": "b.jpg"}
    bad = {**BAD_LINES[reason], "id": 9, "image_id": 8}
    path = write_labels(tmp_path, LINE, bad, {**LINE, "image_id": 8}, images=[other, IMAGE])
    check_that_one_is_left(tmp_path, f"{path}, image b.jpg, {reason}", lines=1)


def check_that_one_is_left(root: Path, message: str, lines: int) -> None:
    with pytest.raises(LabelError) as caught:
        Coco(root)
    assert str(caught.value).startswith(message)
    dataset = Coco(root, skip_broken=True)
    assert [(one.name, len(one.polylines)) for one in dataset] == [("images/a.jpg", lines)]
    assert len(dataset.broken) == 1


def sample_of(name: str, *lines: object, **fields: object) -> Sample:
    polylines = Polylines.from_list(list(lines), fields.pop("scores", None), fields.pop("labels", None))
    return Sample(name, fields.pop("image", Path(name)), polylines, **{"size": (4, 8), **fields})


def test_what_is_written_is_coco(tmp_path):
    region = np.array([[0.0, 0.0], [9.0, 0.0], [0.0, 6.0]])
    with CocoWriter(tmp_path, classes=("way", "link")) as writer:
        writer.add(sample_of("images/a.jpg"))
        writer.add(
            sample_of(
                "b.jpg", POINTS, [[7, 8.125]], scores=[1, 0.5], labels=[1, 0], ignore=(region,), size=(6, 9)
            )
        )
        assert list(tmp_path.iterdir()) == []
    assert json.loads((tmp_path / "annotations.json").read_text()) == {
        "images": [
            {"id": 1, "file_name": "images/a.jpg", "width": 8, "height": 4},
            {"id": 2, "file_name": "b.jpg", "width": 9, "height": 6},
        ],
        "annotations": [
            {
                "id": 1,
                "image_id": 2,
                "category_id": 2,
                "polyline": [1, 2, 3.5, 4, 3, 4],
                "bbox": [1, 2, 2.5, 2],
                "area": 5,
                "iscrowd": 0,
            },
            {
                "id": 2,
                "image_id": 2,
                "category_id": 1,
                "polyline": [7, 8.125],
                "score": 0.5,
                "bbox": [7, 8.125, 0, 0],
                "area": 0,
                "iscrowd": 0,
            },
            {
                "id": 3,
                "image_id": 2,
                "category_id": 3,
                "segmentation": [[0, 0, 9, 0, 0, 6]],
                "bbox": [0, 0, 9, 6],
                "area": 27,
                "iscrowd": 1,
            },
        ],
        "categories": [{"id": 1, "name": "way"}, {"id": 2, "name": "link"}, {"id": 3, "name": "ignore"}],
    }


def test_nothing_is_written_as_an_empty_file(tmp_path):
    with CocoWriter(tmp_path, file="labels/val.json"):
        pass
    assert json.loads((tmp_path / "labels/val.json").read_text()) == {
        "images": [],
        "annotations": [],
        "categories": [{"id": 1, "name": "line"}],
    }
    dataset = Coco(tmp_path, "labels/val.json")
    assert (len(dataset), dataset.classes) == (0, ("line",))


def test_what_cannot_be_written_is_named(tmp_path):
    writer = CocoWriter(tmp_path)
    nan, two = np.array([[0, np.nan], [1, 1], [2, 0]]), np.zeros((2, 2))
    for sample, reason in (
        (sample_of("a.jpg", [[1, np.inf]]), "a vertex that is not finite"),
        (sample_of("a.jpg", np.zeros((0, 2))), "a polyline without vertices"),
        (sample_of("a.jpg", POINTS, scores=[np.nan]), "a score or a region to ignore that is not finite"),
        (sample_of("a.jpg", ignore=(nan,)), "a score or a region to ignore that is not finite"),
    ):
        with pytest.raises(ValueError, match=rf"a\.jpg has {reason}"):
            writer.add(sample)
    with pytest.raises(ValueError, match=r"a\.jpg has a region to ignore of fewer than 3 vertices"):
        writer.add(sample_of("a.jpg", ignore=(two,)))
    with pytest.raises(ValueError, match=r"size of a\.jpg is unknown"):
        writer.add(sample_of("a.jpg", size=None))
    writer.add(sample_of("a.jpg", size=None, image=np.zeros((3, 5, 3), np.uint8)))
    writer.close()
    (image,) = json.loads((tmp_path / "annotations.json").read_text())["images"]
    assert (image["height"], image["width"]) == (3, 5)


coordinates = st.floats(-1e5, 1e5)
vertices = st.lists(st.tuples(coordinates, coordinates), min_size=1, max_size=4).map(np.array)
regions = st.lists(st.tuples(coordinates, coordinates), min_size=3, max_size=5).map(np.array)


@st.composite
def fields(draw: st.DrawFn, classes: int) -> dict[str, object]:
    lines = draw(st.lists(vertices, max_size=3))
    n = len(lines)
    scores = draw(st.lists(st.floats(-1e9, 1e9) | st.just(1.0), min_size=n, max_size=n))
    labels = draw(st.lists(st.integers(0, max(classes, 1) - 1), min_size=n, max_size=n))
    size = draw(st.tuples(st.integers(1, 9999), st.integers(1, 9999)))
    ignore = tuple(draw(st.lists(regions, max_size=2)))
    return {"lines": lines, "scores": scores, "labels": labels, "ignore": ignore, "size": size}


@settings(deadline=None, max_examples=50)
@given(st.data(), st.lists(st.text(max_size=8), unique=True, max_size=3))
def test_writing_and_reading_is_the_identity(data, classes):
    drawn = [(name, data.draw(fields(len(classes)))) for name in ("images/a.jpg", "x/a b.tif", "c.png")]
    written = [sample_of(name, *one.pop("lines"), **one) for name, one in drawn]
    with tempfile.TemporaryDirectory() as folder:
        with CocoWriter(Path(folder), classes=classes) as writer:
            for sample in written:
                writer.add(sample)
        dataset = Coco(folder, require_images=False)
    assert dataset.classes == (tuple(classes) or ("line",))
    for found, sample in zip(dataset, written, strict=True):
        assert (found.name, found.size) == (sample.name, sample.size)
        assert as_lists(found.polylines) == as_lists(sample.polylines)
        assert found.polylines.scores.tolist() == sample.polylines.scores.tolist()
        assert found.polylines.labels.tolist() == sample.polylines.labels.tolist()
        assert [region.tolist() for region in found.ignore] == [region.tolist() for region in sample.ignore]
