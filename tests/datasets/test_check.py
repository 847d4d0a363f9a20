from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from yolino.datasets.annotation import Annotation, LabelError
from yolino.datasets.check import check, deviation_table
from yolino.datasets.files import FileDataset
from yolino.datasets.report import ERRORS, KINDS, Picture
from yolino.datasets.tusimple import TuSimple
from yolino.geometry import fit_matrix
from yolino.types import Polylines, Sample

IMAGE = np.zeros((64, 128, 3), np.uint8)


class Listed:
    """A dataset of samples that a test lists."""

    directed = True

    def __init__(self, *samples: Sample, classes: tuple[str, ...] = ("lane",)) -> None:
        self.samples = samples
        self.classes = classes

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, index: int, /) -> Sample:
        return self.samples[index]


def sample(name: str, *lines: object, image: object = IMAGE, labels: list[int] | None = None) -> Sample:
    return Sample(
        name, image, Polylines.from_list([np.array(v, float).reshape(-1, 2) for v in lines], labels=labels)
    )


GOOD = [[1, 1], [100, 60]]


def findings(*samples: Sample) -> list[tuple[str, str, str]]:
    return [(f.kind, f.sample, f.detail) for f in check(Listed(*samples)).findings]


def test_nothing_is_found_in_a_sound_dataset():
    report = check(Listed(sample("a", GOOD), sample("b", GOOD, [[5, 5], [5, 60], [7, 60]])))
    assert report.findings == ()
    assert report.counts == {}
    assert (report.samples, report.polylines, report.vertices) == (2, 3, 7)
    assert report.sizes == {(64, 128): 2}
    assert report.class_counts == {"lane": 3}


@pytest.mark.parametrize(
    ("line", "kind", "detail"),
    [
        ([[3, 3]], "one vertex", "polyline 1 has 1"),
        ([], "one vertex", "polyline 1 has 0"),
        ([[3, 3], [3, 3]], "zero length", "polyline 1 at [3.0, 3.0]"),
        ([[3, 3], [np.nan, 3]], "not finite", "polyline 1"),
        ([[3, 3], [np.inf, 3]], "not finite", "polyline 1"),
        (GOOD, "duplicate polyline", "polyline 1 is polyline 0"),
        ([[1, 1.5], [100, 60.5]], "near duplicate", "polyline 1 follows polyline 0"),
        ([[3, 3], [3, 3], [9, 3]], "repeated vertex", "polyline 1: 1 of 3 vertices repeat the one before"),
        ([[3, 3], [9, 3], [9, 9], [5, 1]], "self-overlap", "polyline 1"),
        ([[-9, 3], [-2, 9]], "outside", "polyline 1"),
        ([[-9, 3], [20, -90]], "outside", "polyline 1"),
        ([[-9, 3], [2, 9], [4, 9]], "partly outside", "polyline 1: 1 of 3 vertices"),
        ([[-9, 3], [200, 9]], "partly outside", "polyline 1: 2 of 2 vertices"),
    ],
)
def test_each_mistake_of_a_polyline_is_found(line, kind, detail):
    assert findings(sample("a", GOOD, line)) == [(kind, "a", detail)]


def test_what_touches_the_border_of_the_image_lies_inside():
    assert findings(sample("a", [[0, 0], [128, 64]])) == []


def test_samples_are_compared_with_each_other():
    other = np.zeros((32, 32, 3), np.uint8)
    found = findings(sample("a", GOOD), sample("a", GOOD), sample("c", [[1, 1], [2, 9]], image=other))
    assert found == [("duplicate name", "a", ""), ("other size", "c", "(32, 32), most have (64, 128)")]


def test_images_that_are_missing_or_broken_are_found_and_their_polylines_still_examined(tmp_path):
    (tmp_path / "broken.jpg").write_bytes(b"no image")
    report = check(
        Listed(
            sample("gone", [[3, 3]], image=tmp_path / "gone.jpg"),
            sample("broken", GOOD, image=tmp_path / "broken.jpg"),
        )
    )
    assert [(f.kind, f.sample) for f in report.findings] == [
        ("missing image", "gone"),
        ("one vertex", "gone"),
        ("unreadable image", "broken"),
    ]
    assert str(tmp_path / "gone.jpg") in report.findings[0].detail
    assert [f.kind for f in report.errors] == ["missing image", "unreadable image"]
    assert report.counts == {"missing image": 1, "unreadable image": 1, "one vertex": 1}
    assert report.sizes == {}


