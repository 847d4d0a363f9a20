"""`yolino sweep` lists, runs, prints and explains."""

from __future__ import annotations

from pathlib import Path

import pytest

BASE = """
name: base
data:
  size: [64, 96]
  train: [{dataset: synthetic, options: {kind: shapes, length: 9, size: [64, 96]}}]
  val: [{dataset: synthetic, options: {kind: shapes, length: 2, size: [64, 96]}}]
model: {backbone: residual, backbone_args: {widths: [8, 8, 8, 8], stem: 4}, neck_width: 8, predictors: 2}
augment: {preset: none}
training: {steps: 1, batch_size: 1, accelerator: cpu, devices: 1}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    path = tmp_path / "trials"
    path.mkdir()
    (path / "one.yaml").write_text(BASE)
    (path / "two.yaml").write_text("base: one.yaml\ndata: {train: [{data: nowhere}]}")
    return path


def test_a_dry_run_lists_the_runs(run, folder):
    code, text, _ = run("sweep", folder, "training.steps=3", "--seeds", "0,2", "--dry-run")
    assert code == 0
    lines = text.splitlines()
    assert lines[0] == "[1 of 4] one, seed 0, 3 steps: to run"
    assert lines[1].startswith("[2 of 4] two, seed 0, 3 steps: not run: There is no data description nowhere")
    assert lines[2] == "[3 of 4] one, seed 2, 3 steps: to run"
    assert not Path("runs").exists()


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning", "ignore::UserWarning")
def test_it_runs_and_prints_a_table(run, folder, tmp_path):
    code, text, told = run("sweep", folder)
    assert code == 0, told
    assert "[1 of 2] one, seed 0: begins, 1 steps" in told
    assert "Rec" in text
    assert "two, seed 0: not run: There is no data description nowhere" in text
    assert {path.name for path in Path("runs/sweep").iterdir()} >= {
        "table.md",
        "table.csv",
        "table.json",
        "runs",
    }
    before = Path("runs/sweep/table.md").read_text()
    Path("runs/sweep/table.md").unlink()
    code, text, _ = run("sweep", folder, "--table")
    assert code == 0
    assert Path("runs/sweep/table.md").read_text() == before
    code, _, told = run("sweep", folder, "training.steps=2")
    assert code == 2
    assert "other settings (training.steps)" in told


def test_a_failure_is_told_at_the_end(run, folder):
    (folder / "two.yaml").write_text("base: one.yaml\ntraining: {start_from: nothing.safetensors}")
    code, _, told = run("sweep", folder, "--only", "two", "--out", "here")
    assert code == 1
    assert told.splitlines()[-1].startswith("Error: two-seed0 failed: ")
    assert Path("here/runs/two-seed0/problem.txt").is_file()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--seeds", "a"], "--seeds is 'a', but must be whole numbers"),
        (["--table", "--dry-run"], "--table runs nothing: leave out"),
        (["--table"], "There is no folder runs/sweep"),
        (["--only", "on"], "no row 'on'; did you mean 'one'?"),
    ],
)
def test_mistakes_are_told_in_a_line(run, folder, arguments, message):
    code, _, told = run("sweep", folder, *arguments)
    assert code == 2
    assert message in told
    assert len(told.splitlines()) == 1
