"""A saved result is read whole or refused, and is reported and drawn as a new one."""

from __future__ import annotations

import json
from typing import Any

import pytest

from benchmark_results import growth, small_result
from yolino.benchmark import benchmark, read_result, report


def changed(*path_and_value: Any) -> dict[str, Any]:
    """Gives the small result with another value at a path."""
    result = small_result()
    *path, last, value = path_and_value
    part: Any = result
    for name in path:
        part = part[name]
    part[last] = value
    return result


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
        ("[]", "(the whole: it must be an object)"),
        ("{}", "(machine: it is missing)"),
        (small_result() | {"sections": {"nms": {}}}, "(sections.nms.title: it is missing)"),
        (small_result() | {"targets": None}, "(targets: it must be an object)"),
        (changed("machine", "cores", "many"), "(machine.cores: it must be a whole number)"),
        (changed("model", "size", 3), "(model.size: it must be a list)"),
        (changed("model", "size", [1, 2, 3]), "(model.size: it is not what the benchmark writes)"),
        (changed("settings", "image", 1), "(settings.image: it must be a text)"),
        (changed("settings", "quick", "perhaps"), "(settings.quick: it must be true or false)"),
        (changed("machine", "load", "high"), "(machine.load: it must be a number)"),
        (
            changed("sections", "nms", "measures", "ours_500", "value", "fast"),
            "(sections.nms.measures.ours_500.value: it must be a number, true or false)",
        ),
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


def test_a_folder_is_told(tmp_path):
    with pytest.raises(ValueError, match=r" is a folder; give a file with what `yolino benchmark --json`"):
        read_result(tmp_path)


def last_cell(lines: list[str]) -> str:
    (row,) = (line for line in lines if line.startswith("| 500: faster "))
    return row.split("|")[-2].strip()


@pytest.mark.parametrize("met", [True, False])
def test_a_quick_run_judges_no_targets(met):
    result = small_result()
    result["sections"]["nms"]["measures"]["speedup_500"]["met"] = met
    result["targets"]["met" if met else "missed"] = ["nms.speedup_500"]
    lines = report(result).splitlines()
    assert lines[-1] == ("1 of 1 targets met." if met else "0 of 1 targets met; missed: nms.speedup_500.")
    assert last_cell(lines) == ("yes" if met else "NO")
    result["settings"]["quick"] = True
    lines = report(result).splitlines()
    assert lines[-1] == "A quick run judges no targets."
    assert last_cell(lines) == ""
    result["targets"]["not_measured"] = ["paper"]
    assert report(result).splitlines()[-1] == "A quick run judges no targets; not measured: paper."


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
