"""What holds for every format: written and read again it is the same, and it is found out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from yolino.datasets import DATASETS, WRITERS, Dataset, FileDataset, Synthetic
from yolino.datasets.convert import convert
from yolino.datasets.description import build, load_description, open_split
from yolino.datasets.detection import detect_format
from yolino.io import read_image
from yolino.types import Polylines, Sample

SIZE = (720, 1280)
EXACT = sorted(name for name in WRITERS if name not in ("tusimple", "masks", "results"))
"""Formats that keep vertices as they are; the others have rows, pixels, or two decimals."""


class InMemory:
    """A dataset of samples."""

    directed = True

    def __init__(self, *samples: Sample, classes: tuple[str, ...] = ("lane",)) -> None:
        self.samples, self.classes = samples, classes

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, index: int) -> Sample:
        return self.samples[index]


@pytest.fixture
def images(tmp_path: Path) -> Callable[[str], Path]:
    """Writes an image under a name."""

    def write(name: str) -> Path:
        path = tmp_path / "source" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), np.full((*SIZE, 3), 90, np.uint8))
        return path

    return write


@pytest.fixture
def dataset(images: Callable[[str], Path]) -> InMemory:
    """Three images in two folders, with the same file name; one has no lines."""
    rng = np.random.default_rng(3)
    samples = []
    for name, sizes in (("a/20.jpg", (3, 2, 7)), ("b/20.jpg", ()), ("b/21.jpg", (2,))):
        lines = [rng.uniform((0, 0), SIZE[::-1], (n, 2)) for n in sizes]
        scores = np.linspace(0.25, 1, len(sizes)) if sizes else None
        labels = np.arange(len(sizes)) % 2
        ignore = (np.array([[10.5, 20.0], [200.25, 30.0], [90.0, 300.0]]),) if sizes else ()
        polylines = Polylines.from_list(lines, scores, labels)
        samples.append(Sample(name, images(name), polylines, ignore, SIZE))
    return InMemory(*samples, classes=("dashed line", "solid, “wide”"))


def as_sets(dataset: Dataset) -> dict[str, list[tuple[object, ...]]]:
    found = {}
    for i in range(len(dataset)):
        sample = dataset[i]
        names = [dataset.classes[label] for label in sample.polylines.labels]
        found[sample.name] = [
            (name, line.tolist()) for name, line in zip(names, sample.polylines, strict=True)
        ]
    return found


@pytest.mark.parametrize("name", EXACT)
def test_written_and_read_again_it_is_the_same(name: str, dataset: InMemory, tmp_path: Path) -> None:
    out = tmp_path / "out"
    convert(dataset, name, out)
    description = load_description(out)
    assert (description.format, detect_format(out)) == (name, name)
    again = open_split(description)
    loses = WRITERS[name].loses
    assert sorted(s.name for s in map(again.__getitem__, range(len(again)))) == [
        "a/20.jpg",
        "b/20.jpg",
        "b/21.jpg",
    ]
    for sample in dataset.samples:
        (found,) = [s for s in map(again.__getitem__, range(len(again))) if s.name == sample.name]
        assert isinstance(found.image, Path)
        assert found.image.is_file()
        assert found.size in ((None, SIZE) if "sizes" in loses else (SIZE,))
        if len(sample.polylines) or len(found.polylines):
            np.testing.assert_allclose(found.polylines.vertices, sample.polylines.vertices, atol=1e-6)
        assert found.polylines.offsets.tolist() == sample.polylines.offsets.tolist()
        if "scores" not in loses:
            np.testing.assert_allclose(found.polylines.scores, sample.polylines.scores)
        if "classes" not in loses:
            names = [dataset.classes[label] for label in sample.polylines.labels]
            assert [again.classes[label] for label in found.polylines.labels] == names
        if "ignored regions" not in loses:
            assert len(found.ignore) == len(sample.ignore)
            for region, expected in zip(found.ignore, sample.ignore, strict=True):
                np.testing.assert_allclose(region, expected)


@pytest.mark.parametrize("name", EXACT)
def test_there_and_back_through_another_format(name: str, dataset: InMemory, tmp_path: Path) -> None:
    """GeoJSON holds everything: what a format does not lose arrives there again."""
    if name == "geojson" or "classes" in WRITERS[name].loses:
        return
    convert(dataset, "geojson", tmp_path / "first")
    convert(open_split(load_description(tmp_path / "first")), name, tmp_path / "second")
    convert(open_split(load_description(tmp_path / "second")), "geojson", tmp_path / "third")
    first, third = (as_sets(open_split(load_description(tmp_path / part))) for part in ("first", "third"))
    assert first.keys() == third.keys()
    for image, lines in first.items():
        for (label, points), (again, arrived) in zip(lines, third[image], strict=True):
            assert label == again
            np.testing.assert_allclose(points, arrived, atol=1e-6)


def test_labels_of_tusimple_survive_other_formats(images: Callable[[str], Path], tmp_path: Path) -> None:
    rows = np.arange(300.5, 710, 10)[::-1]
    lanes = [
        np.stack([400.5 + 0.25 * rows, rows], axis=1),
        np.stack([900.5 - 0.5 * rows[3:], rows[3:]], axis=1),
    ]
    polylines = Polylines.from_list([lane.round(1) for lane in lanes], labels=[2, 0])
    classes = ("continuous yellow", "continuous white", "dashed")
    sample = Sample("clips/1/20.jpg", images("clips/1/20.jpg"), polylines, (), SIZE)
    convert(InMemory(sample, classes=classes), "tusimple", tmp_path / "one")
    first = build("tusimple", {"root": tmp_path / "one", "classes": True})
    convert(first, "cvat", tmp_path / "two")
    convert(open_split(load_description(tmp_path / "two")), "tusimple", tmp_path / "three")
    again = build("tusimple", {"root": tmp_path / "three", "classes": True})
    assert as_sets(first) == as_sets(again)
    np.testing.assert_allclose(again[0].polylines.vertices, polylines.vertices, atol=1e-9)


def test_drawn_scenes_are_written_with_their_images(tmp_path: Path) -> None:
    scenes = Synthetic("shapes", length=2, seed=5, size=(64, 96))
    convert(scenes, "labelme", tmp_path)
    again = open_split(load_description(tmp_path))
    assert len(again) == 2
    for i in range(2):
        image = again[i].image
        assert isinstance(image, Path)
        np.testing.assert_array_equal(read_image(image), scenes[i].image)


def test_images_are_linked_copied_or_left(dataset: InMemory, tmp_path: Path) -> None:
    source = dataset.samples[0].image
    assert isinstance(source, Path)
    convert(dataset, "cvat", tmp_path / "linked")
    assert (tmp_path / "linked/a/20.jpg").samefile(source)
    convert(dataset, "cvat", tmp_path / "copied", images="copy")
    copied = tmp_path / "copied/a/20.jpg"
    assert copied.read_bytes() == source.read_bytes()
    assert not copied.samefile(source)
    convert(dataset, "cvat", tmp_path / "left", images="none")
    assert sorted(p.name for p in (tmp_path / "left").iterdir()) == ["annotations.xml", "data.yaml"]
    linked = open_split(load_description(tmp_path / "linked"))
    convert(linked, "coco", tmp_path / "chain", images="none")
    assert (
        open_split(load_description(tmp_path / "chain"))[0].image == (tmp_path / "linked/a/20.jpg").resolve()
    )


def test_files_that_place_an_image_on_the_map_come_along(dataset: InMemory, tmp_path: Path) -> None:
    source = dataset.samples[0].image
    assert isinstance(source, Path)
    source.with_suffix(".jgw").write_text("0.1\n0\n0\n-0.1\n500000\n5400000\n")
    convert(dataset, "cvat", tmp_path / "out")
    assert (tmp_path / "out/a/20.jgw").read_text() == source.with_suffix(".jgw").read_text()
    assert [p.name for p in (tmp_path / "out/b").iterdir() if p.suffix != ".jpg"] == []


def test_a_folder_can_be_converted_in_place(dataset: InMemory, tmp_path: Path) -> None:
    convert(dataset, "cvat", tmp_path / "source")
    before = {p: p.read_bytes() for p in (tmp_path / "source").rglob("*.jpg")}
    again = open_split(load_description(tmp_path / "source"))
    with pytest.raises(ValueError, match="holds labels already"):
        convert(again, "coco", tmp_path / "source")
    convert(again, "coco", tmp_path / "source", force=True)
    assert {p: p.read_bytes() for p in (tmp_path / "source").rglob("*.jpg")} == before
    assert yaml.safe_load((tmp_path / "source/data.yaml").read_text())["format"] == "coco"


def test_wrong_arguments_are_told(dataset: InMemory, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"'synthetic' cannot be written; use one of .*cvat"):
        convert(dataset, "synthetic", tmp_path)
    with pytest.raises(ValueError, match=r"images is 'move'; use one of link, copy, none"):
        convert(dataset, "cvat", tmp_path, images="move")
    lost = replace(dataset.samples[0], image=tmp_path / "lost.jpg")
    with pytest.raises(FileNotFoundError, match=r"no image .*lost\.jpg"):
        convert(InMemory(lost, classes=dataset.classes), "cvat", tmp_path / "out")


@pytest.mark.parametrize("name", sorted(DATASETS))
def test_every_format_of_files_has_the_arguments_of_the_base(name: str) -> None:
    if not issubclass(DATASETS[name], FileDataset):
        return
    from yolino.datasets.description import arguments_of

    wanted = {"root", "classes", "directed", "ignore", "skip_broken", "require_images", "progress"}
    assert wanted <= arguments_of(name).keys()


@pytest.mark.parametrize("name", sorted(DATASETS))
def test_a_folder_that_is_not_there_is_named(name: str, tmp_path: Path) -> None:
    if issubclass(DATASETS[name], FileDataset):
        with pytest.raises(FileNotFoundError, match="nowhere"):
            build(name, {"root": tmp_path / "nowhere"})


@pytest.mark.parametrize("name", sorted(DATASETS))
def test_an_empty_folder_is_no_dataset(name: str, tmp_path: Path) -> None:
    if issubclass(DATASETS[name], FileDataset):
        with pytest.raises(FileNotFoundError, match="There are no labels like"):
            build(name, {"root": tmp_path})
