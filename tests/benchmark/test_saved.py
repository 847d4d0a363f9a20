"""A saved result is read whole or refused, and is reported and drawn as a new one."""

from __future__ import annotations

import json
from typing import Any

import pytest

from benchmark_results import growth, small_result
from yolino.benchmark import benchmark, read_result, report


@pytest.fixture
def write(tmp_path):
    def write(value: Any):
        path = tmp_path / "result.json"
        path.write_text(value if isinstance(value, str) else json.dumps(value))
        return path

    return write


def test_what_was_measured_is_read_again(write):
    result = benchmark(only=["discretize"], quick=True)
    assert read_result(write(result)) == result
    assert report(read_result(write(result))) == report(result)


def test_a_result_from_before_there_were_curves_is_read(write):
    result = small_result()
    for section in result["sections"].values():
        del section["curves"]
    assert "### NMS (`nms`)" in report(read_result(write(result)))


@pytest.mark.parametrize(
    ("broken", "reason"),
    [
        ("", "it is no JSON"),
        ('{"machine": ', "it is no JSON"),
        ("[]", "the whole: "),
        ("{}", "machine: Field required"),
        (small_result() | {"sections": {"nms": {}}}, "sections.nms.title: Field required"),
        (small_result() | {"targets": None}, "targets: "),
    ],
)
def test_a_broken_file_is_told_in_a_sentence(write, broken, reason):
    with pytest.raises(ValueError, match=r"result\.json is no result of `yolino benchmark --json`") as error:
        read_result(write(broken))
    assert reason in str(error.value)
    assert "\n" not in str(error.value)


def test_a_file_in_no_encoding_is_told(tmp_path):
    (tmp_path / "a.json").write_bytes(b"\xff\xfe\x80")
    with pytest.raises(ValueError, match="it is no JSON"):
        read_result(tmp_path / "a.json")


def test_a_file_that_is_not_there_is_told(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nowhere\.json does not exist; give what"):
        read_result(tmp_path / "nowhere.json")


def test_curves_are_reported_as_tables_with_a_column_for_each_size():
    lines = report(small_result(growth=growth(3))).splitlines()
    start = lines.index("**NMS**: time ~ n^1.00")  # memory of .01 to 1 MB: too little for an exponent
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[start + 2 : start + 6]]
    assert cells[0] == ["candidates", "10", "100", "1,000"]
    assert cells[2] == ["ms", "0.2", "2", "20"]
    assert cells[3] == ["MB", "0.0", "0.1", "1.0"]
    start = lines.index("**linker graph**: time ~ n^2.00")
    assert lines[start + 2].split("|")[2].strip() == "10x1"
    assert lines[start + 5].split("|")[2].strip() == "-"
