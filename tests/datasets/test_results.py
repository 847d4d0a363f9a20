from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.datasets.annotation import LabelError
from yolino.datasets.results import Results, ResultsWriter
from yolino.io import Result, read_result, to_json
from yolino.types import Polylines, Sample

DOCUMENT = {
    "image": "clips/a.jpg",
    "size": [72, 128],
    "polylines": [
        {"points": [[10.5, 70.0], [22.25, 65]], "score": 0.91, "label": 1},
        {"points": [[1, 2]], "score": 1, "label": 0},
    ],
    "classes": ["solid", "dashed"],
    "model": "default",
    "version": "0.1.0",
}


def changed(**fields: object) -> dict[str, object]:
    return {**DOCUMENT, **fields}


def write(path: Path, document: object = DOCUMENT) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(document if isinstance(document, str) else json.dumps(document))
    return path


def touch(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"an image")
    return path


def read(root: Path, **options: object) -> Results:
    return Results(root, **{"require_images": False, **options})


def as_lists(polylines: Polylines) -> list[list[list[float]]]:
    return [p.tolist() for p in polylines]


def test_a_result_is_a_sample(tmp_path):
    write(tmp_path / "a.json")
    dataset = read(tmp_path)
    (sample,) = dataset
    assert dataset.classes == ("solid", "dashed")
    assert (sample.name, sample.size, sample.ignore) == ("clips/a.jpg", (72, 128), ())
    assert as_lists(sample.polylines) == [[[10.5, 70.0], [22.25, 65.0]], [[1.0, 2.0]]]
    assert sample.polylines.scores.tolist() == [0.91, 1.0]
    assert sample.polylines.labels.tolist() == [1, 0]


def test_classes_are_those_of_the_models_even_where_none_occurs(tmp_path):
    write(tmp_path / "a.json", changed(polylines=[]))
    write(tmp_path / "b.json", changed(classes=["curb", "solid"]))
    assert read(tmp_path).classes == ("solid", "dashed", "curb")
    assert read(tmp_path, classes=["solid"])[1].polylines.labels.tolist() == [0]


def test_a_model_without_classes_has_one(tmp_path):
    document = changed(classes=[], polylines=[{"points": [[1, 2], [3, 4]], "score": 0.5, "label": 0}])
    write(tmp_path / "a.json", document)
    assert read(tmp_path).classes == ("line",)


