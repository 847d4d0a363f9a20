"""Files against files: which belong together, which classes, which sizes."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from yolino.datasets import WRITERS
from yolino.evaluate.score import Side, _match, open_side, pairs, score
from yolino.metrics import ChamferMetric, CULaneMetric, PointMetric
from yolino.types import Polylines, Sample

SIZE = (100, 200)
LEFT, RIGHT = [[20.0, 90.0], [60.0, 10.0]], [[150.0, 90.0], [120.0, 10.0]]


def write(
    out: Path,
    format: str,
    images: dict[str, list[list[list[float]]]],
    *,
    classes: tuple[str, ...] = ("lane",),
) -> Path:
    """Writes the lines of each image; line i of an image has the label i modulo the number of classes."""
    with WRITERS[format](out, classes=classes) as writer:
        for name, lines in images.items():
            labels = [i % len(classes) for i in range(len(lines))]
            writer.add(Sample(name, Path(name), Polylines.from_list(lines, labels=labels), (), SIZE))
    return out


def test_names_match_by_their_ends() -> None:
    labels = ["clips/a/20.jpg", "clips/b/20.jpg", "c/21.jpg"]
    assert _match(["clips/b/20.jpg", "clips/a/20.jpg"], labels, "") == [1, 0, None]
    assert _match(["/data/clips/b/20.png", "b/20", "a/20"][:1], labels, "") == [None, 0, None]
    assert _match(["a/20", "b/20.json"], labels, "") == [0, 1, None]
    assert _match(["out\\\\21.json".replace("\\\\", "\\")], labels, "") == [None, None, 0]
    assert _match(["21"], labels, "") == [None, None, 0]


@pytest.mark.parametrize("predicted", [["20.jpg"], ["x/20.jpg", "y/20.jpg", "20.jpg"]])
def test_a_name_that_fits_several_is_told(predicted: list[str]) -> None:
    with pytest.raises(ValueError, match=r"In these several images could be clips/[ab]/20\.jpg"):
        _match(predicted, ["clips/a/20.jpg", "clips/b/20.jpg"], "these")


@pytest.mark.parametrize("format", ["cvat", "coco", "geojson", "labelme", "labelstudio", "results"])
def test_any_format_against_any(format: str, tmp_path: Path) -> None:
    truth = write(tmp_path / "truth", "geojson", {"a.jpg": [LEFT, RIGHT], "b.jpg": [LEFT]})
    found = write(tmp_path / "found", format, {"b.jpg": [LEFT], "a.jpg": [LEFT]})
    scores = score(lambda _: PointMetric(), found, truth)
    lengths = [np.hypot(40, 80), np.hypot(30, 80)]
    assert scores.values["precision"] == 1
    assert scores.values["recall"] == pytest.approx(2 * lengths[0] / (2 * lengths[0] + lengths[1]), abs=0.01)
    assert (scores.values["images"], scores.missing, scores.intervals, scores.categories) == (2, 0, {}, {})


def test_single_files_are_taken_too(tmp_path: Path) -> None:
    truth = write(tmp_path / "truth", "cvat", {"a.jpg": [LEFT]}) / "annotations.xml"
    found = write(tmp_path / "found", "coco", {"a.jpg": [LEFT]}) / "annotations.json"
    assert score(lambda _: PointMetric(), found, truth, intervals=True).intervals["f1"] == (1, 1)


def test_images_without_prediction_are_misses_and_others_a_mistake(tmp_path: Path) -> None:
    truth = write(tmp_path / "truth", "cvat", {"a.jpg": [LEFT], "b.jpg": [LEFT]})
    found = write(tmp_path / "found", "cvat", {"b.jpg": [LEFT]})
    scores = score(lambda _: PointMetric(), found, truth)
    assert (scores.missing, scores.values["recall"], scores.values["precision"]) == (1, 0.5, 1)
    with pytest.raises(ValueError, match=r"predicts 1 images that .*found does not label, first 'a\.jpg'"):
        score(lambda _: PointMetric(), truth, found)


def test_classes_are_compared_by_name(tmp_path: Path) -> None:
    """Numbered the other way round on the other side."""
    truth = write(tmp_path / "truth", "coco", {"a.jpg": [LEFT, RIGHT]}, classes=("solid", "dashed"))
    found = write(tmp_path / "found", "coco", {"a.jpg": [RIGHT, LEFT]}, classes=("dashed", "solid"))
    asked = []

    def make(classes: tuple[str, ...]) -> ChamferMetric:
        asked.append(tuple(classes))
        return ChamferMetric(classes=classes)

    assert score(make, found, truth).values["ap"] == 1
    assert asked == [("solid", "dashed")]
    wrong = write(tmp_path / "wrong", "coco", {"a.jpg": [LEFT, RIGHT]}, classes=("dashed", "solid"))
    assert score(make, wrong, truth).values["ap"] == 0
    other = write(tmp_path / "other", "coco", {"a.jpg": [LEFT, RIGHT]}, classes=("dashed", "botts"))
    with pytest.raises(ValueError, match="class 'botts', which the labels lack; they have solid, dashed"):
        score(make, other, truth)
    plain = write(tmp_path / "plain", "coco", {"a.jpg": [LEFT, RIGHT]})
    assert score(make, plain, truth).values["ap"] == 1  # one side knows no classes: they do not count


def test_lists_are_categories(tmp_path: Path) -> None:
    truth = write(tmp_path / "truth", "culane", {"a.jpg": [LEFT], "b.jpg": [LEFT], "c.jpg": [LEFT]})
    found = write(tmp_path / "found", "culane", {"a.jpg": [LEFT], "b.jpg": [RIGHT], "d.jpg": [LEFT]})
    for name, images in (("day", "a\n"), ("night", "b\nc\n")):
        (tmp_path / f"{name}.txt").write_text(images)
    lists = [tmp_path / "day.txt", tmp_path / "night.txt"]
    scores = score(lambda _: CULaneMetric(size=None), found, truth, lists=lists, size=SIZE)
    assert {key: scores.values[key] for key in ("tp", "fp", "fn", "images")} == {
        "tp": 1,
        "fp": 1,
        "fn": 2,
        "images": 3,
    }
    assert scores.missing == 1
    assert [scores.categories[name]["f1"] for name in ("day", "night")] == [1, 0]
    single = score(lambda _: CULaneMetric(size=None), found, truth, lists=lists[:1], size=SIZE)
    assert (single.values["images"], single.categories) == (1, {})


def test_sizes_come_from_files_options_or_images(tmp_path: Path) -> None:
    truth = write(tmp_path / "truth", "culane", {"a.jpg": [LEFT]})
    found = write(tmp_path / "found", "culane", {"a.jpg": [LEFT]})
    with pytest.raises(ValueError, match=r"The size of a.* give --size HEIGHTxWIDTH"):
        score(lambda _: PointMetric(), found, truth)
    assert score(lambda _: PointMetric(), found, truth, size=SIZE).values["f1"] == 1
    cv2.imwrite(str(tmp_path / "truth/a.jpg"), np.zeros((*SIZE, 3), np.uint8))
    assert score(lambda _: PointMetric(), found, truth).values["f1"] == 1


def test_ignored_regions_count_on_neither_side(tmp_path: Path) -> None:
    region = np.array([[100.0, 0.0], [200.0, 0.0], [200.0, 100.0], [100.0, 100.0]])
    with WRITERS["geojson"](tmp_path / "truth") as writer:
        writer.add(Sample("a.jpg", Path("a.jpg"), Polylines.from_list([LEFT]), (region,), SIZE))
    found = write(tmp_path / "found", "cvat", {"a.jpg": [LEFT, RIGHT]})
    assert score(lambda _: PointMetric(), found, tmp_path / "truth").values["precision"] == 1


def test_a_description_is_a_side(tmp_path: Path) -> None:
    write(tmp_path / "truth", "cvat", {"a.jpg": [LEFT]})
    (tmp_path / "truth/data.yaml").write_text("format: cvat\nclasses: {lane: border}\n")
    for path in (tmp_path / "truth/data.yaml",):
        side = open_side(path)
        assert isinstance(side, Side)
        assert side.classes == ("border",)
        assert [label.name for _, label in pairs(side, side)] == ["a.jpg"]


def test_official_files_of_tusimple_are_sides_too(tmp_path: Path) -> None:
    rows = list(range(10, 100, 10))
    record = {"raw_file": "clips/a/20.jpg", "lanes": [[30] * len(rows)], "h_samples": rows}
    (tmp_path / "labels.json").write_text(json.dumps(record) + "\n")
    (tmp_path / "found.json").write_text(json.dumps(record | {"run_time": 3}) + "\n")
    scores = score(lambda _: PointMetric(), tmp_path / "found.json", tmp_path / "labels.json", size=SIZE)
    assert scores.values["f1"] == 1
