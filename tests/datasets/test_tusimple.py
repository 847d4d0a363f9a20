from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.datasets.tusimple import (
    CLASSES,
    TuSimple,
    polylines_to_record,
    read_records,
    record_to_polylines,
    write_records,
)
from yolino.types import Polylines

ROWS = [10, 20, 30, 40]
RECORD = {
    "raw_file": "clips/a/20.jpg",
    "lanes": [[-2, 7, 6, 5], [9, -2, 11, -2], [-2, -2, -2, -2], [-2, -2, 3, -2]],
    "h_samples": ROWS,
    "classes": "1 3 4 7",
}


def write_labels(root: Path, *records: object, name: str = "label_data_1.json") -> Path:
    (root / "clips/a").mkdir(parents=True, exist_ok=True)
    (root / "clips/a/20.jpg").write_bytes(b"an image")
    path = root / name
    path.write_text("".join((r if isinstance(r, str) else json.dumps(r)) + "\n" for r in records))
    return path


def as_lists(polylines: Polylines) -> list[list[list[float]]]:
    return [p.tolist() for p in polylines]


def test_lanes_run_through_pixel_centers_from_bottom_to_top(tmp_path):
    write_labels(tmp_path, RECORD)
    dataset = TuSimple(tmp_path)
    assert len(dataset) == 1
    sample = dataset[0]
    assert sample.name == "clips/a/20.jpg"
    assert sample.image == tmp_path / "clips/a/20.jpg"
    assert as_lists(sample.polylines) == [
        [[5.5, 40.5], [6.5, 30.5], [7.5, 20.5]],
        [[11.5, 30.5], [9.5, 10.5]],
        [[3.5, 30.5]],
    ]
    assert sample.polylines.labels.tolist() == [0, 0, 0]
    assert dataset.classes == ("lane",)
    assert dataset.directed
    assert [s.name for s in dataset] == ["clips/a/20.jpg"]


def test_classes_become_labels_and_skip_with_their_lane(tmp_path):
    write_labels(tmp_path, RECORD)
    dataset = TuSimple(tmp_path, classes=True)
    assert dataset.classes == CLASSES
    assert [CLASSES[i] for i in dataset[0].polylines.labels] == ["continuous yellow", "dashed", "unknown"]


def test_rows_may_come_in_any_order():
    record = {"raw_file": "a", "lanes": [[5, -2, 7]], "h_samples": [40, 10, 20]}
    assert as_lists(record_to_polylines(record)) == [[[5.5, 40.5], [7.5, 20.5]]]


def test_records_stay_as_they_are_for_the_official_metric(tmp_path):
    path = write_labels(tmp_path, RECORD)
    assert TuSimple(tmp_path, path).record(0) == RECORD
    assert read_records(path) == [RECORD]


def test_label_files_are_found_named_or_listed(tmp_path):
    write_labels(tmp_path, RECORD)
    other = write_labels(tmp_path, RECORD, RECORD, name="label_data_2.json")
    write_labels(tmp_path, RECORD, RECORD, RECORD, name="test_label.json")
    assert len(TuSimple(tmp_path)) == 3
    assert len(TuSimple(tmp_path, "label_data_2.json")) == 2
    assert len(TuSimple(str(tmp_path), other)) == 2
    assert len(TuSimple(tmp_path, ["test_label.json", other])) == 5


def test_empty_lines_are_no_records(tmp_path):
    write_labels(tmp_path, "", RECORD, "  ", RECORD)
    assert len(TuSimple(tmp_path)) == 2


def changed(**fields: object) -> dict[str, object]:
    return {**RECORD, **fields}


