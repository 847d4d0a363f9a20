from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.datasets.annotation import LabelError
from yolino.datasets.labelme import LabelMe, LabelMeWriter
from yolino.types import Polylines, Sample


def shape(label: object = "lane", kind: object = "linestrip", **fields: object) -> dict[str, object]:
    points = fields.pop("points", [[0, 0.25], [10.5, 20]])
    return {"label": label, "points": points, "group_id": None, "shape_type": kind, "flags": {}, **fields}


def document(*shapes: object, **fields: object) -> dict[str, object]:
    return {
        "version": "5.5.0",
        "flags": {},
        "shapes": list(shapes),
        "imagePath": "a.jpg",
        "imageData": None,
        "imageHeight": 590,
        "imageWidth": 1640,
        **fields,
    }


def write(root: Path, name: str, content: object, *images: str) -> Path:
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else json.dumps(content).encode())
    for image in images:
        (root / image).parent.mkdir(parents=True, exist_ok=True)
        (root / image).write_bytes(b"an image")
    return path


def as_lists(polylines: Polylines) -> list[list[list[float]]]:
    return [p.tolist() for p in polylines]


def test_line_strips_are_polylines_as_they_were_drawn(tmp_path):
    shapes = [
        shape("way", points=[[0, 0.25], [1640, 590], [-3.5, 7]]),
        shape("link", "line"),
        shape("way", points=[[4, 5]]),
        shape("car", "rectangle"),
        shape("car", "polygon", points=[]),
        shape("dot", "point", points="unread"),
        {"label": "old", "points": [[1, 2]]},
    ]
    write(tmp_path, "a.json", document(*shapes, extra={"a": 1}), "a.jpg")
    dataset = LabelMe(tmp_path)
    sample = dataset[0]
    assert as_lists(sample.polylines) == [
        [[0, 0.25], [1640, 590], [-3.5, 7]],
        [[0, 0.25], [10.5, 20]],
        [[4, 5]],
    ]
    assert dataset.classes == ("link", "way")
    assert sample.polylines.labels.tolist() == [1, 0, 1]
    assert sample.polylines.scores.tolist() == [1, 1, 1]
    assert sample.name == "a.jpg"
    assert sample.image == tmp_path / "a.jpg"
    assert sample.size == (590, 1640)
    assert sample.ignore == ()


def test_polygons_and_rectangles_to_ignore(tmp_path):
    shapes = [
        shape("ignore", "polygon", points=[[0, 0], [4, 0], [4, 4]]),
        shape("ignore", "rectangle", points=[[9, 8], [1, 2]]),
        shape("ignore", "rectangle", points=[[0, 0], [1, 0], [1, 1], [0, 1]]),
        shape("ignore", "oriented_rectangle", points=[[1, 0], [2, 1], [1, 2], [0, 1]]),
        shape("parked", "polygon", points=[[0, 0], [1, 0], [1, 1]]),
        shape("ignore"),
    ]
    write(tmp_path, "a.json", document(*shapes), "a.jpg")
    sample = LabelMe(tmp_path)[0]
    assert [region.tolist() for region in sample.ignore] == [
        [[0, 0], [4, 0], [4, 4]],
        [[9, 8], [1, 8], [1, 2], [9, 2]],
        [[0, 0], [1, 0], [1, 1], [0, 1]],
        [[1, 0], [2, 1], [1, 2], [0, 1]],
    ]
    assert len(sample.polylines) == 1
    assert len(LabelMe(tmp_path, ignore=["parked"])[0].ignore) == 1


def test_scores_are_read_where_there_are_some(tmp_path):
    write(
        tmp_path, "a.json", document(shape(score=0.25), shape(), shape(score=None), shape(score=0)), "a.jpg"
    )
    assert LabelMe(tmp_path)[0].polylines.scores.tolist() == [0.25, 1, 1, 0]


@pytest.mark.parametrize(
    ("given", "image", "name"),
    [
        ("a.jpg", "labels/x/a.jpg", "labels/x/a.jpg"),
        ("..\\..\\images\\a.jpg", "images/a.jpg", "images/a.jpg"),
        ("../../images/./a.jpg", "images/a.jpg", "images/a.jpg"),
        ("clips/a.jpg", "clips/a.jpg", "clips/a.jpg"),
        ("C:\\data\\a.jpg", "labels/x/a.jpg", "labels/x/a.jpg"),
        ("/elsewhere/a.jpg", "labels/x/a.jpg", "labels/x/a.jpg"),
        ("/elsewhere/a.jpg", "images/a.jpg", "images/a.jpg"),
        ("", "labels/x/l.png", "labels/x/l.png"),
        (None, "images/l.png", "images/l.png"),
    ],
)
def test_the_image_is_found_from_the_label_file_or_below_the_root(tmp_path, given, image, name):
    write(tmp_path, "labels/x/l.json", document(imagePath=given), image)
    assert [s.name for s in LabelMe(tmp_path)] == [name]