def test_a_size_that_the_labels_state_is_compared_with_the_image_and_stands_in_for_it(tmp_path):
    right, wrong = (replace(sample(name, [[1, 70], [9, 70]]), size=(64, 128)) for name in "ab")
    wrong = replace(wrong, size=(128, 128))
    gone = replace(wrong, name="c", image=tmp_path / "gone.jpg")
    report = check(Listed(right, wrong, gone), (32,))
    assert [(f.kind, f.sample, f.detail) for f in report.findings] == [
        ("outside", "a", "polyline 0"),
        ("wrong size", "b", "(64, 128), its labels state (128, 128)"),
        ("outside", "b", "polyline 0"),
        ("missing image", "c", str(tmp_path / "gone.jpg")),
    ]
    assert report.sizes == {(64, 128): 2}
    assert [f.kind for f in report.errors] == ["wrong size", "missing image"]
    assert report.occupancy[0].segments == 1  # of c, which the labels say is higher


class Lines(FileDataset):
    """A format of one coordinate per line: a polyline of that class through it."""

    patterns = ("*.lines",)

    def read(self, path: Path) -> Iterator[Annotation | LabelError]:
        for number, line in enumerate(path.read_text().splitlines(), 1):
            where = f"{path}, line {number}"
            name, _, x = line.partition(" ")
            if not x:
                yield LabelError(where, "has no coordinate, but one is needed")
            else:
                yield Annotation(f"{number}.png", where, [np.array([[float(x), 1], [float(x), 60]])], [name])


def test_what_is_broken_or_left_out_is_reported(tmp_path: Path):
    (tmp_path / "a.lines").write_text("solid 3\nnonsense\ndashed 5\nstop 5\n")
    for number in (1, 3, 4):
        cv2.imwrite(str(tmp_path / f"{number}.png"), IMAGE)
    dataset = Lines(tmp_path, classes=("dashed", "solid"), skip_broken=True, require_images=False)
    report = check(dataset)
    assert [(f.kind, f.sample, f.detail) for f in report.findings] == [
        ("broken label", f"{tmp_path}/a.lines, line 2", "has no coordinate, but one is needed")
    ]
    assert len(report.errors) == 1
    assert report.class_counts == {"dashed": 1, "solid": 1}
    assert report.left_out == {"stop": 1}
    assert report.pictures == tuple(Picture(f"{i}.png", tmp_path / f"{i}.png") for i in (1, 3, 4))


def test_a_dataset_of_nothing_but_broken_labels_is_reported_too(tmp_path: Path):
    (tmp_path / "a.lines").write_text("nonsense\n")
    report = check(Lines(tmp_path, skip_broken=True))
    assert (report.samples, report.polylines, report.counts) == (0, 0, {"broken label": 1})
    assert [o.segments for o in report.occupancy] == [0, 0, 0]


def test_many_samples_are_examined_in_groups_without_being_mixed_up(monkeypatch):
    rng = np.random.default_rng(0)
    samples = [
        sample(str(i), *(rng.uniform(-20, 120, (rng.integers(0, 4), 2)) for _ in range(rng.integers(0, 4))))
        for i in range(30)
    ]
    whole = check(Listed(*samples))
    monkeypatch.setattr("yolino.datasets.check._TOGETHER", 7)
    assert check(Listed(*samples)) == whole
    alone = [check(Listed(one)) for one in samples]
    assert whole.findings == tuple(f for report in alone for f in report.findings)
    assert len(whole.findings) > 20
    assert whole.occupancy == tuple(
        sum(rest, first) for first, *rest in zip(*(r.occupancy for r in alone), strict=True)
    )


def test_a_report_becomes_a_document_that_json_knows():
    document = check(Listed(sample("a", GOOD, GOOD)), (32,), 3).to_document()
    assert json.loads(json.dumps(document)) == document
    assert document["findings"] == [
        {"kind": "duplicate polyline", "sample": "a", "detail": "polyline 1 is polyline 0"}
    ]
    assert document["counts"] == {"duplicate polyline": 1}
    assert (document["errors"], document["polylines"], document["classes"]) == (0, 2, {"lane": 2})
    assert document["sizes"] == [{"size": [64, 128], "images": 1}]
    assert document["occupancy"][0]["predictors"] == 3


def test_labels_are_counted_and_unknown_ones_found():
    lines = [[1, 1], [9, 9]], [[1, 20], [9, 9]], [[1, 30], [9, 9]]
    dataset = Listed(sample("a", *lines, labels=[1, 1, 2]), classes=("solid", "dashed"))
    report = check(dataset)
    assert report.class_counts == {"solid": 0, "dashed": 2}
    assert [(f.kind, f.detail) for f in report.findings] == [
        ("unknown label", "polyline 2 has label 2 of 2 classes")
    ]


