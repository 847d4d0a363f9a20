from __future__ import annotations

import itertools
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.datasets.annotation import LabelError
from yolino.datasets.cvat import CVAT, CVATWriter
from yolino.types import Polylines, Sample

META = """<version>1.1</version>
  <meta><task><id>4</id><name>roads</name><size>3</size><mode>annotation</mode>
    <labels>
      <label><name>solid</name><color>#ff0000</color><type>polyline</type>
        <attributes><attribute><name>score</name><input_type>number</input_type></attribute></attributes></label>
      <label><name>curb</name><type>polyline</type><attributes></attributes></label>
      <label><name>car</name><type>rectangle</type><attributes></attributes></label>
      <label><name>dashed</name><type>any</type><attributes></attributes></label>
      <label><name>ignore</name><type>polygon</type><attributes></attributes></label>
    </labels><owner><username>a</username></owner></task><dumped>2024-01-01</dumped></meta>"""
IMAGES = """
  <image id="0" name="clips/a.jpg" width="1600" height="1200">
    <polyline label="dashed" source="manual" occluded="0" points="462.10,0.00;126.80,1200.00" z_order="3">
    </polyline>
    <box label="car" occluded="0" xtl="1" ytl="2" xbr="3" ybr="4" z_order="0"></box>
    <polyline label="solid" occluded="1" points="0,0;1.5,-2.25;1e1,+3" z_order="0">
      <attribute name="color">yellow</attribute>
      <attribute name="score">0.75</attribute>
      <attribute name="quality">good</attribute>
    </polyline>
    <polygon label="ignore" occluded="0" points="1,2;3,4;5,6.5" z_order="0"></polygon>
    <polygon label="car" occluded="0" points="nothing to read" z_order="0"></polygon>
    <points label="car" occluded="0" points="1,2" z_order="0"></points>
    <mask label="car" rle="1, 2" left="1" top="1" width="2" height="2"></mask>
    <skeleton label="car"><points label="head" points="1,2"></points></skeleton>
    <tag label="rain" source="manual"></tag>
  </image>
  <image id="1" name="clips/b.jpg" width="640" height="480">
  </image>
"""


def xml(images: str = IMAGES, meta: str = META) -> str:
    return f'<?xml version="1.0" encoding="utf-8"?>\n<annotations>\n  {meta}{images}</annotations>\n'


def write(root: Path, text: str | bytes, name: str = "annotations.xml") -> Path:
    path = root / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def read(root: Path, **options: object) -> CVAT:
    return CVAT(root, **{"require_images": False, **options})


def as_lists(polylines: Polylines) -> list[list[list[float]]]:
    return [p.tolist() for p in polylines]


def test_polylines_stay_where_they_are_on_the_canvas(tmp_path):
    write(tmp_path, xml())
    dataset = read(tmp_path)
    first, second = dataset
    assert first.name == "clips/a.jpg"
    assert first.image == tmp_path / "clips/a.jpg"
    assert first.size == (1200, 1600)
    assert as_lists(first.polylines) == [
        [[462.1, 0.0], [126.8, 1200.0]],
        [[0.0, 0.0], [1.5, -2.25], [10.0, 3.0]],
    ]
    assert [dataset.classes[i] for i in first.polylines.labels] == ["dashed", "solid"]
    assert first.polylines.scores.tolist() == [1.0, 0.75]
    assert [region.tolist() for region in first.ignore] == [[[1, 2], [3, 4], [5, 6.5]]]
    assert (second.name, len(second.polylines), second.ignore, second.size) == (
        "clips/b.jpg",
        0,
        (),
        (480, 640),
    )