def test_what_predict_writes_is_read(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    touch(tmp_path / "photos/x/1.png")
    touch(tmp_path / "out/1.png")  # the lines, drawn
    lines = Polylines.from_list([[[1.0, 2], [3, 4]]], [0.5])
    write(tmp_path / "out/1.json", to_json(Result("photos/x/1.png", (7, 9), lines)))
    sample = Results("out")[0]
    assert (sample.name, sample.image) == ("photos/x/1.png", Path("photos/x/1.png"))
    below = Results(tmp_path / "photos", tmp_path / "out")[0]
    assert (below.name, below.image) == ("x/1.png", tmp_path / "photos/x/1.png")
    write(tmp_path / "out/1.json", to_json(Result(f"{tmp_path}/photos/x/1.png", (7, 9), lines)))
    assert Results("out")[0].image == tmp_path / "photos/x/1.png"
    assert Results(tmp_path / "photos", tmp_path / "out")[0].name == "x/1.png"


def test_images_are_found_by_the_end_of_their_path(tmp_path):
    for name in ("a/1.jpg", "b/1.jpg", "1.jpg", "images/c/2.jpg"):
        touch(tmp_path / name)
    for i, name in enumerate(["/home/me/data/b/1.jpg", "..\\data\\a\\1.jpg", "x/1.jpg", "/data/c/2.jpg"]):
        write(tmp_path / f"results/{i}.json", changed(image=name))
    assert [one.name for one in Results(tmp_path)] == ["b/1.jpg", "a/1.jpg", "1.jpg", "images/c/2.jpg"]
    found = Results(tmp_path, images="a", require_images=False)
    assert [str(one.image.relative_to(tmp_path)) for one in found][1:3] == ["a/1.jpg", "a/1.jpg"]


def test_a_missing_image_is_named(tmp_path):
    write(tmp_path / "a.json")
    with pytest.raises(FileNotFoundError, match=r"a\.json names the image .*clips/a\.jpg, which does not"):
        Results(tmp_path)


BAD = {
    "(Expecting value: line 1 column 1 (char 0))": "",
    "(Expecting property name": "{image: 1}",
    "is not a result of yolino (it does not have the form of a result": [1, 2],
    "(it does not have": 7,
    "(the key 'polylines' is missing)": {"image": "a.jpg"},
    "(the key 'size' is missing)": {"image": "a.jpg", "polylines": []},
    "(the key 'score' is missing)": changed(polylines=[{"points": [[1, 2]], "label": 0}]),
    "(not enough values": changed(size=[7]),
    "has the size 0 x 5, but positive": changed(size=[0, 5]),
    "names no image": changed(image=""),
    "a polyline has shape (1, 3)": changed(polylines=[{"points": [[1, 2, 3]], "score": 1, "label": 0}]),
    "points or scores that are not finite": changed(
        polylines=[{"points": [[1, float("nan")]], "score": 1, "label": 0}]
    ),
    "scores that are not finite": changed(
        polylines=[{"points": [[1, 2]], "score": float("inf"), "label": 0}]
    ),
    "has labels that are no index of its 2 classes": changed(
        polylines=[{"points": [[1, 2]], "score": 1, "label": 2}]
    ),
    "has labels that are no index of its 1 classes": changed(
        classes=[], polylines=[{"points": [[1, 2]], "score": 1, "label": -1}]
    ),
    "is not a result of yolino (int too large": changed(
        polylines=[{"points": [[1, 10**400]], "score": 1, "label": 0}]
    ),
    "is not a result of yolino (maximum recursion": "[" * 200_000,
}


@pytest.mark.parametrize("reason", BAD)
def test_a_file_that_is_no_result_is_named(tmp_path, reason):
    path = write(tmp_path / "b.json", BAD[reason])
    write(tmp_path / "a.json")
    with pytest.raises(LabelError) as caught:
        read(tmp_path)
    assert str(caught.value).startswith(f"{path} ")
    assert reason in str(caught.value)
    dataset = read(tmp_path, skip_broken=True)
    assert [len(dataset), len(dataset.broken)] == [1, 1]


def test_bytes_that_are_no_text_are_named(tmp_path):
    (tmp_path / "a.json").write_bytes(b"\xff{}")
    with pytest.raises(LabelError, match=r"a\.json cannot be read \(it is no text in UTF-8\)"):
        read(tmp_path)


def sample(name: str = "a.jpg", **fields: object) -> Sample:
    lines = Polylines.from_list([[[1.0, 2.0], [3.0, 4.0]]])
    return Sample(**{"name": name, "image": Path(name), "polylines": lines, "size": (10, 20), **fields})


def test_what_is_written_is_a_result(tmp_path):
    with ResultsWriter(tmp_path, classes=["solid"], model="mine") as writer:
        writer.add(sample("clips/a.b.jpg"))
    result = read_result(tmp_path / "clips/a.b.json")
    assert (result.image, result.size, result.classes, result.model) == (
        "clips/a.b.jpg",
        (10, 20),
        ("solid",),
        "mine",
    )
    assert as_lists(result.polylines) == [[[1, 2], [3, 4]]]


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        (sample(size=None), r"The size of a\.jpg is unknown"),
        (sample(polylines=Polylines.from_list([[[np.nan, 0]]])), r"a\.jpg has a vertex that is not finite"),
        (sample(polylines=Polylines.from_list([[[0, 0]]], [np.inf])), r"a\.jpg have points or scores"),
        (sample("../a.jpg"), r"\.\./a\.jpg leads out of the folder"),
    ],
)
def test_what_the_format_cannot_hold_is_named(tmp_path, wrong, reason):
    with pytest.raises(ValueError, match=reason):
        ResultsWriter(tmp_path / "out").add(wrong)
    assert list(tmp_path.iterdir()) == []


def test_no_result_replaces_another(tmp_path):
    writer = ResultsWriter(tmp_path)
    writer.add(sample("a.jpg"))
    with pytest.raises(ValueError, match=r"a\.png and a\.jpg would both be"):
        writer.add(sample("a.png"))


hundredths = st.integers(-(10**7), 10**7).map(lambda i: round(i / 100, 2))
vertices = st.lists(st.tuples(hundredths, hundredths), min_size=1, max_size=5)
scores = st.integers(0, 10_000).map(lambda i: round(i / 10_000, 4))
found_lines = st.lists(st.tuples(vertices, scores, st.integers(0, 1)), max_size=3)
folders = itertools.count()


@settings(deadline=None, max_examples=60)
@given(
    st.lists(found_lines, min_size=1, max_size=3),
    st.lists(st.text(max_size=8), min_size=2, max_size=2, unique=True),
)
def test_writing_and_reading_is_the_identity_up_to_the_rounding(tmp_path_factory, images, classes):
    root = tmp_path_factory.getbasetemp() / f"results{next(folders)}"
    samples = []
    for i, found in enumerate(images):
        lines, values, labels = ([one[k] for one in found] for k in range(3))
        polylines = Polylines.from_list([np.array(line) for line in lines], values, labels)
        samples.append(Sample(f"é & 1/{i}/a.jpg", Path(), polylines, (), (7 + i, 9)))
    with ResultsWriter(root, classes=classes) as writer:
        for one in samples:
            writer.add(one)
    dataset = read(root)
    assert dataset.classes == tuple(classes)
    for one, back in zip(samples, dataset, strict=True):
        assert (back.name, back.size) == (one.name, one.size)
        assert as_lists(back.polylines) == as_lists(one.polylines)
        assert back.polylines.scores.tolist() == one.polylines.scores.tolist()
        assert back.polylines.labels.tolist() == one.polylines.labels.tolist()
