"""`data.yaml`, folders without one, and how arguments reach the formats."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from yolino.datasets import DATASETS, TuSimple
from yolino.datasets.description import arguments_of, build, load_description, open_split
from yolino.datasets.detection import detect_format

LINE = {"type": "LineString", "coordinates": [[1, 2], [30, 40]]}


def write_geojson(root: Path, stem: str, *names: str) -> None:
    features = [{"type": "Feature", "properties": {"label": name}, "geometry": LINE} for name in names]
    (root / "labels").mkdir(parents=True, exist_ok=True)
    (root / "images").mkdir(exist_ok=True)
    (root / f"images/{stem}.jpg").write_bytes(b"an image")
    document = {"type": "FeatureCollection", "features": features}
    (root / f"labels/{stem}.geojson").write_text(json.dumps(document))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_geojson(tmp_path, "a", "way", "link")
    write_geojson(tmp_path, "b", "way", "kerb")
    write_geojson(tmp_path, "c")
    (tmp_path / "train.txt").write_text("images/a.jpg\nimages/c.jpg\n")
    (tmp_path / "val.txt").write_text("images/b.jpg\n")
    return tmp_path


def names_of(dataset: object) -> list[str]:
    return [dataset[i].name for i in range(len(dataset))]  # type: ignore[index,arg-type]


def test_a_folder_describes_itself(folder: Path) -> None:
    description = load_description(folder)
    assert description.format == "geojson"
    assert set(description.splits) == {"train", "val"}
    assert names_of(open_split(description)) == ["images/a.jpg", "images/b.jpg", "images/c.jpg"]
    assert names_of(open_split(description, "train")) == ["images/a.jpg", "images/c.jpg"]


def test_a_file_says_more(folder: Path) -> None:
    (folder / "train.txt").rename(folder / "mine.txt")
    (folder / "data.yaml").write_text(
        "format: geojson\nsplits: {train: mine.txt, test: [labels/b.geojson], rest: 'labels/[bc].geojson'}\n"
        "classes: {way: lane, link: lane, kerb: kerb}\ndirected: false\nlicence: ours\n"
    )
    for path in (folder, folder / "data.yaml"):
        description = load_description(path)
        train = open_split(description, "train")
        assert (train.classes, train.directed, description.licence) == (("lane", "kerb"), False, "ours")
        assert train[0].polylines.labels.tolist() == [0, 0]
        assert names_of(open_split(description, "test")) == ["images/b.jpg"]
        assert names_of(open_split(description, "rest")) == ["images/b.jpg", "images/c.jpg"]
        assert open_split(description, "test")[0].polylines.labels.tolist() == [0, 1]


def test_the_root_starts_from_the_file(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    file = tmp_path / "elsewhere/data.yaml"
    file.write_text("format: geojson\nroot: ..\nclasses: [way]\n")
    dataset = open_split(load_description(file))
    assert [len(dataset[i].polylines) for i in range(3)] == [1, 1, 0]
    assert dataset.left_out == {"link": 1, "kerb": 1}  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("- a", "holds no keys"),
        ("root: .", "the key 'format' is missing"),
        ("format: geojson\nsplit: {}", "unknown key 'split'; did you mean 'splits'"),
        ("format: geojsom", "format 'geojsom' is unknown; use one of tusimple"),
        ("format: geojson\nsplits: {train: 3}", "splits.train"),
        ("format: [", "is not YAML"),
    ],
)
def test_mistakes_in_the_file_are_told(folder: Path, text: str, reason: str) -> None:
    (folder / "data.yaml").write_text(text)
    with pytest.raises(ValueError, match=reason) as caught:
        load_description(folder)
    assert "data.yaml" in str(caught.value)


def test_mistakes_in_the_arguments_are_told(folder: Path) -> None:
    description = load_description(folder)
    with pytest.raises(ValueError, match=r"no split 'test'; it has train, val"):
        open_split(description, "test")
    with pytest.raises(ValueError, match=r"'geojson' takes no colour; it takes .*root"):
        open_split(description, colour="red")
    with pytest.raises(ValueError, match=r"None of the classes track occurs in .*kerb, link, way"):
        open_split(description, classes=["track"])
    with pytest.raises(FileNotFoundError, match=r"no data description .*nothing"):
        load_description(folder / "nothing")
    with pytest.raises(ValueError, match="'geojson' needs --root"):
        build("geojson", {})
    with pytest.raises(ValueError, match="'lanes' is unknown; use one of"):
        build("lanes", {})


def test_names_choose_images_in_their_order(folder: Path) -> None:
    (folder / "list.txt").write_text("c\n/images/b.jpg 1 1 0\n\nimages/a\n")
    dataset = build("geojson", {"root": folder, "names": "list.txt"})
    assert names_of(dataset) == ["images/c.jpg", "images/b.jpg", "images/a.jpg"]


def test_a_name_without_labels_is_told_or_skipped(folder: Path) -> None:
    (folder / "list.txt").write_text("a\nd\n")
    with pytest.raises(ValueError, match=r"list\.txt, line 2 lists d, which has no labels in"):
        build("geojson", {"root": folder, "names": "list.txt"})
    dataset = build("geojson", {"root": folder, "names": "list.txt", "skip_broken": True})
    assert names_of(dataset) == ["images/a.jpg"]
    assert [str(error).split(" lists")[0][-6:] for error in dataset.broken] == ["line 2"]  # type: ignore[attr-defined]


def test_a_name_that_fits_two_images_is_told(tmp_path: Path) -> None:
    for part in ("x", "y"):
        (tmp_path / part).mkdir()
        (tmp_path / part / "1.lines.txt").write_text("1 2 3 4\n")
        (tmp_path / part / "1.jpg").write_bytes(b"an image")
    (tmp_path / "list.txt").write_text("1\n")
    arguments = {"root": tmp_path, "names": "list.txt", "labels": ["x", "y"]}
    with pytest.raises(ValueError, match=r"lists 1, which could be x/1 or y/1: write the whole path"):
        build("culane", arguments)
    (tmp_path / "list.txt").write_text("y/1.jpg\n")
    assert names_of(build("culane", arguments)) == ["y/1.jpg"]


def test_broken_files_stop_or_are_skipped_and_counted(folder: Path) -> None:
    (folder / "labels/b.geojson").write_text("{")
    with pytest.raises(ValueError, match=r"b\.geojson"):
        build("geojson", {"root": folder})
    dataset = build("geojson", {"root": folder, "skip_broken": True})
    assert names_of(dataset) == ["images/a.jpg", "images/c.jpg"]
    assert ["b.geojson" in str(error) for error in dataset.broken] == [True]  # type: ignore[attr-defined]


def test_missing_images_stop_or_are_skipped(folder: Path) -> None:
    (folder / "images/a.jpg").unlink()
    with pytest.raises(FileNotFoundError, match=r"a\.geojson names the image .*which does not exist"):
        build("geojson", {"root": folder})
    assert len(build("geojson", {"root": folder, "skip_broken": True})) == 2
    assert len(build("geojson", {"root": folder, "require_images": False})) == 3


def test_images_elsewhere_and_in_capitals_are_found(folder: Path, tmp_path: Path) -> None:
    photos = tmp_path / "photos"
    (folder / "images").rename(photos)
    (photos / "a.jpg").rename(photos / "a.JPG")
    dataset = build("geojson", {"root": folder, "images": photos})
    assert dataset[0].image == photos / "a.JPG"


def test_reading_shows_progress(folder: Path) -> None:
    seen: list[object] = []

    def progress(items):  # type: ignore[no-untyped-def]
        for item in items:
            seen.append(item)
            yield item

    build("geojson", {"root": folder, "progress": progress})
    assert len(seen) == 3


def test_arguments_are_found_through_the_bases() -> None:
    assert list(arguments_of("synthetic")) == ["kind", "length", "seed", "size", "classes"]
    assert {"root", "labels", "classes", "skip_broken"} <= arguments_of("tusimple").keys()
    assert DATASETS["tusimple"] is TuSimple


DETECTED = {
    "tusimple": ("label_data_0313.json", "{}"),
    "culane": ("a/b/00000.lines.txt", ""),
    "curvelanes": ("train/labels/a.lines.json", "{}"),
    "geojson": ("deep/down/a.geojson", "{}"),
    "cvat": ("export.xml", "<annotations/>"),
    "labelme": ("a.json", '{"version": "5", "shapes": []}'),
    "coco": ("annotations/train.json", '{"images": [], "annotations": []}'),
    "labelstudio": ("project.json", '[\n {"data": {"image": "a.jpg"}}]'),
    "results": ("a.json", '{"image": "a.jpg", "size": [1, 1], "polylines": []}'),
    "masks": ("masks/a.png", ""),
}


@pytest.mark.parametrize("name", DETECTED)
def test_formats_are_found_out_from_their_files(name: str, tmp_path: Path) -> None:
    file, text = DETECTED[name]
    path = tmp_path / file
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    assert detect_format(tmp_path) == name
    if name != "masks":
        assert detect_format(path) == name


def test_a_file_of_records_is_tusimple_whatever_its_name(tmp_path: Path) -> None:
    path = tmp_path / "predictions.json"
    record = '{"raw_file": "a.jpg", "lanes": [], "h_samples": [], "run_time": 1}\n'
    path.write_text(record * 2)
    assert detect_format(path) == "tusimple"


@pytest.mark.parametrize(
    ("name", "text"), [("a.json", "{}"), ("a.json", "no json"), ("a.doc", ""), ("b.json", "[]")]
)
def test_what_is_no_known_format_is_told(name: str, text: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    for path in (tmp_path, tmp_path / name):
        with pytest.raises(ValueError, match="known"):
            detect_format(path)