def test_classes_are_in_the_order_of_the_task_and_others_follow(tmp_path):
    images = '<image name="a"><polyline label="b" points="1,1"/><polyline label="a" points="1,1"/></image>'
    write(tmp_path, xml(IMAGES + images))
    # curb is meant for polylines but does not occur, car is not, ignore is no class.
    assert read(tmp_path).classes == ("solid", "curb", "dashed", "a", "b")
    assert read(tmp_path, classes=["b", "dashed"])[2].polylines.labels.tolist() == [0]
    mapped = read(tmp_path, classes={"dashed": "line", "solid": "line"})
    assert mapped.classes == ("line",)
    assert mapped.left_out == {"a": 1, "b": 1}


def test_the_labels_of_projects_and_jobs_count_too(tmp_path):
    labels = (
        "<labels><label><name>z</name><type>polyline</type></label><label><name>y</name></label></labels>"
    )
    images = '<image name="a.png"><polyline label="y" points="1,1;2,2"/></image>'
    for kind in ("project", "job"):
        labels_of_it = f"<id>1</id><labels>{labels}</labels><tasks><task><name>t</name></task></tasks>"
        meta = f"<meta><{kind}>{labels_of_it}</{kind}></meta>"
        write(tmp_path, xml(images, meta))
        assert read(tmp_path).classes == ("z", "y")


def test_without_a_list_of_labels_the_names_are_sorted(tmp_path):
    write(tmp_path, xml(meta=""))
    assert read(tmp_path).classes == ("dashed", "solid")


def test_other_polygons_can_be_ignored(tmp_path):
    write(tmp_path, xml(IMAGES.replace("nothing to read", "7,7;8,8;9,7")))
    assert [len(read(tmp_path, ignore=names)[0].ignore) for names in ([], ["car"], ["car", "ignore"])] == [
        0,
        1,
        2,
    ]


def test_images_are_found_where_cvat_exports_them(tmp_path):
    images = [("x/a.jpg", 'subset="train"'), ("b.png", 'subset="default"'), ("frame_000000", "")]
    write(tmp_path, xml("".join(f'<image name="{name}" {subset}></image>' for name, subset in images)))
    found = ["images/train/x/a.jpg", "images/b.png", "images/frame_000000.PNG"]
    for name in found:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(b"")
    assert [sample.name for sample in CVAT(tmp_path)] == found


def test_names_of_windows_become_paths(tmp_path):
    write(tmp_path, xml('<image name="x\\y\\a.jpg"></image>'))
    assert read(tmp_path)[0].name == "x/y/a.jpg"


def test_annotations_come_first_then_any_xml(tmp_path):
    write(tmp_path, xml('<image name="a.jpg"></image>'), "task1.xml")
    write(tmp_path, xml('<image name="b.jpg"></image>'), "task2.xml")
    assert [sample.name for sample in read(tmp_path)] == ["a.jpg", "b.jpg"]
    write(tmp_path, xml('<image name="c.jpg"></image>'))
    assert [sample.name for sample in read(tmp_path)] == ["c.jpg"]
    assert [sample.name for sample in read(tmp_path, labels="task2.xml")] == ["b.jpg"]


def test_a_missing_size_is_unknown_and_a_missing_score_is_1(tmp_path):
    images = (
        '<image name="a.jpg"><polyline label="l" points="1,1"><attribute name="score"/></polyline></image>'
    )
    write(tmp_path, xml(images))
    sample = read(tmp_path)[0]
    assert sample.size is None
    assert sample.polylines.scores.tolist() == [1.0]
    assert as_lists(sample.polylines) == [[[1.0, 1.0]]]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_the_declared_encoding_counts(tmp_path, encoding):
    declared = encoding.removesuffix("-sig")
    text = (
        f'<?xml version="1.0" encoding="{declared}"?><annotations><image name="stra\xdfe.jpg"/></annotations>'
    )
    write(tmp_path, text.encode(encoding))
    assert read(tmp_path)[0].name == "stra\xdfe.jpg"


def shape(points: str = "1,1;2,2", *, label: str = 'label="l"', score: str = "") -> str:
    inside = f'<attribute name="score">{score}</attribute>' if score else ""
    return f'<image name="c.jpg">\n<polyline {label} points="{points}">{inside}</polyline>\n</image>'


