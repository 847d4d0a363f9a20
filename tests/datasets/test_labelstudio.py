from __future__ import annotations

import itertools
import json
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.datasets.annotation import LabelError
from yolino.datasets.labelstudio import LabelStudio, LabelStudioWriter
from yolino.geometry import distance_to_segments
from yolino.types import Polylines, Sample

SIZE = {"original_width": 200, "original_height": 50, "image_rotation": 0}


def vertex(x: float, y: float, id: str = "", previous: str | None = None, **fields: object) -> dict[str, Any]:
    named = {"id": id, "prevPointId": previous} if id else {}
    return {"x": x, "y": y, "isBezier": False, **named, **fields}


def vector(
    *vertices: object, label: str | None = "lane", closed: bool = False, **fields: object
) -> dict[str, Any]:
    value = {"vertices": list(vertices), "closed": closed}
    if label is None:
        return {"type": "vector", "value": value, **SIZE, **fields}
    return {"type": "vectorlabels", "value": {**value, "vectorlabels": [label]}, **SIZE, **fields}


def polygon(*points: list[float], label: str = "ignore", **fields: object) -> dict[str, Any]:
    value = {"points": list(points), "closed": True, "polygonlabels": [label]}
    return {"type": "polygonlabels", "value": value, **SIZE, **fields}


STRAIGHT = vector(vertex(50, 100, "p", None), vertex(12.5, 0, "q", "p"), id="A1", from_name="a", to_name="i")
REGION = polygon([0, 0], [100, 0], [50, 50], id="A2")


def task(*results: object, image: object = "a.jpg", **fields: object) -> dict[str, Any]:
    return {"id": 1, "data": {"image": image}, "annotations": [{"result": list(results)}], **fields}


def write(root: Path, *tasks: object, text: str | None = None) -> Path:
    path = root / "project-1.json"
    path.write_text(json.dumps(list(tasks), indent=1) if text is None else text)
    return path


def read(root: Path, **options: object) -> LabelStudio:
    return LabelStudio(root, **{"require_images": False, **options})


def read_one(root: Path, *results: object, **options: object) -> Sample:
    write(root, task(*results))
    return read(root, **options)[0]


def as_lists(polylines: Polylines) -> list[list[list[float]]]:
    return [p.tolist() for p in polylines]


def test_percents_become_pixels(tmp_path):
    other = vector(vertex(0, 0), vertex(100, 100), label="curb", score=0.25)
    write(tmp_path, task(STRAIGHT, REGION, other), task(image="b.jpg"))
    dataset = read(tmp_path)
    first, second = dataset
    assert dataset.classes == ("curb", "lane")
    assert (first.name, first.size) == ("a.jpg", (50, 200))
    assert as_lists(first.polylines) == [[[100, 50], [25, 0]], [[0, 0], [200, 50]]]
    assert first.polylines.labels.tolist() == [1, 0]
    assert first.polylines.scores.tolist() == [1, 0.25]
    assert [region.tolist() for region in first.ignore] == [[[0, 0], [200, 0], [100, 25]]]
    assert (second.name, len(second.polylines), second.ignore, second.size) == ("b.jpg", 0, (), None)


def test_other_shapes_are_left_out(tmp_path):
    others = [
        {
            "type": "rectanglelabels",
            "value": {"x": 1, "y": 2, "width": 3, "height": 4, "rectanglelabels": ["lane"]},
        },
        {"type": "keypointlabels", "value": {"x": 1, "y": 2, "width": 1, "keypointlabels": ["lane"]}, **SIZE},
        {"type": "brushlabels", "value": {"format": "rle", "rle": [1], "brushlabels": ["lane"]}},
        {"type": "choices", "value": {"choices": ["rain", "night"]}},
        {"type": "relation", "from_id": "A1", "to_id": "A2", "direction": "right"},
        polygon([0, 0], [1, 1], [0, 1], label="building", image_rotation=90),
    ]
    sample = read_one(tmp_path, *others, STRAIGHT)
    assert as_lists(sample.polylines) == [[[100, 50], [25, 0]]]
    assert sample.ignore == ()


