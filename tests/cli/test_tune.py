from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from yolino.inference import load

from .conftest import Run

ROWS = list(range(160, 720, 10))
FEW = ("--trials", 20, "--folds", 2, "--only", "linker_options.min_length_cells")


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    """Three frames whose lanes are where the tiny model sees none."""
    root = tmp_path / "data"
    records = []
    for i in range(3):
        name = f"clips/{i}/20.png"
        (root / name).parent.mkdir(parents=True)
        cv2.imwrite(str(root / name), np.full((720, 1280, 3), 200, np.uint8))
        records.append({"raw_file": name, "lanes": [[100 + 10 * i] * len(ROWS)], "h_samples": ROWS})
    (root / "label_data_a.json").write_text("".join(json.dumps(record) + "\n" for record in records))
    return root


def test_the_settings_are_printed_for_an_experiment_file(run: Run, model: Path, dataset: Path) -> None:
    code, out, err = run("tune", model, "--root", dataset, *FEW)
    assert (code, err) == (0, "")
    assert "alone gives" in out
    assert "images that it was not tuned on (2 blocks" in out
    section = yaml.safe_load(out[out.index("postprocess:") :])["postprocess"]
    assert section["linker_options"]["min_length_cells"] > 4
    assert section["threshold"] == 0.5


def test_a_new_model_is_written_and_the_old_one_stays(run: Run, model: Path, dataset: Path) -> None:
    before = model.read_bytes()
    code, out, _ = run("tune", model, "--root", dataset, *FEW, "--out", "new/tuned.onnx")
    assert code == 0
    assert "The model with the new settings is new/tuned.onnx." in out
    assert model.read_bytes() == before
    header = load("new/tuned.onnx").header
    assert header.postprocess["linker_options"]["min_length_cells"] > 4
    assert header.metrics["tuning"]["images"] == 3
    bright = np.full((64, 128, 3), 200, np.uint8)
    assert (len(load(model)(bright)), len(load("new/tuned.onnx")(bright))) == (2, 0)


def test_both_files_of_openvino_are_written(run: Run, model: Path, dataset: Path) -> None:
    pytest.importorskip("openvino", reason="OpenVINO writes and reads the files of this test")
    run("export", model, "--format", "openvino")
    code, _, err = run("tune", "tiny.xml", "--root", dataset, *FEW, "--out", "tuned.xml")
    assert (code, err) == (0, "")
    assert load("tuned.xml").header.postprocess["linker_options"]["min_length_cells"] > 4


def test_json_is_one_object_and_nothing_else(run: Run, model: Path, dataset: Path) -> None:
    code, out, err = run("tune", model, "--root", dataset, *FEW, "--json")
    assert (code, err, out.count("\n")) == (0, "", 1)
    found = json.loads(out)
    assert found["changes"]["linker_options.min_length_cells"]["before"] == 2.0
    assert found["scores"]["before"]["fp"] == 1
    assert found["cross_validated_gain"][0] > 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["none.onnx", "--root", "data"], "The model none.onnx does not exist"),
        (["nothing", "--root", "data"], "The model 'nothing' is unknown"),
        (["tiny.onnx"], "Tuning needs labelled images: name them with --data"),
        (["tiny.onnx", "--root", "data"], "5 folds need as many images or more, but the dataset has 3"),
        (["tiny.onnx", "--root", "data", "--metric", "f2"], "The metric 'f2' is unknown"),
        (["tiny.onnx", "--root", "data", "--linker", "net"], "The linker 'net' is unknown"),
        (["tiny.onnx", "--root", "data", "--only", "treshold"], "did you mean 'threshold'"),
        (["tiny.onnx", "--root", "data", "--out", "a.xml"], "a.xml must end in .onnx"),
        (["tiny.onnx", "--root", "data", "--groups", "drive"], "The grouping 'drive' is unknown; use auto"),
        (["tiny.onnx", "--data", "none.yaml"], "none.yaml"),
    ],
)
def test_a_mistake_is_one_sentence(
    arguments: list[str], message: str, run: Run, model: Path, dataset: Path
) -> None:
    code, out, err = run("tune", *arguments)
    assert (code, out) == (2, "")
    assert message in err
    assert err.count("\n") == 1
