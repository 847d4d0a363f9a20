from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.datasets.annotation import LabelError
from yolino.datasets.culane import CULane, CULaneWriter, categories
from yolino.datasets.lists import pixel_numbers
from yolino.datasets.writing import without_suffix
from yolino.types import Polylines, Sample

DRIVE = "driver_1_30frame/05.MP4"
LANES = "-14.0619 510 20.5 500 \n1409.63 590 1389.99 580 1370.34 570\n"


def write(root: Path, name: str, text: str | bytes, *, image: bool = True) -> Path:
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    if image:
        Path(str(path).replace(".lines.txt", ".jpg")).write_bytes(b"an image")
    return path


def as_lists(polylines: Polylines) -> list[list[list[float]]]:
    return [p.tolist() for p in polylines]


@pytest.fixture
def root(tmp_path: Path) -> Path:
    write(tmp_path, f"{DRIVE}/00000.lines.txt", LANES)
    write(tmp_path, f"{DRIVE}/00030.lines.txt", "")
    write(tmp_path, "driver_2/1.lines.txt", "1 2 3 4")
    return tmp_path


def listed(root: Path, *lines: str, name: str = "list/train.txt") -> Path:
    return write(root, name, "".join(f"{line}\n" for line in lines), image=False)


def test_numbers_count_pixels_and_lanes_keep_their_direction(root):
    dataset = CULane(root)
    assert [s.name for s in dataset] == [f"{DRIVE}/00000.jpg", f"{DRIVE}/00030.jpg", "driver_2/1.jpg"]
    sample = dataset[0]
    assert sample.image == root / DRIVE / "00000.jpg"
    np.testing.assert_allclose(sample.polylines.offsets, [0, 2, 5])
    np.testing.assert_allclose(
        sample.polylines.vertices,
        [[-13.5619, 510.5], [21, 500.5], [1410.13, 590.5], [1390.49, 580.5], [1370.84, 570.5]],
        rtol=1e-15,
    )
    assert sample.size is None
    assert dataset.classes == ("lane",)
    assert dataset.directed
    assert len(dataset[1].polylines) == 0
    assert as_lists(dataset[2].polylines) == [[[1.5, 2.5], [3.5, 4.5]]]


def test_a_list_chooses_and_orders_the_images(root):
    listed(root, "/driver_2/1.jpg /laneseg/1.png 1 1 0 0", "", f"/{DRIVE}/00000.jpg /x.png 1 1 1 1")
    expected = ["driver_2/1.jpg", f"{DRIVE}/00000.jpg"]
    for options in ({"names": "list/train.txt"}, {"labels": "list/train.txt"}):
        assert [s.name for s in CULane(root, **options)] == expected
    both = CULane(root, "**/*.lines.txt", names="list/train.txt")
    assert [s.name for s in both] == expected


def test_a_list_saves_searching_the_folders(root, monkeypatch):
    listed(root, "driver_2/1.jpg")
    monkeypatch.setattr(Path, "glob", lambda *_: pytest.fail("the folders were searched"))
    assert len(CULane(root, names="list/train.txt")) == 1


def test_an_image_may_be_listed_twice(root):
    listed(root, "/driver_2/1.jpg", "/driver_2/1.jpg")
    assert [s.name for s in CULane(root, names="list/train.txt")] == ["driver_2/1.jpg"] * 2


def test_several_lists_and_label_files_can_be_given(root):
    one, two = listed(root, "driver_2/1.jpg"), listed(root, f"{DRIVE}/00030.jpg", name="list/val.txt")
    dataset = CULane(root, [one, two, f"{DRIVE}/00000.lines.txt"])
    assert [s.name for s in dataset] == ["driver_2/1.jpg", f"{DRIVE}/00030.jpg", f"{DRIVE}/00000.jpg"]


def test_names_may_start_at_the_folder_of_the_list_and_have_spaces_and_backslashes(tmp_path):
    write(tmp_path, "a/b/c d.e.lines.txt", "1 2 3 4")
    listed(tmp_path, "b\\c d.e.JPG 1 1", name="a/train.txt")
    dataset = CULane(tmp_path, names="a/train.txt", require_images=False)
    assert [one.image for one in dataset.annotations] == ["a/b/c d.e.JPG"]
    assert len(dataset[0].polylines) == 1


def test_a_listed_image_without_labels_names_list_and_line(root):
    path = listed(root, "/driver_2/1.jpg", "", f"/{DRIVE}/00060.jpg")
    with pytest.raises(LabelError) as caught:
        CULane(root, names="list/train.txt")
    expected = f"{path}, line 3 lists {DRIVE}/00060.jpg, which has no label file "
    assert str(caught.value).startswith(expected)
    assert str(caught.value).endswith(f"{DRIVE}/00060.lines.txt.")
    dataset = CULane(root, names="list/train.txt", skip_broken=True)
    assert len(dataset) == len(dataset.broken) == 1