def test_lines_of_other_tools_count_too(tmp_path):
    points = [[50, 100], [12.5, 0]]
    with_label = {"type": "polylinelabels", "value": {"points": points, "polylinelabels": ["lane"]}, **SIZE}
    without = {"type": "polyline", "value": {"points": points}, **SIZE}
    sample = read_one(tmp_path, with_label, without)
    assert as_lists(sample.polylines) == [[[100, 50], [25, 0]]] * 2
    assert sample.polylines.labels.tolist() == [0, 1]
    assert read(tmp_path).classes == ("lane", "line")


def test_a_tool_without_labels_gives_two_results_of_one_shape(tmp_path):
    path = vector(vertex(50, 100), vertex(12.5, 0), label=None, id="x")
    value = {**path["value"], "labels": ["curb"]}
    label = {"type": "labels", "value": value, "id": "x", **SIZE}
    region = {"type": "polygon", "value": {"points": [[0, 0], [100, 0], [50, 50]]}, "id": "y", **SIZE}
    region_label = {"type": "labels", "value": {**region["value"], "labels": ["ignore"]}, "id": "y", **SIZE}
    choice = {"type": "choices", "value": {**path["value"], "choices": ["new", "old"]}, "id": "x", **SIZE}
    for order in itertools.permutations([path, label, region, region_label, choice]):
        sample = read_one(tmp_path, *order)
        assert as_lists(sample.polylines) == [[[100, 50], [25, 0]]]
        assert len(sample.ignore) == 1
    assert read(tmp_path).classes == ("curb",)
    alone = read_one(tmp_path, path, {**path, "id": "z"})
    assert len(alone.polylines) == 2
    assert read(tmp_path).classes == ("line",)


def chain(*edges: str, closed: bool = False) -> dict[str, Any]:
    """A path whose vertices `B<A` lie at x = 10, 20, ... percent for A, B, ..."""
    pairs = [edge.partition("<") for edge in edges]
    vertices = [vertex(10 * (ord(id) - 64), 0, id, previous or None) for id, _, previous in pairs]
    for v, (_, _, previous) in zip(vertices, pairs, strict=True):
        if previous == "-":
            del v["prevPointId"]
    return vector(*vertices, closed=closed)


@pytest.mark.parametrize(
    ("edges", "found"),
    [
        ("A B<A C<B", ["ABC"]),
        ("A B<- C<-", ["ABC"]),
        ("A C<B B<A", ["ABC"]),
        ("B<A A<B C<B", ["BAB", "BC"]),
        ("A", ["A"]),
        ("A B<A C<B D<A E<D", ["CBADE"]),  # continued at its beginning
        ("A B<A C<A D<A", ["AB", "AC", "AD"]),
        ("A B<A C<B D<B E<D", ["AB", "BC", "BDE"]),
        ("A B<A C<A D<B E<B", ["BAC", "BD", "BE"]),
        ("A<C B<A C<B", ["ABCA"]),
        ("A<C B<A C<B D<B", ["BCAB", "BD"]),
    ],
)
def test_vertices_follow_the_one_that_they_name(tmp_path, edges, found):
    sample = read_one(tmp_path, chain(*edges.split()))
    letters = ["".join(chr(64 + round(x / 20)) for x, _ in line) for line in as_lists(sample.polylines)]
    assert sorted(letters) == sorted(found)


@pytest.mark.parametrize(
    ("edges", "found"), [("A B<A C<B", "ABCA"), ("A<C B<A C<B", "ABCA"), ("A", "A"), ("A B<A", "ABA")]
)
def test_closed_paths_end_where_they_begin(tmp_path, edges, found):
    sample = read_one(tmp_path, chain(*edges.split(), closed=True))
    (line,) = as_lists(sample.polylines)
    assert "".join(chr(64 + round(x / 20)) for x, _ in line) == found


def test_a_closed_path_can_be_a_region_to_ignore(tmp_path):
    path = vector(vertex(0, 0), vertex(100, 0), vertex(50, 50), label="ignore", closed=True)
    sample = read_one(tmp_path, path, vector(vertex(1, 1), label="ignore"))
    assert [region.tolist() for region in sample.ignore] == [[[0, 0], [200, 0], [100, 25]]]
    assert len(sample.polylines) == 1  # what is open is no region
    assert len(read(tmp_path, ignore=[])[0].polylines) == 2


