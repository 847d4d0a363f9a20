from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from striped_model import make_striped_model, striped_header
from yolino.benchmark import SECTIONS
from yolino.cli import benchmark as command

from .conftest import Run


def test_json_is_one_object_and_nothing_else(run: Run, model: Path) -> None:
    code, out, err = run("benchmark", "--model", model, "--quick", "--only", "stages", "--json")
    assert (code, err) == (0, "")
    assert out.count("\n") == 1
    assert list(json.loads(out)["sections"]) == ["stages"]


def test_without_json_it_is_a_report(run: Run, model: Path) -> None:
    code, out, _ = run("benchmark", "--model", model, "--quick", "--only", "discretize", "--repeats", "1")
    assert code == 0
    assert "discretize" in out
    assert "QUICK" in out


def test_the_help_names_every_section(run: Run) -> None:
    assert tuple(SECTIONS) == command.SECTIONS
    code, out, _ = run("benchmark", "--help")
    assert code == 0
    assert all(re.search(rf"\b{name}\b", out) for name in SECTIONS)


def test_summary_and_json_exclude_each_other(run: Run) -> None:
    code, out, err = run("benchmark", "--summary", "--json")
    assert (code, out) == (2, "")
    assert err == "Error: --summary and --json exclude each other: leave one out.\n"


def test_an_unknown_section_is_told(run: Run) -> None:
    code, out, err = run("benchmark", "--only", "everything")
    assert (code, out) == (2, "")
    assert "The section 'everything' of the benchmark is unknown; use one of stages" in err


def test_a_model_that_sees_windows_is_refused(run: Run, tmp_path: Path) -> None:
    pytest.importorskip("onnx", reason="onnx builds the model of this test")
    model = make_striped_model(tmp_path / "striped.onnx", striped_header())
    code, _, err = run("benchmark", "--model", model, "--only", "stages")
    assert code == 2
    assert "striped goes over images in windows" in err
    assert err.count("\n") == 1