def test_occupancy_counts_segments_cells_and_surplus():
    lines = [[[1, y], [40, y]] for y in (1, 2, 3)]
    (thirty_two, sixteen) = check(Listed(sample("a", *lines), sample("b", *lines)), (32, 16), 2).occupancy
    assert (thirty_two.segments, thirty_two.cells, thirty_two.fullest, thirty_two.surplus) == (12, 4, 3, 4)
    assert (sixteen.segments, sixteen.cells, sixteen.fullest, sixteen.surplus) == (18, 6, 3, 6)
    assert (sixteen.stride, sixteen.predictors) == (16, 2)


def test_occupancy_is_counted_in_the_network_frame():
    halved = np.diag([0.5, 0.5, 1.0])
    dataset = Listed(sample("a", [[1, 10], [127, 10]]))
    assert check(dataset, (16,)).occupancy[0].segments == 8
    assert check(dataset, (16,), matrix=halved, size=(32, 64)).occupancy[0].segments == 4
    fitted = check(dataset, (16,), matrix=lambda image: fit_matrix(image, (32, 64), "stretch"), size=(32, 64))
    assert fitted.occupancy[0].segments == 4


def test_images_whose_size_the_stride_does_not_divide_are_filled_up():
    image = np.zeros((60, 120, 3), np.uint8)
    assert check(Listed(sample("a", [[1, 59], [119, 59]], image=image)), (32,)).occupancy[0].segments == 4


def test_a_network_frame_needs_matrix_and_size():
    for arguments in ({"size": (32, 64)}, {"matrix": np.eye(3)}):
        with pytest.raises(ValueError, match="both matrix and size"):
            check(Listed(sample("a", GOOD)), **arguments)
        with pytest.raises(ValueError, match="both matrix and size"):
            deviation_table(Listed(sample("a", GOOD)), **arguments)


@pytest.mark.parametrize("function", [check, deviation_table])
def test_an_empty_dataset_is_named(function):
    with pytest.raises(ValueError, match="no samples"):
        function(Listed())


def test_every_index_goes_through_the_progress_bar():
    seen = []

    def progress(indices):
        for i in indices:
            seen.append(i)
            yield i

    dataset = Listed(sample("a", GOOD), sample("b", GOOD))
    check(dataset, progress=progress)
    deviation_table(dataset, progress=progress)
    assert seen == [0, 1, 0, 1]


def test_errors_are_kinds():
    assert set(KINDS) > ERRORS


def test_deviation_is_zero_for_straight_lines_from_border_to_border():
    for row in deviation_table(Listed(sample("a", [[0, 8], [128, 24]]))):
        assert row.border_px == pytest.approx(0, abs=1e-9)
        assert row.points_px == pytest.approx(0, abs=1e-9)
        assert row.lost == 0


def test_deviation_of_dropped_and_extended_ends_equals_the_computation_by_hand():
    # Extended by 4 px at the left, 8 px dropped at the right: 48 px remain 44 + 4.
    (row,) = deviation_table(Listed(sample("a", [[4, 8], [56, 8]])), (16,))
    there = (8 * 4) / 52  # the mean over 8 px of 0 ... 8
    back = (4 * 2) / 48
    assert row.border_px == pytest.approx((there + back) / 2)
    assert row.points_px == pytest.approx(0, abs=1e-9)
    assert (row.stride, row.segments, row.lost) == (16, 3, 0)


def test_lost_polylines_are_counted_and_samples_without_labels_do_not_count(caplog):
    short = [[2, 2], [5, 5]]
    dataset = Listed(sample("a", [[0, 8], [128, 8]], short), sample("b"), sample("c", [[-9, -9], [-1, -1]]))
    (row,) = deviation_table(dataset, (16,))
    # The short line, 4.2 px of 132.2, lies 6 to 3 px above the other.
    weight = np.hypot(3, 3)
    assert row.border_px == pytest.approx(weight * 4.5 / (128 + weight) / 2, rel=1e-3)
    assert row.lost == 1
    assert not caplog.records
    (row,) = deviation_table(Listed(sample("a", short)), (16,))
    assert np.isnan(row.border_px)
    assert row.points_px == pytest.approx(0, abs=1e-9)
    assert "1 samples have no segment" in caplog.text


def test_the_real_labels_are_sound_and_deviate_less_than_in_the_paper(tusimple_root: Path):
    dataset = TuSimple(tusimple_root, "label_data_0531.json", classes=True)
    frame = {"matrix": fit_matrix((720, 1280), (320, 640), "bottom"), "size": (320, 640)}
    report = check(dataset, **frame)
    assert report.findings == ()
    assert report.sizes == {(720, 1280): 34}
    assert [o.surplus for o in report.occupancy] == [0, 0, 0]
    for row, paper in zip(deviation_table(dataset, **frame), (1.40, 0.42, 0.14), strict=True):
        assert 0 < row.points_px < row.border_px < paper
        assert row.lost == 0