trees = st.integers(1, 8).flatmap(
    lambda n: st.tuples(*(st.integers(-1, n - 1).filter(lambda p, i=i: p != i) for i in range(n)))
)


@given(trees)
@settings(deadline=None, max_examples=200)
def test_every_edge_is_there_once(previous):
    from yolino.datasets.labelstudio_paths import path_to_polylines

    vertices = [
        vertex(i, 0, f"v{i}", None if before < 0 else f"v{before}") for i, before in enumerate(previous)
    ]
    # Without a name, the vertex before is the one listed before.
    before = [p if p >= 0 else i - 1 for i, p in enumerate(previous)]
    edges = sorted(tuple(sorted((p, i))) for i, p in enumerate(before) if p >= 0)
    lines = path_to_polylines({"vertices": vertices}, (100, 100), "here")
    xs = [np.round(line[:, 0]).astype(int).tolist() for line in lines]
    assert sorted(tuple(sorted(pair)) for line in xs for pair in itertools.pairwise(line)) == edges
    assert {x for line in xs for x in line} == set(range(len(previous)))
    # Polylines end at ends and branchings only.
    degrees = np.bincount(np.ravel(edges).astype(int), minlength=len(previous)) if edges else np.zeros(1)
    assert all(degrees[x] == 2 for line in xs for x in line[1:-1])
    assert all(degrees[x] != 2 or line[0] == line[-1] for line in xs for x in (line[0], line[-1]))


def curve_literally(points: np.ndarray, count: int = 20_000) -> np.ndarray:
    """De Casteljau's construction, one parameter after the other."""
    found = []
    for t in np.linspace(0, 1, count):
        level = points
        while len(level) > 1:
            level = (1 - t) * level[:-1] + t * level[1:]
        found.append(level[0])
    return np.array(found)


CURVES = {
    "both": ({"controlPoint2": {"x": 20, "y": 90}}, {"controlPoint1": {"x": 60, "y": -40}}),
    "leaving": ({"controlPoint2": {"x": 20, "y": 90}}, {}),
    "arriving": ({}, {"controlPoint1": {"x": 60, "y": -40}}),
}


@pytest.mark.parametrize("kind", CURVES)
@pytest.mark.parametrize("against", [False, True])
def test_curves_are_cut_into_pieces_a_tenth_of_a_pixel_off(tmp_path, kind, against):
    start, end = CURVES[kind]
    a = vertex(10, 20, "a", isBezier=bool(start), **start)
    b = vertex(70, 60, "b", "a", isBezier=bool(end), **end)
    path = vector(a, b, vertex(5, 5, "c", "a")) if against else vector(a, b)
    (line,) = read_one(tmp_path, path).polylines
    if against:  # from b by way of a to c
        assert line[-1].tolist() == [10, 2.5]
        line = line[: line.tolist().index([20, 10]) + 1][::-1]
    scale, chord = np.array([2.0, 0.5]), np.array([60, 40])
    first = [20, 90] if "controlPoint2" in start else np.array([10, 20]) + 0.3 * chord
    second = [60, -40] if "controlPoint1" in end else np.array([70, 60]) - 0.3 * chord
    points = np.array([[10, 20], first, second, [70, 60]], float) * scale
    exact = curve_literally(points, 2000)
    assert np.allclose(line[[0, -1]], points[[0, -1]])
    assert distance_to_segments(exact, np.stack([line[:-1], line[1:]], axis=1)).max() < 0.1
    assert distance_to_segments(line, np.stack([exact[:-1], exact[1:]], axis=1)).max() < 1e-3
    assert 5 < len(line) < 60


def test_a_curve_without_bend_stays_one_piece(tmp_path):
    a = vertex(0, 0, isBezier=True, controlPoint2={"x": 10, "y": 10})
    b = vertex(30, 30, isBezier=True, controlPoint1={"x": 20, "y": 20})
    assert as_lists(read_one(tmp_path, vector(a, b)).polylines) == [[[0, 0], [60, 15]]]


def test_a_curve_of_any_size_has_an_end(tmp_path):
    a = vertex(0, 0, isBezier=True, controlPoint2={"x": 1e200, "y": 10})
    (line,) = read_one(tmp_path, vector(a, vertex(30, 30))).polylines
    assert len(line) == 1001


