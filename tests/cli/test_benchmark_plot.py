from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import pytest

from benchmark_results import small_result

from .conftest import Run


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    path = tmp_path / "result.json"
    path.write_text(json.dumps(small_result()))
    return path


def test_a_saved_result_is_reported_and_drawn_without_measuring(run: Run, saved: Path) -> None:
    pytest.importorskip("matplotlib", reason="matplotlib draws the plots")
    code, out, err = run("benchmark", "--from", saved, "--plot", "pictures")
    assert code == 0
    assert "**linker graph**: time ~ n^2.00" in out
    assert err.splitlines() == [
        f"Wrote pictures/{name}.png" for name in ("frame", "races", "growth", "engines", "roofline")
    ]
    assert (saved.parent / "pictures" / "growth.png").is_file()


def test_a_saved_result_is_printed_as_json_again(run: Run, saved: Path) -> None:
    code, out, err = run("benchmark", "--from", saved, "--json")
    assert (code, err) == (0, "")
    assert json.loads(out) == small_result()


def test_a_broken_result_is_one_line(run: Run, tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text("{")
    for name in ("a.json", "b.json"):
        code, out, err = run("benchmark", "--from", name)
        assert (code, out) == (2, "")
        assert err.startswith(f"Error: {name} ")
        assert err.count("\n") == 1


def test_a_saved_result_and_options_of_measuring_exclude_each_other(run: Run, saved: Path) -> None:
    code, _, err = run("benchmark", "--from", saved, "--quick")
    assert (code, err.count("\n")) == (2, 1)
    assert "leave out --only, --image, --threads and --quick" in err


def test_a_folder_in_place_of_a_result_is_one_line(run: Run, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    code, out, err = run("benchmark", "--from", "folder")
    assert (code, out) == (2, "")
    assert err == "Error: folder is a folder; give a file with what `yolino benchmark --json` printed.\n"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--only", "nms", "--plot", "result.json"), "result.json is a file, but the pictures need a folder"),
        (("--only", "startup", "--plot", "new"), "Nothing can be drawn of startup: measure stages, nms, "),
        (("--only", "starting", "--plot", "new"), "The section 'starting' of the benchmark is unknown"),
    ],
)
def test_a_plot_that_cannot_be_is_told_before_measuring(
    run: Run, saved: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], told: str
) -> None:
    pytest.importorskip("matplotlib", reason="matplotlib draws the plots")
    monkeypatch.setattr("yolino.benchmark.run.describe_machine", lambda *_: pytest.fail("it measures"))
    code, out, err = run("benchmark", *arguments)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err.startswith(f"Error: {told}")
    assert not (saved.parent / "new").exists()


def test_without_matplotlib_nothing_is_measured(
    run: Run, saved: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda n, *a: None if n == "matplotlib" else find(n, *a))
    code, out, err = run("benchmark", "--from", saved, "--plot", "pictures")
    assert (code, out) == (2, "")
    assert err == "Error: Plots need matplotlib: pip install 'yolino[plot]'.\n"