BAD_IMAGES = {
    "c.jpg, line 3 has the point '', but x,y": shape(""),
    "c.jpg, line 3 has the point '1', but x,y": shape("1;2"),
    "c.jpg, line 3 has the point '1,2,3', but x,y": shape("0,0;1,2,3"),
    "c.jpg, line 3 has the point 'a,b', but x,y": shape("0,0;a,b"),
    "c.jpg, line 3 has the point '', but x": shape("0,0;1,2;"),
    "c.jpg, line 3 has a coordinate that is not finite": shape("0,0;1,nan"),
    "line 3 has a coordinate that is not finite": shape("0,0;1,1e999"),
    "line 3 has a polyline without a label": shape(label=""),
    "line 3 has the score 'good', but a finite number": shape(score="good"),
    "line 3 has the score 'inf', but a finite number": shape(score="inf"),
    "line 2 has an image without a name": '<image id="3"></image>',
    "c.jpg, line 2 has width '0' and height '5'": '<image name="c.jpg" width="0" height="5"></image>',
    "c.jpg, line 2 has width '7' and height ''": '<image name="c.jpg" width="7"></image>',
    "c.jpg, line 2 has width '1.5' and": '<image name="c.jpg" width="1.5" height="5"></image>',
}


@pytest.mark.parametrize("reason", BAD_IMAGES)
def test_a_broken_image_is_named_and_the_others_go_on(tmp_path, reason):
    last = '<image name="d.jpg"><polyline label="l" points="1,1"/></image>'
    path = write(tmp_path, f"<annotations>\n{BAD_IMAGES[reason]}{last}</annotations>")
    with pytest.raises(LabelError, match=f"{path}, ") as caught:
        read(tmp_path)
    assert reason in str(caught.value)
    dataset = read(tmp_path, skip_broken=True)
    assert [sample.name for sample in dataset] == ["d.jpg"]
    assert [str(error) for error in dataset.broken] == [str(caught.value)]


def test_only_the_first_fault_of_an_image_is_named(tmp_path):
    write(tmp_path, f"<annotations>{shape('1').replace('</image>', '')}<polyline/></image></annotations>")
    assert len(read(tmp_path, skip_broken=True).broken) == 1


BAD_FILES = {
    "line 1 is not valid XML (no element found)": "",
    "line 2 is not valid XML (no element found)": "<annotations>\n",
    "line 3 is not valid XML (mismatched tag)": "<annotations>\n<image name='a'>\n</annotations>",
    "line 1 is not valid XML (not well-formed (invalid token))": '{"a": 1}',
    "line 1 begins with <html>, but <annotations>": "<html></html>",
    'line 2 has a <track> of "CVAT for video": export the task as "CVAT for images 1.1"': (
        '<annotations>\n<track id="0" label="l"><polyline frame="0" points="1,1"/></track></annotations>'
    ),
    "line 1 is not valid XML (undefined entity)": "<annotations>&lines;</annotations>",
    "line 1 cannot be decoded (unknown encoding: no-such): save it as UTF-8": (
        b'<?xml version="1.0" encoding="no-such"?><annotations/>'
    ),
    "line 1 is not valid XML (not well-formed": b"<annotations>\xff</annotations>",
    "line 1 cannot be decoded": b'<?xml version="1.0" encoding="big5"?><annotations/>',
}


@pytest.mark.parametrize("reason", BAD_FILES)
def test_a_file_that_cannot_be_read_is_named_with_the_line(tmp_path, reason):
    path = write(tmp_path, BAD_FILES[reason])
    with pytest.raises(LabelError) as caught:
        read(tmp_path)
    assert str(caught.value).startswith(f"{path}, ")
    assert reason in str(caught.value)