def test_the_first_annotation_that_was_not_cancelled_counts(tmp_path):
    cancelled = {"result": [STRAIGHT], "was_cancelled": True}
    first, second = {"result": [], "was_cancelled": False}, {"result": [STRAIGHT]}
    other = {**STRAIGHT, "id": "A3"}
    data, predictions = {"image": "a.jpg"}, [{"result": [STRAIGHT, other], "score": 0.5}]
    tasks = [
        {"data": data, "annotations": [cancelled, first, second], "predictions": predictions},
        {"data": data, "annotations": [cancelled], "predictions": predictions},
        {"data": data, "annotations": []},
        {"data": data, "predictions": predictions},
    ]
    write(tmp_path, *tasks)
    assert [len(sample.polylines) for sample in read(tmp_path)] == [0]
    assert [len(sample.polylines) for sample in read(tmp_path, predictions=True)] == [0, 2, 2]


def test_tasks_that_no_one_labelled_are_named(tmp_path):
    write(tmp_path, {"data": {"image": "a.jpg"}, "annotations": []}, {"data": {}, "predictions": []})
    with pytest.raises(LabelError, match="has 2 tasks, but none with annotations: label some"):
        read(tmp_path)
    write(tmp_path)
    assert len(read(tmp_path)) == 0


@pytest.mark.parametrize(
    ("image", "name"),
    [
        ("frame.jpg", "frame.jpg"),
        ("clips/x/frame.jpg", "clips/x/frame.jpg"),
        ("clips\\x\\frame.jpg", "clips/x/frame.jpg"),
        ("C:\\x\\frame.jpg", "C:/x/frame.jpg"),
        ("a 100%25 b#1.jpg", "a 100%25 b#1.jpg"),
        ("/data/upload/7/0a1b2c3d-frame.jpg", "frame.jpg"),
        ("/data/upload/7/0a1b2c3d-0a1b2c3d-frame.jpg", "0a1b2c3d-frame.jpg"),
        ("/data/upload/7/frame.jpg", "frame.jpg"),
        ("/data/local-files/?d=clips/x%20y/frame.jpg", "clips/x y/frame.jpg"),
        ("/data/local-files/?d=clips%5Cframe.jpg", "clips/frame.jpg"),
        ("http://me:8080/data/local-files/?d=clips/0a1b2c3d-frame.jpg", "clips/0a1b2c3d-frame.jpg"),
        ("https://example.com/a%20b/frame.jpg?width=3", "a b/frame.jpg"),
        ("s3://bucket/a/frame.jpg", "a/frame.jpg"),
    ],
)
def test_images_have_the_name_in_their_address(tmp_path, image, name):
    write(tmp_path, task(STRAIGHT, image=image))
    assert read(tmp_path)[0].name == name


def touch(root: Path, name: str) -> str:
    (root / name).parent.mkdir(parents=True, exist_ok=True)
    (root / name).write_bytes(b"an image")
    return name


@pytest.mark.parametrize(
    ("image", "there", "found"),
    [
        ("/data/upload/7/0a1b2c3d-f.jpg", ["f.jpg", "7/0a1b2c3d-f.jpg"], "7/0a1b2c3d-f.jpg"),
        ("/data/upload/7/0a1b2c3d-f.jpg", ["f.jpg", "images/0a1b2c3d-f.jpg"], "images/0a1b2c3d-f.jpg"),
        ("/data/upload/7/0a1b2c3d-f.jpg", ["f.jpg", "b1b2c3d4-f.jpg"], "f.jpg"),
        ("/data/local-files/?d=me/data/x/f.jpg", ["f.jpg", "x/f.jpg"], "x/f.jpg"),
        ("s3://bucket/data/x/f.jpg", ["f.jpg", "images/x/f.jpg"], "images/x/f.jpg"),
    ],
)
def test_images_are_found_by_the_end_of_their_path(tmp_path, image, there, found):
    for name in there:
        touch(tmp_path, name)
    write(tmp_path, task(STRAIGHT, image=image))
    assert LabelStudio(tmp_path)[0].name == found


def test_the_image_may_stand_under_another_key(tmp_path):
    data = {"text": "A road.", "number": 7, "photo": "/data/local-files/?d=x/a.PNG", "other": "b.png"}
    write(tmp_path, {"data": data, "annotations": [{"result": []}]})
    assert read(tmp_path)[0].name == "x/a.PNG"