def test_the_image_of_the_label_files_folder_comes_first(tmp_path):
    write(tmp_path, "x/a.json", document(imagePath="a.jpg"), "a.jpg", "x/a.jpg")
    assert LabelMe(tmp_path)[0].image == tmp_path / "x/a.jpg"


def test_an_absolute_path_in_the_root_is_found(tmp_path):
    write(tmp_path, "x/a.json", document(imagePath=str(tmp_path / "y/a.jpg")), "y/a.jpg")
    assert LabelMe(tmp_path)[0].name == "y/a.jpg"


def test_images_can_be_elsewhere(tmp_path):
    write(tmp_path, "set/labels/a.json", document(imagePath="../x/a.jpg"), "images/x/a.jpg")
    dataset = LabelMe(tmp_path / "set", images=tmp_path / "images")
    assert dataset[0].image == tmp_path / "images/x/a.jpg"
    assert dataset[0].name == "x/a.jpg"
    with pytest.raises(FileNotFoundError, match=r"a\.json names the image .*set/x/a\.jpg"):
        LabelMe(tmp_path / "set")


def test_files_can_be_listed_by_the_names_of_their_images(tmp_path):
    for name in ("a", "b", "c"):
        write(tmp_path, f"x/{name}.json", document(imagePath=f"{name}.jpg"), f"x/{name}.jpg")
    (tmp_path / "val.txt").write_text("x/c.jpg\nx/a.jpg\n")
    assert [s.name for s in LabelMe(tmp_path, names="val.txt")] == ["x/c.jpg", "x/a.jpg"]


@pytest.mark.parametrize("side", ["imageHeight", "imageWidth"])
def test_the_size_may_be_unknown(tmp_path, side):
    write(tmp_path, "a.json", document(**{side: None}), "a.jpg")
    assert LabelMe(tmp_path)[0].size is None


LINE = shape()
BAD = {
    "is not valid JSON": b"",
    "is not valid JSON (UnicodeDecodeError)": b'{"shapes": "\xff"}',
    "is not valid JSON (RecursionError)": b"[" * 200_000,
    "has no list of shapes": [1, 2],
    "has no list of shapes, which": {"version": "5.5.0"},
    "has no list of shapes, which a file of LabelMe has": document() | {"shapes": {}},
    ", shape 1 is [1], but an object is needed": document(LINE, [1]),
    ", shape 0 has the label None": document(shape(None)),
    ", shape 0 has the label 7 and the shape_type 'linestrip', but names": document(shape(7)),
    "and the shape_type 5, but names are needed": document(shape("lane", 5)),
    ", shape 0 has NoneType": document(shape(points=None)),
    ", shape 0 has 0 points": document(shape(points=[])),
    ", shape 1 has the point [1]": document(LINE, shape(points=[[1]])),
    ", shape 1 has the coordinate '3'": document(LINE, shape(points=[[1, "3"]])),
    ", shape 0 has the coordinate nan": document(shape(points=[[1, float("nan")]])),
    ", shape 0 has the score 'high', but a finite number is needed": document(shape(score="high")),
    ", shape 0 has the score inf": document(shape(score=float("inf"))),
    ", shape 0 has the score True": document(shape(score=True)),
    ", shape 0 has 2 points, but at least 3": document(shape("ignore", "polygon")),
    ", shape 0 has 1 points, but at least 2": document(shape("ignore", "rectangle", points=[[1, 1]])),
    "has imagePath 5, but the name of an image": document(imagePath=5),
    "has imageHeight '590' and imageWidth 1640": document(imageHeight="590"),
    "has imageHeight 590 and imageWidth 0, but positive": document(imageWidth=0),
    "has imageHeight 590 and imageWidth True": document(imageWidth=True),
}


@pytest.mark.parametrize("reason", BAD)
def test_a_broken_file_is_named_and_the_rest_goes_on(tmp_path, reason):
    write(tmp_path, "a.json", document(LINE), "a.jpg")
    path = write(tmp_path, "b.json", BAD[reason])
    with pytest.raises(LabelError) as caught:
        LabelMe(tmp_path)
    assert str(caught.value).startswith(str(path))
    assert reason in str(caught.value)
    dataset = LabelMe(tmp_path, skip_broken=True)
    assert [s.name for s in dataset] == ["a.jpg"]
    assert len(dataset.broken) == 1


def test_classes_choose_polylines(tmp_path):
    write(tmp_path, "a.json", document(shape("way"), shape("link"), shape("way")), "a.jpg")
    dataset = LabelMe(tmp_path, classes={"link": "lane"})
    assert dataset.classes == ("lane",)
    assert len(dataset[0].polylines) == 1
    assert dataset.left_out == {"way": 2}


def sample_of(name: str, *lines: object, **fields: object) -> Sample:
    return Sample(name, Path(name), Polylines.from_list(lines), size=(590, 1640), **fields)