BAD = {
    "not valid JSON": "{'raw_file': 1}",
    "holds a list": [1, 2],
    "lacks lanes, h_samples": {"raw_file": "a.jpg"},
    "has raw_file 7": changed(raw_file=7),
    "has lanes of type str": changed(lanes="12"),
    "lane 1 is a int": changed(lanes=[[1, 2, 3, 4], 5]),
    "lane 0 has 3 values, but h_samples has 4": changed(lanes=[[1, 2, 3]]),
    "lane 0 holds nan": changed(lanes=[[1, 2, float("nan"), 4]]),
    "h_samples holds inf": changed(h_samples=[10, 20, 30, float("inf")]),
    "lane 0 holds '3'": changed(lanes=[[1, 2, "3", 4]]),
    "lane 0 holds None": changed(lanes=[[1, 2, None, 4]]),
    "lane 0 holds True": changed(lanes=[[1, 2, True, 4]]),
    "lane 0 holds 1000000000": changed(lanes=[[1, 2, 10**400, 4]]),
}


@pytest.mark.parametrize("reason", BAD)
def test_a_bad_line_is_named(tmp_path, reason):
    path = write_labels(tmp_path, RECORD, "", BAD[reason])
    with pytest.raises(ValueError, match="line 3") as caught:
        TuSimple(tmp_path)
    assert str(path) in str(caught.value)
    assert reason in str(caught.value)


def test_bytes_that_are_no_text_are_named(tmp_path):
    path = write_labels(tmp_path, RECORD)
    path.write_bytes(b"\xff\xfe\x00{}")
    with pytest.raises(ValueError, match="line 1 is not valid JSON"):
        TuSimple(tmp_path)


def test_nesting_without_end_is_named(tmp_path):
    write_labels(tmp_path, "[" * 200_000)
    with pytest.raises(ValueError, match="line 1 is not valid JSON"):
        TuSimple(tmp_path)


@pytest.mark.parametrize(
    ("classes", "reason"),
    [
        (None, "has no classes"),
        ("1 2", "has 2 classes for 4 lanes"),
        ("1 2 3 8", "'8'"),
        ("0 1 1 1", "'0'"),
        ("1 x 1 1", "'x'"),
    ],
)
def test_bad_classes_are_named(tmp_path, classes, reason):
    record = (
        {k: v for k, v in RECORD.items() if k != "classes"} if classes is None else changed(classes=classes)
    )
    write_labels(tmp_path, record)
    assert len(TuSimple(tmp_path)) == 1
    with pytest.raises(ValueError, match="line 1") as caught:
        TuSimple(tmp_path, classes=True)
    assert reason in str(caught.value)


@pytest.mark.parametrize("text", ["", "\n \n"])
def test_an_empty_label_file_is_named(tmp_path, text):
    (tmp_path / "label_data_1.json").write_text(text)
    with pytest.raises(ValueError, match=r"label_data_1\.json has no records"):
        TuSimple(tmp_path)


def test_a_missing_image_is_named_unless_images_are_not_required(tmp_path):
    write_labels(tmp_path, RECORD, changed(raw_file="clips/a/21.jpg"))
    with pytest.raises(FileNotFoundError, match=r"line 2 names the image .*clips/a/21.jpg"):
        TuSimple(tmp_path)
    assert len(TuSimple(tmp_path, require_images=False)) == 2


def test_missing_folders_and_files_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="no folder"):
        TuSimple(tmp_path / "nowhere")
    with pytest.raises(FileNotFoundError, match=r"no labels like label_data\*\.json"):
        TuSimple(tmp_path)
    with pytest.raises(FileNotFoundError, match=r"no label file .*labels\.json"):
        TuSimple(tmp_path, "labels.json")
    with pytest.raises(ValueError, match="list of label files is empty"):
        TuSimple(tmp_path, [])


def record_of(*lines: list[list[float]], rows: list[int] = ROWS, **options: object) -> list[list[float]]:
    return polylines_to_record(
        "a.jpg", Polylines.from_list([np.array(v, float) for v in lines]), rows, **options
    )["lanes"]


