"""An `.xml` and its `.bin` are replaced such that no moment shows one with another's partner."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from yolino.export.pairs import write_pair

OLD, NEW = ("old graph", b"old weights"), ("new graph", b"new weights!")


def state(xml: Path) -> tuple[str | None, bytes | None]:
    weights = xml.with_suffix(".bin")
    return (
        xml.read_text() if xml.exists() else None,
        weights.read_bytes() if weights.exists() else None,
    )


def write(xml: Path, pair: tuple[str, bytes]) -> None:
    write_pair(xml, pair[0].encode(), pair[1])


def test_a_pair_is_written_and_replaced_without_a_trace(tmp_path: Path) -> None:
    xml = tmp_path / "sub" / "lanes.xml"
    for pair in (OLD, NEW):
        write(xml, pair)
        assert state(xml) == pair
    assert sorted(file.name for file in xml.parent.iterdir()) == ["lanes.bin", "lanes.xml"]


def test_where_the_weights_stay_only_the_graph_is_replaced(tmp_path: Path) -> None:
    xml = tmp_path / "lanes.xml"
    write(xml, OLD)
    before = xml.with_suffix(".bin").stat().st_ino
    write(xml, ("new graph", OLD[1]))
    assert state(xml) == ("new graph", OLD[1])
    assert xml.with_suffix(".bin").stat().st_ino == before


KILL = """
import os, sys
from pathlib import Path
from yolino.export.pairs import write_pair
replace, count = os.replace, int(sys.argv[2])
def stopping(*arguments):
    global count
    count -= 1
    if not count:
        os._exit(9)
    replace(*arguments)
os.replace = stopping
write_pair(Path(sys.argv[1]), b"new graph", b"new weights!")
"""


@pytest.mark.parametrize("had_one", [False, True])
def test_a_run_that_is_killed_at_any_rename_leaves_no_wrong_pair(tmp_path: Path, had_one: bool) -> None:
    seen = []
    for count in range(1, 5 if had_one else 3):
        xml = tmp_path / str(count) / "lanes.xml"
        xml.parent.mkdir()
        if had_one:
            write(xml, OLD)
        command = [sys.executable, "-c", KILL, str(xml), str(count)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 9, done.stderr
        seen.append(state(xml))
        write(xml, NEW)
        assert state(xml) == NEW
    alone = (None, NEW[1])  # a .bin alone is no model
    none = (None, None)
    assert seen == ([OLD, (None, OLD[1]), none, alone] if had_one else [none, alone])


ERRORS = [OSError(28, "No space left on device"), KeyboardInterrupt(), MemoryError()]


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
@pytest.mark.parametrize("late", [False, True], ids=["before", "after"])
@pytest.mark.parametrize("had", ["both", "none", "only the .bin"])
def test_an_error_at_any_rename_leaves_the_old_pair_or_the_new_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, had: str, late: bool, error: BaseException
) -> None:
    replace, renames = os.replace, {"both": 4, "none": 2, "only the .bin": 3}[had]
    for count in range(1, renames + 1):
        xml, calls = tmp_path / str(count) / "lanes.xml", []
        xml.parent.mkdir()
        if had != "none":
            write(xml, OLD)
        if had == "only the .bin":
            xml.unlink()
        before = state(xml)

        def failing(one: Path, other: Path, count: int = count, calls: list[Path] = calls) -> None:
            calls.append(one)
            if late:  # an interrupt may come when the rename is done
                replace(one, other)
            if len(calls) == count:
                raise error
            if not late:
                replace(one, other)

        monkeypatch.setattr(os, "replace", failing)
        with pytest.raises(type(error)) as caught:
            write(xml, NEW)
        monkeypatch.setattr(os, "replace", replace)
        if isinstance(error, OSError):
            assert "lanes.xml and its .bin cannot be written: No space left" in str(caught.value)
        assert len(calls) >= count
        assert state(xml) == (NEW if late and count == renames else before)
        assert not list(xml.parent.glob(".*"))


def test_a_second_interrupt_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    xml, calls, replace = tmp_path / "lanes.xml", [], os.replace
    write(xml, OLD)

    def failing(one: Path, other: Path) -> None:
        calls.append(one)
        if len(calls) >= 4:  # the last rename, and the first that brings the old pair back
            raise KeyboardInterrupt
        replace(one, other)

    monkeypatch.setattr(os, "replace", failing)
    with pytest.raises(KeyboardInterrupt):
        write(xml, NEW)
    assert state(xml) == (None, None)
    assert sorted(file.read_bytes() for file in tmp_path.iterdir()) == sorted([OLD[0].encode(), OLD[1]])


def test_a_place_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match=r"lanes\.xml and its \.bin cannot be written: File exists\."):
        write(tmp_path / "file" / "lanes.xml", NEW)
