from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.datasets.annotation import LabelError
from yolino.datasets.curvelanes import CurveLanes, CurveLanesWriter
from yolino.types import Polylines, Sample

POINTS = [{"y": "1439.0", "x": "2079.41"}, {"y": "1438.08", "x": "-2078.19"}]


def write(root: Path, name: str, document: object) -> Path:
    """Writes `train/labels/a.lines.json` for the image `train/images/a`."""
    image = root / f"{name}.jpg"
    image.parent.mkdir(parents=True, exist_ok=True)
    image.write_bytes(b"an image")
    path = root / f"{name.replace('images', 'labels')}.lines.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    if isinstance(document, bytes):
        path.write_bytes(document)
    else:
        path.write_text(json.dumps(document))
    return path


def as_lists(polylines: Polylines) -> list[list[list[float]]]:
    return [p.tolist() for p in polylines]


@pytest.fixture
def root(tmp_path: Path) -> Path:
    write(tmp_path, "train/images/b", {"Lines": [POINTS, [{"x": 1, "y": 2.5, "z": None}]], "other": [1]})
    write(tmp_path, "train/images/a", {"Lines": []})
    write(tmp_path, "valid/images/c", {"Lines": [POINTS]})
    (tmp_path / "train/train.txt").write_text("images/b.jpg\nimages/a.jpg\n")
    return tmp_path


def test_strings_count_pixels_and_lanes_keep_their_direction(root):
    dataset = CurveLanes(root)
    names = ["train/images/a.jpg", "train/images/b.jpg", "valid/images/c.jpg"]
    assert [s.name for s in dataset] == names
    assert [s.image for s in dataset] == [root / name for name in names]
    assert [len(s.polylines) for s in dataset] == [0, 2, 1]
    sample = dataset[1]
    first, second = as_lists(sample.polylines)
    np.testing.assert_allclose(first, [[2079.91, 1439.5], [-2077.69, 1438.58]], rtol=1e-15)
    assert second == [[1.5, 3.0]]
    assert sample.size is None
    assert dataset.classes == ("lane",)


def test_the_lists_of_the_benchmark_choose_the_images(root):
    names = ["train/images/b.jpg", "train/images/a.jpg"]
    assert [s.name for s in CurveLanes(root, names="train/train.txt")] == names
    assert [s.name for s in CurveLanes(root, "train/train.txt")] == names
    inside = CurveLanes(root / "train", names="train.txt")
    assert [s.name for s in inside] == ["images/b.jpg", "images/a.jpg"]


def test_a_listed_image_without_labels_names_list_and_line(root):
    (root / "train/train.txt").write_text("images/b.jpg\nimages/d.jpg\n")
    with pytest.raises(LabelError, match=r"train\.txt, line 2 lists images/d\.jpg, which has no label file"):
        CurveLanes(root, names="train/train.txt")
    assert len(CurveLanes(root, names="train/train.txt", skip_broken=True)) == 1


def test_the_last_folder_called_images_or_labels_counts(tmp_path):
    assert CurveLanes.label_name("/images/images/x/a.b.jpg") == "images/labels/x/a.b.lines.json"
    assert CurveLanes.image_name("labels/labels/x/a.b.lines.json") == "labels/images/x/a.b"
    assert CurveLanes.label_name("clips/images.jpg") == "clips/images.lines.json"
    assert CurveLanes.image_name("labels.lines.json") == "labels"


def point(x: object, y: object = "1") -> dict[str, object]:
    return {"x": x, "y": y}


BAD = {
    "is not valid JSON": b"",
    "is not valid JSON (UnicodeDecodeError)": b'"\xff"',
    "is not valid JSON (RecursionError)": b"[" * 200_000,
    "has no list of lanes": [1],
    'has no list of lanes, but {"Lines": [...]} is needed': {"lines": []},
    "has no list of lanes, but": {"Lines": {}},
    ", lane 1 has no points": {"Lines": [POINTS, []]},
    ", lane 0 has no points": {"Lines": [7]},
    ", lane 0 has the point [1, 2]": {"Lines": [[[1, 2]]]},
    ", lane 0 has the point {'x': 1}": {"Lines": [[{"x": 1}]]},
    ", lane 0 has the coordinate 'one'": {"Lines": [[point("one")]]},
    ", lane 0 has the coordinate ''": {"Lines": [[point(1, "")]]},
    ", lane 0 has the coordinate 'nan'": {"Lines": [[*POINTS, point("nan")]]},
    ", lane 0 has the coordinate inf": b'{"Lines": [[{"x": Infinity, "y": 1}]]}',
    ", lane 0 has the coordinate True": {"Lines": [[point(True)]]},
    ", lane 0 has the coordinate None": {"Lines": [[point(None)]]},
    ", lane 0 has the coordinate ['1']": {"Lines": [[point(["1"])]]},
    ", lane 0 has the coordinate 1000": {"Lines": [[point(10**400)]]},
}


@pytest.mark.parametrize("reason", BAD)
def test_a_broken_file_is_named_and_the_rest_goes_on(root, reason):
    path = write(root, "train/images/bad", BAD[reason])
    with pytest.raises(LabelError) as caught:
        CurveLanes(root)
    assert str(caught.value).startswith(str(path))
    assert reason in str(caught.value)
    dataset = CurveLanes(root, skip_broken=True)
    assert len(dataset) == 3
    assert len(dataset.broken) == 1


def sample_of(name: str, *lines: object) -> Sample:
    return Sample(name, Path(name), Polylines.from_list(lines))


def test_lanes_are_written_as_the_benchmark_does(tmp_path):
    with CurveLanesWriter(tmp_path) as writer:
        writer.add(sample_of("train/images/b.jpg", [[2079.91, 1439.5], [-2077.69, 1438.58]]))
        writer.add(sample_of("c.jpg"))
    assert json.loads((tmp_path / "train/labels/b.lines.json").read_text()) == {"Lines": [POINTS]}
    assert json.loads((tmp_path / "c.lines.json").read_text()) == {"Lines": []}


def test_no_labels_are_overwritten_or_not_finite(tmp_path):
    writer = CurveLanesWriter(tmp_path)
    writer.add(sample_of("images/a.jpg"))
    with pytest.raises(ValueError, match=r"labels of labels/a\.png and images/a\.jpg would both be"):
        writer.add(sample_of("labels/a.png"))
    with pytest.raises(ValueError, match=r"b\.jpg has a vertex that is not finite"):
        writer.add(sample_of("b.jpg", [[np.inf, 1]]))


COORDINATES = st.floats(-1e5, 1e5)
LINES = st.lists(st.lists(st.tuples(COORDINATES, COORDINATES), min_size=1, max_size=4), max_size=4)


@settings(deadline=None, max_examples=25)
@given(st.lists(LINES, min_size=1, max_size=3), st.sampled_from(["images/{}.jpg", "x/{0}/{0}.jpg", "{}.png"]))
def test_reading_what_was_written_is_the_identity(tmp_path_factory, images, form):
    root = tmp_path_factory.mktemp("written")
    names = [form.format(i) for i in range(len(images))]
    with CurveLanesWriter(root) as writer:
        for name, lines in zip(names, images, strict=True):
            writer.add(sample_of(name, *lines))
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_bytes(b"an image")
    dataset = CurveLanes(root)
    assert [s.name for s in dataset] == names
    for sample, lines in zip(dataset, images, strict=True):
        expected = Polylines.from_list(lines)
        assert sample.polylines.offsets.tolist() == expected.offsets.tolist()
        np.testing.assert_allclose(sample.polylines.vertices, expected.vertices, rtol=1e-15, atol=1e-15)