def test_the_size_may_stand_beside_the_image(tmp_path):
    bare = vector(vertex(50, 50))
    for key in SIZE:
        del bare[key]
    data = {"image": "a.jpg", "width": 200, "height": 50}
    write(tmp_path, *({"data": data, "annotations": [{"result": result}]} for result in ([], [bare])))
    empty, line = read(tmp_path)
    assert empty.size == line.size == (50, 200)
    assert as_lists(line.polylines) == [[[100, 25]]]


def path_of(*vertices: object, **fields: object) -> dict[str, Any]:
    return task(vector(*vertices, **fields))


def with_label(labels: object) -> dict[str, Any]:
    return task({**STRAIGHT, "value": {**STRAIGHT["value"], "vectorlabels": labels}})


BAD_TASKS = {
    "has no data": 7,
    "has no data, but": {"annotations": []},
    "has no data, but {": {"data": "a.jpg", "annotations": []},
    "has annotations of type dict": task(annotations={"result": []}),
    "has annotations of int, but objects": task(annotations=[1001]),
    "has annotations without a list of results": task(annotations=[{"result": None}]),
    "names no file of an image in its data (image, text)": {**task(), "data": {"image": 7, "text": "a b"}},
    "names no file of an image in its data (image)": task(image="data:image/png;base64,AAAA"),
    "result 1 is a str, but a JSON object": task("line"),
    "result 2 has the labels ['a', 'b'], but": task(
        STRAIGHT, with_label(["a", "b"])["annotations"][0]["result"][0]
    ),
    "result 1 has the labels [7]": with_label([7]),
    "result 1 has the labels lane, but": with_label("lane"),
    "has 0 points, but at least 1": path_of(),
    "has vertices that are no list of objects": path_of([1, 2]),
    "has the coordinate None": path_of({"x": 1}),
    "has the coordinate '1'": path_of(vertex("1", 2)),
    "has the coordinate nan": path_of(vertex(float("nan"), 2)),
    "has a coordinate that is no number of pixels": path_of(vertex(1e308, 2), original_width=1000),
    "has the vertex id 'a', but a different one": path_of(vertex(1, 1, "a"), vertex(2, 2, "a", "a")),
    "has the vertex id [], but": path_of(vertex(1, 1) | {"id": []}),
    "has a vertex after 'c', but that is no other": path_of(vertex(1, 1, "a"), vertex(2, 2, "b", "c")),
    "has a vertex after 'b', but that is no": path_of(vertex(1, 1, "a"), vertex(2, 2, "b", "b")),
    "is closed and branches": task(chain("A", "B<A", "C<A", "D<A", closed=True)),
    "has the controlPoint2 7, but": path_of(vertex(1, 1, isBezier=True, controlPoint2=7)),
    "has the coordinate None, but": path_of(vertex(1, 1, isBezier=True, controlPoint1={"x": 1})),
    "has the score '1', but": task({**STRAIGHT, "score": "1"}),
    "has the score inf, but": task({**STRAIGHT, "score": float("inf")}),
    "rotated by 90 degrees": task({**STRAIGHT, "image_rotation": 90}),
    "has original_height 50 and original_width 0": task({**STRAIGHT, "original_width": 0}),
    "has original_height None and original_width None": task(
        {**STRAIGHT, "original_width": None, "original_height": None}
    ),
    "result 2 states the size (50, 300), but another result states (50, 200)": task(
        STRAIGHT, vector(vertex(1, 1), original_width=300)
    ),
    "has NoneType, but at least 1 points": task({"type": "polyline", "value": {}, **SIZE}),
}


@pytest.mark.parametrize("reason", BAD_TASKS)
def test_a_broken_task_is_named_and_the_others_go_on(tmp_path, reason):
    path = write(tmp_path, task(STRAIGHT), BAD_TASKS[reason], task(STRAIGHT, image="c.jpg"))
    with pytest.raises(LabelError) as caught:
        read(tmp_path)
    assert str(caught.value).startswith(f"{path}, task 2")
    assert reason in str(caught.value)
    dataset = read(tmp_path, skip_broken=True)
    assert [sample.name for sample in dataset] == ["a.jpg", "c.jpg"]
    assert [str(error) for error in dataset.broken] == [str(caught.value)]