def test_files_are_written_as_labelme_does(tmp_path):
    polylines = Polylines.from_list([[[0.1, 2], [3, 4]], [[5, 6]]], [1, 0.5], [1, 0])
    region = np.array([[0.0, 0], [1, 0], [1, 1]])
    with LabelMeWriter(tmp_path, classes=("way", "Straße")) as writer:
        writer.add(Sample("x/a.jpg", Path("x/a.jpg"), polylines, [region], (590, 1640)))
    text = (tmp_path / "x/a.json").read_text(encoding="utf-8")
    assert "Straße" in text
    common = {"group_id": None, "description": "", "flags": {}}
    lines = {"shape_type": "linestrip", **common}
    assert json.loads(text) == {
        "version": "5.5.0",
        "flags": {},
        "shapes": [
            {"label": "Straße", "points": [[0.1, 2.0], [3.0, 4.0]], **lines},
            {"label": "way", "points": [[5.0, 6.0]], "score": 0.5, **lines},
            {"label": "ignore", "points": region.tolist(), "shape_type": "polygon", **common},
        ],
        "imagePath": "a.jpg",
        "imageData": None,
        "imageHeight": 590,
        "imageWidth": 1640,
    }


def test_the_images_may_be_elsewhere(tmp_path):
    with LabelMeWriter(tmp_path / "out", images=tmp_path / "images") as writer:
        writer.add(sample_of("x/a.jpg"))
    assert json.loads((tmp_path / "out/x/a.json").read_text())["imagePath"] == "../../images/x/a.jpg"
    (tmp_path / "images/x").mkdir(parents=True)
    (tmp_path / "images/x/a.jpg").write_bytes(b"an image")
    assert LabelMe(tmp_path / "out")[0].image.samefile(tmp_path / "images/x/a.jpg")


def test_what_cannot_be_written_is_named(tmp_path):
    writer = LabelMeWriter(tmp_path)
    good = sample_of("a.jpg", [[1, 2]])
    writer.add(good)
    bad_scores = Polylines.from_list([[[1, 2]]], [np.nan])
    for change, reason in (
        ({"size": None}, r"size of b\.jpg is unknown"),
        ({"polylines": bad_scores}, r"b\.jpg has a score or a corner that is not finite"),
        ({"ignore": [np.full((3, 2), np.inf)]}, r"b\.jpg has a score or a corner that is not finite"),
        ({"polylines": Polylines.from_list([[[1, np.inf]]])}, r"b\.jpg has a vertex that is not finite"),
        ({"name": "a.png"}, r"a\.png and a\.jpg would both be .*a\.json"),
        ({"name": "../b.jpg"}, "leads out of the folder"),
    ):
        with pytest.raises(ValueError, match=reason):
            writer.add(dataclasses.replace(good, **{"name": "b.jpg", **change}))
    assert [p.name for p in tmp_path.rglob("*.json")] == ["a.json"]


POINTS = st.tuples(st.floats(-1e5, 1e5), st.floats(-1e5, 1e5))
LINES = st.lists(
    st.tuples(st.lists(POINTS, min_size=1, max_size=4), st.floats(0, 1), st.integers(0, 2)), max_size=4
)
REGIONS = st.lists(st.lists(POINTS, min_size=3, max_size=5), max_size=2)
CLASSES = st.lists(st.text(max_size=5), min_size=3, max_size=3, unique=True)


@settings(deadline=None, max_examples=25)
@given(st.lists(st.tuples(LINES, REGIONS), min_size=1, max_size=3), st.none() | CLASSES)
def test_reading_what_was_written_is_the_identity(tmp_path_factory, images, classes):
    root = tmp_path_factory.mktemp("written")
    samples = []
    with LabelMeWriter(root, classes=classes or ()) as writer:
        for i, (lines, regions) in enumerate(images):
            lists = [points for points, _, _ in lines], [score for _, score, _ in lines]
            polylines = Polylines.from_list(*lists, [label if classes else 0 for _, _, label in lines])
            name = f"x {i}/ä.{i}.jpg"
            samples.append(Sample(name, root / name, polylines, [np.array(r) for r in regions], (9, 8 + i)))
            writer.add(samples[-1])
            (root / name).write_bytes(b"an image")
    dataset = (
        LabelMe(root, classes=classes or ("line",)) if any(lines for lines, _ in images) else LabelMe(root)
    )
    for read, given_sample in zip(dataset, samples, strict=True):
        assert (read.name, read.image, read.size) == (
            given_sample.name,
            given_sample.image,
            given_sample.size,
        )
        for field in ("vertices", "offsets", "scores", "labels"):
            found, expected = getattr(read.polylines, field), getattr(given_sample.polylines, field)
            assert found.tolist() == expected.tolist()
        assert [r.tolist() for r in read.ignore] == [r.tolist() for r in given_sample.ignore]