def test_one_broken_file_does_not_end_a_list(root):
    path = write(root, "driver_2/2.lines.txt", "1 2 3")
    (root / "driver_2/3.lines.txt").mkdir()
    listed(root, "driver_2/2.jpg", "driver_2/3.jpg", "driver_2/1.jpg")
    dataset = CULane(root, names="list/train.txt", skip_broken=True)
    assert [s.name for s in dataset] == ["driver_2/1.jpg"]
    assert dataset.broken[0].where == f"{path}, line 1"
    assert "line 2 lists driver_2/3.jpg, whose labels are lost" in str(dataset.broken[1])


def test_a_list_that_is_missing_or_empty_is_named(root):
    with pytest.raises(FileNotFoundError, match=r"no list of names .*list/none\.txt"):
        CULane(root, names="list/none.txt")
    listed(root, "  ")
    with pytest.raises(ValueError, match=r"train\.txt is empty"):
        CULane(root, names="list/train.txt")
    write(root, "list/bytes.txt", b"\xff\xfe\x00", image=False)
    with pytest.raises(ValueError, match=r"bytes\.txt cannot be read"):
        CULane(root, names="list/bytes.txt")


BAD = {
    "has 3 values, but pairs x y are needed": "1 2 3",
    "holds 'x', but finite numbers": "1 2 x",
    "holds '1,2'": "1,2 3",
    "holds 'nan'": "1 nan",
    "holds '-inf'": "1 2 -inf 3",
    "holds '1e999'": "1e999 2",
    "holds '\ufffd'": b"1 \xff",
}


@pytest.mark.parametrize("reason", BAD)
def test_a_bad_line_is_named_and_breaks_its_image_only(root, reason):
    bad = BAD[reason]
    path = write(
        root, "driver_2/2.lines.txt", b"1 2 3 4\n\n" + (bad if isinstance(bad, bytes) else bad.encode())
    )
    with pytest.raises(LabelError) as caught:
        CULane(root)
    assert str(caught.value).startswith(f"{path}, line 3 {reason}")
    dataset = CULane(root, skip_broken=True)
    assert len(dataset) == 3
    assert len(dataset.broken) == 1


def test_one_point_is_kept_for_the_checks_to_report(tmp_path):
    write(tmp_path, "a.lines.txt", "1 2\r\n\r\n3 4 5 6\r\n")
    assert as_lists(CULane(tmp_path)[0].polylines) == [[[1.5, 2.5]], [[3.5, 4.5], [5.5, 6.5]]]


def test_missing_images_and_labels_are_named(root):
    os.remove(root / "driver_2/1.jpg")
    with pytest.raises(FileNotFoundError, match=r"1\.lines\.txt names the image .*driver_2/1"):
        CULane(root)
    assert len(CULane(root, skip_broken=True)) == 2
    assert len(CULane(root, require_images=False)) == 3
    (root / "empty").mkdir()
    with pytest.raises(FileNotFoundError, match="no labels like"):
        CULane(root / "empty")


def test_classes_can_be_renamed(root):
    assert CULane(root, classes={"lane": "marking"}).classes == ("marking",)
    with pytest.raises(ValueError, match="None of the classes road occurs"):
        CULane(root, classes=["road"])


def test_the_scenes_of_the_test_images(root):
    assert categories(root) == {}
    listed(root, "/a/1.jpg", "/b/2.jpg", name="list/test_split/test0_normal.txt")
    listed(root, "/c/3.jpg", name="list/test_split/test8_night.txt")
    listed(root, name="list/test_split/other.txt")
    assert categories(root) == {"normal": ["a/1.jpg", "b/2.jpg"], "night": ["c/3.jpg"], "other": []}


def sample_of(name: str, *lines: object, **fields: object) -> Sample:
    return Sample(name, Path(name), Polylines.from_list(lines), **fields)


def test_lanes_are_written_as_the_benchmark_does(tmp_path):
    with CULaneWriter(tmp_path) as writer:
        writer.add(sample_of("/a/1.jpg", [[-13.5619, 510.5], [21, 500.5]], [[1.5, 2.5]]))
        writer.add(sample_of("a b.png"))
    assert (tmp_path / "a/1.lines.txt").read_text() == "-14.0619 510 20.5 500\n1 2\n"
    assert (tmp_path / "a b.lines.txt").read_text() == ""
    assert (tmp_path / "list/all.txt").read_text() == "/a/1.jpg\n/a b.png\n"
    dataset = CULane(tmp_path, names="list/all.txt", require_images=False)
    assert [s.name for s in dataset] == ["a/1.jpg", "a b.png"]