BAD_FILES = {
    'is no list of tasks: export the project as "JSON"': "",
    "is no list of tasks": json.dumps(task(STRAIGHT)) + "\n" + json.dumps(task(STRAIGHT)),
    "line 1 is not valid JSON (Expecting value)": "[",
    "line 2 is not valid JSON (Expecting value)": f"[{json.dumps(task())},\n,",
    "line 2 is not valid JSON (expecting , or ])": f"[{json.dumps(task())}\n{{}}]",
    "line 3 is not valid JSON (Expecting property name": "[\n\n{1: 2}]",
    "line 1 is not valid JSON (RecursionError)": "[" * 200_000,
    "line 2 is not valid JSON (ValueError)": "[\n" + "1" * 5000 + "]",
    "line 2 goes on after the list": "[\n] []",
    'has tasks of the keys id, image, label, annotator, as in "JSON-MIN", but its "JSON" is': json.dumps(
        [{"id": 1, "image": "a.jpg", "label": [], "annotator": 1}]
    ),
}


@pytest.mark.parametrize("reason", BAD_FILES)
def test_a_file_that_cannot_be_read_is_named(tmp_path, reason):
    path = write(tmp_path, text=BAD_FILES[reason])
    with pytest.raises(LabelError) as caught:
        read(tmp_path)
    assert str(caught.value).startswith(str(path))
    assert reason in str(caught.value)


def test_a_mark_of_the_byte_order_does_no_harm(tmp_path):
    write(tmp_path, text="\ufeff" + json.dumps([task(STRAIGHT)]))
    assert len(read(tmp_path)) == 1


def sample(name: str = "a.jpg", **fields: object) -> Sample:
    lines = Polylines.from_list([[[1.0, 2.0], [3.0, 4.0]]])
    return Sample(**{"name": name, "image": Path(name), "polylines": lines, "size": (50, 200), **fields})


LINES = Polylines.from_list([[[100, 50], [25, 0]], [[0, 0]]], scores=[1.0, 0.25], labels=[1, 0])


def test_what_is_written_are_tasks_and_their_tools(tmp_path):
    region = np.array([[0.0, 0], [200, 0], [100, 25]])
    with LabelStudioWriter(tmp_path, classes=["solid", 'a "b" & c']) as writer:
        writer.add(sample("x y/a.jpg", polylines=LINES, ignore=[region]))
        writer.add(sample("b.jpg", polylines=Polylines.from_list([])))
    first, second = json.loads((tmp_path / "tasks.json").read_text())
    assert first["data"] == {"image": "/data/local-files/?d=x%20y/a.jpg", "width": 200, "height": 50}
    shape = {"from_name": "line", "to_name": "image", "type": "vectorlabels", **SIZE}
    assert first["annotations"][0]["result"] == [
        {
            **shape,
            "id": "0-0",
            "value": {
                "vertices": [
                    {"id": "0", "x": 50.0, "y": 100.0, "prevPointId": None, "isBezier": False},
                    {"id": "1", "x": 12.5, "y": 0.0, "prevPointId": "0", "isBezier": False},
                ],
                "closed": False,
                "vectorlabels": ['a "b" & c'],
            },
        },
        {
            **shape,
            "id": "0-1",
            "score": 0.25,
            "value": {
                "vertices": [{"id": "0", "x": 0.0, "y": 0.0, "prevPointId": None, "isBezier": False}],
                "closed": False,
                "vectorlabels": ["solid"],
            },
        },
        {**REGION, "id": "0-2", "from_name": "region", "to_name": "image"},
    ]
    assert second["annotations"] == [{"result": []}]
    root = ET.parse(tmp_path / "labeling_config.txt").getroot()
    assert [(tool.tag, tool.get("name"), tool.get("toName")) for tool in root] == [
        ("Image", "image", None),
        ("VectorLabels", "line", "image"),
        ("PolygonLabels", "region", "image"),
    ]
    assert [label.get("value") for label in root.iter("Label")] == ["solid", 'a "b" & c', "ignore"]


