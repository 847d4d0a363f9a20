"""`yolino average` scores and writes, and says in one line what is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from .conftest import Run

pytest.importorskip("lightning", reason="averaging needs the extra train")

TEXT = """
name: tiny
data:
  size: [32, 64]
  train: [{dataset: synthetic, options: {kind: shapes, length: 8, size: [32, 64]}}]
  val: [{dataset: synthetic, options: {kind: shapes, length: 2, seed: 9, size: [32, 64]}}]
model:
  backbone: residual
  backbone_args: {widths: [4, 4, 8, 8], blocks: [1, 1, 1, 1], stem: 4}
  neck_width: 8
  predictors: 2
augment: {preset: none}
training: {steps: 1, batch_size: 2, accelerator: cpu, devices: 1, workers: 0}
"""


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from yolino.training.run import train

    folder = tmp_path_factory.mktemp("trained")
    config = folder / "tiny.yaml"
    config.write_text(TEXT)
    for name in ("a", "b"):
        train(config, [f"name={name}", f"out={folder}"], progress=False)
    return folder


@pytest.fixture(autouse=True)
def lenient(monkeypatch: pytest.MonkeyPatch) -> None:
    """One step teaches a network nothing: what it finds, and its average, is chance."""
    monkeypatch.setattr("yolino.training.averaging.LEAST_SHARE", 0.0)


def test_all_are_scored_and_the_average_is_named(run: Run, trained: Path, tmp_path: Path) -> None:
    ends = [trained / name / "last.safetensors" for name in "ab"]
    code, out, err = run("average", *ends, "name=both", "--out", "mean.safetensors", "--images", 2)
    assert (code, err) == (0, "")
    rows = [line for line in out.splitlines() if "last.safetensors" in line or "│ average" in line]
    assert len(rows) == 3
    assert "`yolino export mean.safetensors`" in out
    code, out, err = run("export", "mean.safetensors")
    assert (code, err) == (0, "")
    assert (tmp_path / "mean.onnx").is_file()


def test_the_experiment_file_may_be_named(run: Run, trained: Path, tmp_path: Path) -> None:
    for name in "ab":
        (tmp_path / f"{name}.safetensors").write_bytes((trained / name / "last.safetensors").read_bytes())
    command = ["average", "a.safetensors", "b.safetensors", "--out", "mean.safetensors", "--images", 2]
    code, out, err = run(*command)
    assert (code, out) == (2, "")
    assert err.startswith("Error: There is no experiment.yaml beside a.safetensors")
    assert len(err.splitlines()) == 1
    assert run(*command, "--config", trained / "tiny.yaml", f"out={tmp_path}")[0] == 0


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--images", "0"], "--images"),
        (["trainin.steps=3"], "trainin"),
        (["--config", "nowhere.yaml"], "The experiment file nowhere.yaml does not exist"),
        (["nowhere.safetensors"], "nowhere.safetensors does not exist"),
        (["data.val.0.options.kind=rods"], "rods"),
        (["--out", "mean.onnx"], "must be a file that ends in .safetensors"),
    ],
)
def test_a_mistake_is_one_line_and_writes_nothing(
    run: Run, trained: Path, tmp_path: Path, more: list[str], message: str
) -> None:
    ends = [trained / name / "last.safetensors" for name in "ab"]
    code, out, err = run("average", *ends, "--out", "mean.safetensors", *more)
    assert (code, out) == (2, "")
    assert message in err
    assert not list(tmp_path.glob("mean*"))