def test_images_before_the_broken_place_are_kept_on_demand(tmp_path):
    write(tmp_path, xml()[:-10])
    dataset = read(tmp_path, skip_broken=True)
    assert [sample.name for sample in dataset] == ["clips/a.jpg", "clips/b.jpg"]
    assert dataset.classes == ("solid", "curb", "dashed")
    assert len(dataset.broken) == 1


LAUGHS = (
    '<!DOCTYPE a [<!ENTITY a "ha"><!ENTITY b "&a;&a;"><!ENTITY c "&b;&b;">]><annotations>&c;</annotations>'
)
OUTSIDE = '<!DOCTYPE a [<!ENTITY a SYSTEM "file:///etc/hostname">]><annotations>&a;</annotations>'
DTD = '<!DOCTYPE annotations SYSTEM "http://localhost/cvat.dtd"><annotations></annotations>'


@pytest.mark.parametrize("text", [LAUGHS, OUTSIDE, DTD])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_entities_are_refused_before_they_are_looked_at(tmp_path, text, encoding):
    path = write(tmp_path, text.encode(encoding))
    with pytest.raises(LabelError, match=f"{path}, line 1 declares a document type"):
        read(tmp_path)


def test_billions_of_laughs_take_no_time(tmp_path):
    entities = [f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 12)]
    head = '<?xml version="1.0"?>\n<!DOCTYPE a [\n<!ENTITY e0 "ha">\n' + "\n".join(entities) + "\n]>"
    write(tmp_path, f'{head}<annotations><image name="&e11;"/></annotations>')
    with pytest.raises(LabelError, match="line 2 declares a document type"):
        read(tmp_path)


def sample(name: str = "a.jpg", **fields: object) -> Sample:
    lines = Polylines.from_list([[[1.0, 2.0], [3.0, 4.0]]])
    return Sample(**{"name": name, "image": Path(name), "polylines": lines, "size": (10, 20), **fields})


def test_what_is_written_is_a_task_of_cvat(tmp_path):
    lines = Polylines.from_list([[[0.5, 1 / 3], [2, 3]], [[1, 1]]], scores=[1.0, 0.25], labels=[1, 0])
    with CVATWriter(tmp_path, classes=["solid", "dashed"]) as writer:
        writer.add(sample("b/a.jpg", polylines=lines, ignore=[np.array([[1.0, 1], [2, 2], [3, 1]])]))
        writer.add(sample("c.jpg", polylines=Polylines.from_list([])))
    root = ET.parse(tmp_path / "annotations.xml").getroot()
    assert root.findtext("version") == "1.1"
    assert root.findtext("meta/task/size") == "2"
    assert root.findtext("meta/task/mode") == "annotation"
    labels = root.findall("meta/task/labels/label")
    assert [(label.findtext("name"), label.findtext("type")) for label in labels] == [
        ("solid", "polyline"),
        ("dashed", "polyline"),
        ("ignore", "polygon"),
    ]
    assert [image.attrib for image in root.findall("image")] == [
        {"id": "0", "name": "b/a.jpg", "width": "20", "height": "10"},
        {"id": "1", "name": "c.jpg", "width": "20", "height": "10"},
    ]
    first, second, region = root.find("image") or ()
    assert (first.tag, second.tag, region.tag) == ("polyline", "polyline", "polygon")
    assert first.attrib == {
        "label": "dashed",
        "occluded": "0",
        "points": "0.5,0.3333333333333333;2.0,3.0",
        "z_order": "0",
    }
    assert [(a.attrib, a.text) for a in second] == [({"name": "score"}, "0.25")]
    assert len(first) == 0
    assert (region.get("label"), region.get("points")) == ("ignore", "1.0,1.0;2.0,2.0;3.0,1.0")