def test_predictions_are_written_for_a_person_to_correct(tmp_path):
    with LabelStudioWriter(tmp_path, classes=["a", "b"], prelabel=True, prefix="http://me/") as writer:
        writer.add(sample("x/a.jpg", polylines=LINES))
        writer.add(sample("b.jpg", polylines=Polylines.from_list([])))
    first, second = json.loads((tmp_path / "tasks.json").read_text())
    assert first["data"]["image"] == "http://me/x/a.jpg"
    assert "annotations" not in first
    (prediction,) = first["predictions"]
    assert (prediction["model_version"], prediction["score"]) == ("yolino", 0.625)
    assert [result["score"] for result in prediction["result"]] == [1.0, 0.25]
    assert second["predictions"] == [{"result": [], "model_version": "yolino"}]
    with pytest.raises(LabelError, match="has 2 tasks, but none with annotations"):
        read(tmp_path)
    back = read(tmp_path, predictions=True)
    assert [one.name for one in back] == ["x/a.jpg", "b.jpg"]
    assert as_lists(back[0].polylines) == as_lists(LINES)
    assert back[0].polylines.scores.tolist() == [1, 0.25]


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        (sample(size=None), r"The size of a\.jpg is unknown"),
        (sample(polylines=Polylines.from_list([[[np.nan, 0]]])), r"a\.jpg has a line without vertices or"),
        (
            sample(polylines=Polylines.from_list([[[1e308, 0]]]), size=(9, 9)),
            r"a\.jpg has a line without vertices or",
        ),
        (sample(polylines=Polylines.from_list([np.zeros((0, 2))])), r"a\.jpg has a line without vertices or"),
        (sample(ignore=[np.array([[np.inf, 0.0]])]), r"a\.jpg has a line without vertices or"),
        (sample(polylines=Polylines.from_list([[[0, 0]]], [np.nan])), r"a\.jpg has a score"),
    ],
)
def test_what_the_format_cannot_hold_is_named(tmp_path, wrong, reason):
    with pytest.raises(ValueError, match=reason):
        LabelStudioWriter(tmp_path).add(wrong)


def test_without_images_the_files_are_valid(tmp_path):
    LabelStudioWriter(tmp_path / "new").close()
    dataset = read(tmp_path / "new")
    assert len(dataset) == 0
    assert dataset.classes == ("line",)


floats = st.floats(-1e5, 1e5)
vertices = st.lists(st.tuples(floats, floats), min_size=1, max_size=5)
drawn = st.lists(st.tuples(vertices, st.floats(0, 1), st.integers(0, 2)), max_size=3)
folders = itertools.count()


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.tuples(drawn, st.lists(vertices, max_size=2)), min_size=1, max_size=3),
    st.lists(st.text(st.characters(codec="utf-8"), max_size=8), min_size=3, max_size=3, unique=True),
    st.booleans(),
)
def test_writing_and_reading_is_the_identity_up_to_1e_9(tmp_path_factory, images, classes, prelabel):
    root = tmp_path_factory.getbasetemp() / f"labelstudio{next(folders)}"
    samples = []
    for i, (found, regions) in enumerate(images):
        lines, values, labels = ([one[k] for one in found] for k in range(3))
        polylines = Polylines.from_list([np.array(line) for line in lines], values, labels)
        name = f"é+&?d=%20 #/{i}/a.jpg"
        samples.append(Sample(name, Path(), polylines, [np.array(r) for r in regions], (7 + i, 9)))
    with LabelStudioWriter(root, classes=classes, prelabel=prelabel) as writer:
        for one in samples:
            writer.add(one)
    dataset = read(root, predictions=prelabel)
    for one, back in zip(samples, dataset, strict=True):
        assert (back.name, back.size) == (one.name, one.size)
        assert back.polylines.offsets.tolist() == one.polylines.offsets.tolist()
        assert np.allclose(back.polylines.vertices, one.polylines.vertices, rtol=1e-9, atol=1e-300)
        assert back.polylines.scores.tolist() == one.polylines.scores.tolist()
        names = [dataset.classes[i] for i in back.polylines.labels]
        assert names == [classes[i] for i in one.polylines.labels]
        for region, other in zip(one.ignore, back.ignore, strict=True):
            assert np.allclose(region, other, rtol=1e-9, atol=1e-300)