def test_the_list_has_a_name_and_what_was_written_before_an_error(tmp_path):
    def write_two() -> None:
        with CULaneWriter(tmp_path, names="list/val.txt") as writer:
            writer.add(sample_of("a.jpg"))
            writer.add(sample_of("b.jpg", [[0, np.nan]]))

    with pytest.raises(ValueError, match=r"b\.jpg has a vertex that is not finite"):
        write_two()
    assert (tmp_path / "list/val.txt").read_text() == "/a.jpg\n"
    assert not (tmp_path / "b.lines.txt").exists()


def test_no_labels_are_overwritten_dropped_or_written_elsewhere(tmp_path):
    writer = CULaneWriter(tmp_path / "out")
    writer.add(sample_of("a/1.jpg"))
    with pytest.raises(ValueError, match=r"labels of a/1\.png and a/1\.jpg would both be .*rename one"):
        writer.add(sample_of("a/1.png"))
    for name in ("../1.jpg", "a/../../1.jpg"):
        with pytest.raises(ValueError, match="leads out of the folder"):
            writer.add(sample_of(name))
    with pytest.raises(ValueError, match=r"2\.jpg has a polyline without vertices"):
        writer.add(sample_of("2.jpg", [[1, 2]], np.zeros((0, 2))))
    writer.add(sample_of("v1.2"))
    writer.add(sample_of("v1.3"))
    assert sorted(p.name for p in tmp_path.rglob("*.txt")) == [
        "1.lines.txt",
        "v1.2.lines.txt",
        "v1.3.lines.txt",
    ]


def test_a_relative_folder_is_left_neither(tmp_path, monkeypatch):
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    writer = CULaneWriter(Path())
    writer.add(sample_of("1.jpg"))
    with pytest.raises(ValueError, match="leads out"):
        writer.add(sample_of("../1.jpg"))


COORDINATES = st.floats(-1e5, 1e5)
LINES = st.lists(st.lists(st.tuples(COORDINATES, COORDINATES), min_size=1, max_size=4), max_size=4)


@settings(deadline=None, max_examples=25)
@given(st.lists(LINES, min_size=1, max_size=3))
def test_reading_what_was_written_is_the_identity(tmp_path_factory, images):
    root = tmp_path_factory.mktemp("written")
    names = [f"drive {i}/{i}.jpg" for i in range(len(images))]
    with CULaneWriter(root) as writer:
        for name, lines in zip(names, images, strict=True):
            writer.add(sample_of(name, *lines))
            (root / name).write_bytes(b"an image")
    for dataset in (CULane(root), CULane(root, names="list/all.txt")):
        assert [s.name for s in dataset] == names
        for sample, lines in zip(dataset, images, strict=True):
            expected = Polylines.from_list(lines)
            assert sample.polylines.offsets.tolist() == expected.offsets.tolist()
            np.testing.assert_allclose(sample.polylines.vertices, expected.vertices, rtol=1e-15, atol=1e-15)


@given(st.decimals(-99999, 99999, places=4, allow_nan=False))
def test_numbers_with_few_decimals_come_back_as_they_were(number):
    read = np.full((1, 2), float(number)) + 0.5
    assert pixel_numbers(read).tolist() == [[float(number)] * 2]


def test_only_suffixes_of_images_are_cut_off():
    assert without_suffix("/a.b/c.d.JPG") == "a.b/c.d"
    assert without_suffix("a/1.25") == "a/1.25"


def test_the_real_labels_survive_reading_and_writing(tmp_path):
    root = culane_root()
    for name, count in (("list/train.txt", 140), ("list/val.txt", 36)):
        dataset = CULane(root, names=name)
        assert len(dataset) == count
        with CULaneWriter(tmp_path, names=name) as writer:
            for sample in dataset:
                writer.add(sample)
        assert (tmp_path / name).read_text() == (root / name).read_text()
    labels = sorted(root.rglob("*.lines.txt"))
    assert len(labels) == 176
    for path in labels:
        written = (tmp_path / path.relative_to(root)).read_text().split()
        assert written == path.read_text().split()
        assert all(line[0, 1] > line[-1, 1] for line in CULane.read_lines(path))
    assert [s.name for s in CULane(root)] == sorted(s.name for n in ("train", "val") for s in split(root, n))


def split(root: Path, name: str) -> CULane:
    return CULane(root, names=f"list/{name}.txt")


def culane_root() -> Path:
    data = os.environ.get("YOLINO_DATA") or Path(__file__).parents[3] / "shared" / "data"
    root = Path(data) / "culane"
    if not root.is_dir():
        pytest.skip(f"the CULane frames are not in {root}; set YOLINO_DATA to the folder that holds culane/")
    return root