def test_without_classes_and_images_the_file_is_valid(tmp_path):
    CVATWriter(tmp_path / "new", file="labels.xml").close()
    dataset = read(tmp_path / "new")
    assert len(dataset) == 0
    assert dataset.classes == ("line",)


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        (sample(size=None), r"The size of a\.jpg is unknown"),
        (sample(polylines=Polylines.from_list([[[np.nan, 0]]])), r"a\.jpg has a line without vertices or"),
        (sample(polylines=Polylines.from_list([np.zeros((0, 2))])), r"a\.jpg has a line without vertices or"),
        (sample(ignore=[np.array([[np.inf, 0.0]])]), r"a\.jpg has a line without vertices or"),
        (sample(polylines=Polylines.from_list([[[0, 0]]], [np.nan])), r"a\.jpg has a score"),
        (sample("a\x07.jpg"), r"'a\\x07\.jpg' has the character '\\x07'"),
    ],
)
def test_what_the_format_cannot_hold_is_named(tmp_path, wrong, reason):
    with pytest.raises(ValueError, match=reason):
        CVATWriter(tmp_path).add(wrong)


def test_class_names_that_xml_cannot_hold_are_named(tmp_path):
    writer = CVATWriter(tmp_path, classes=["\ud800"])
    with pytest.raises(ValueError, match=r"The name '\\ud800' has the character"):
        writer.close()
    assert list(tmp_path.iterdir()) == []


texts = st.text(
    st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"], exclude_characters="\ufffe\uffff")
    | st.sampled_from("\t\n\r'\"<>&;é😀"),
    min_size=1,
    max_size=8,
)
floats = st.floats(-1e5, 1e5)
vertices = st.lists(st.tuples(floats, floats), min_size=1, max_size=5)
lines = st.lists(st.tuples(vertices, st.floats(0, 1), st.integers(0, 2)), max_size=3)
folders = itertools.count()


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.tuples(lines, st.lists(vertices, max_size=2)), min_size=1, max_size=3),
    st.lists(texts, min_size=3, max_size=3, unique=True),
)
def test_writing_and_reading_is_the_identity(tmp_path_factory, images, classes):
    root = tmp_path_factory.getbasetemp() / f"cvat{next(folders)}"
    samples = [
        Sample(
            f"clips/{i}é & 1/a.{i}.jpg",
            Path(),
            Polylines.from_list(
                [np.array(line) for line, _, _ in found],
                [score for _, score, _ in found],
                [label for _, _, label in found],
            ),
            [np.array(region) for region in regions],
            (7 + i, 9),
        )
        for i, (found, regions) in enumerate(images)
    ]
    with CVATWriter(root, classes=classes) as writer:
        for one in samples:
            writer.add(one)
    dataset = read(root)
    if "ignore" not in classes:  # then its label is not for polylines only
        assert dataset.classes == tuple(classes)
    for one, back in zip(samples, dataset, strict=True):
        assert (back.name, back.size) == (one.name, one.size)
        assert as_lists(back.polylines) == as_lists(one.polylines)
        assert back.polylines.scores.tolist() == one.polylines.scores.tolist()
        assert [dataset.classes[i] for i in back.polylines.labels] == [
            classes[i] for i in one.polylines.labels
        ]
        assert [region.tolist() for region in back.ignore] == [region.tolist() for region in one.ignore]


def test_lanes_of_tusimple_go_there_and_back(tmp_path, tusimple_root):
    from yolino.datasets.tusimple import TuSimple

    dataset = TuSimple(tusimple_root, "label_data_0531.json", classes=True)
    with CVATWriter(tmp_path, classes=dataset.classes) as writer:
        for one in dataset:
            writer.add(Sample(one.name, one.image, one.polylines, one.ignore, (720, 1280)))
    back = CVAT(tusimple_root, tmp_path / "annotations.xml")
    assert back.classes == dataset.classes
    for one, other in zip(dataset, back, strict=True):
        assert (one.name, one.image) == (other.name, other.image)
        assert as_lists(one.polylines) == as_lists(other.polylines)
        assert one.polylines.labels.tolist() == other.polylines.labels.tolist()