@settings(deadline=None)
@given(
    st.lists(
        st.lists(st.integers(0, 1279), min_size=2, max_size=8).flatmap(
            lambda xs: st.tuples(st.just(xs), st.integers(0, 12 - len(xs)))
        ),
        max_size=4,
    )
)
def test_writing_what_was_read_is_the_identity(lanes):
    rows = list(range(160, 280, 10))
    records = [[-2] * start + xs + [-2] * (12 - start - len(xs)) for xs, start in lanes]
    record = {"raw_file": "clips/1/20.jpg", "lanes": records, "h_samples": rows}
    found = polylines_to_record("clips/1/20.jpg", record_to_polylines(record), rows, run_time=7.0)
    assert found == {**record, "run_time": 7.0}


def test_rows_between_vertices_are_interpolated_and_others_stay_empty():
    assert record_of([[5.5, 35.5], [15.5, 15.5]]) == [[-2, 12.5, 7.5, -2]]


def test_the_direction_of_a_polyline_does_not_matter():
    assert record_of([[15.5, 15.5], [5.5, 35.5]]) == [[-2, 12.5, 7.5, -2]]


def test_the_first_crossing_from_the_lower_end_counts():
    hairpin = [[5.5, 40.5], [5.5, 15.5], [25.5, 15.5], [25.5, 32.5]]
    assert record_of(hairpin) == [[-2, 5, 5, 5]]
    assert record_of(hairpin[::-1]) == [[-2, 5, 5, 5]]


def test_a_level_piece_counts_with_its_first_point():
    assert record_of([[3.5, 45.5], [3.5, 30.5], [90.5, 30.5], [90.5, 25.5]]) == [[-2, -2, 3, 3]]


def test_what_leaves_the_image_is_none():
    assert record_of([[-9.5, 40.5], [20.5, 10.5]], size=(50, 16)) == [[-2, 10, 0, -2]]
    # The first half pixel is inside, but negative numbers mean none.
    assert record_of([[0.1, 40.5], [0.1, 10.5]]) == [[0, 0, 0, 0]]


def test_polylines_without_any_row_are_left_out():
    none = [[[5.5, 38.0], [5.5, 32.0]], [[-5.0, 40], [-5, 10]], [[1.0, 1.0]], np.zeros((0, 2))]
    assert record_of(*none) == []
    assert record_of() == []


def test_ends_can_be_extended_straight_on():
    line = [[10.5, 30.5], [20.5, 20.5], [20.5, 20.5]]
    assert record_of(line) == [[-2, 20, 10, -2]]
    assert record_of(line, extend_px=5.0) == [[-2, 20, 10, -2]]
    assert record_of(line, extend_px=15.0) == [[30, 20, 10, 0]]
    assert record_of([[5.5, 20.5]], extend_px=15.0) == [[-2, 5, -2, -2]]


def test_vertices_that_are_not_finite_are_named():
    with pytest.raises(ValueError, match=r"a\.jpg has a vertex that is not finite"):
        record_of([[np.nan, 1], [2, 2]])


def test_submission_files_are_read_back(tmp_path):
    records = [
        polylines_to_record(f"{i}.jpg", Polylines.from_list([[[5.25, 50], [7, 1]]]), ROWS) for i in range(3)
    ]
    write_records(tmp_path / "predictions.json", records)
    assert read_records(tmp_path / "predictions.json") == records
    assert len((tmp_path / "predictions.json").read_text().splitlines()) == 3


def test_the_real_labels_survive_reading_and_writing(tusimple_root):
    for name, count in (("label_data_0313.json", 200), ("label_data_0531.json", 34)):
        dataset = TuSimple(tusimple_root, name, classes=True)
        assert len(dataset) == count
        for i, sample in enumerate(dataset):
            record = dataset.record(i)
            lanes = [lane for lane in record["lanes"] if max(lane) >= 0]
            assert polylines_to_record(sample.name, sample.polylines, record["h_samples"])["lanes"] == lanes
