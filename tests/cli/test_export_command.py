from __future__ import annotations

from pathlib import Path

import pytest

from convolving_model import convolving_header, make_convolving_model, write_drive

from .conftest import Run

pytest.importorskip("onnx", reason="exporting needs onnx")


@pytest.fixture
def lines(tmp_path: Path) -> Path:
    return make_convolving_model(tmp_path / "lines.onnx", convolving_header())


def test_int8_says_what_it_costs(run: Run, lines: Path, tmp_path: Path) -> None:
    drive = write_drive(tmp_path / "drive")
    command = ["export", lines, "-p", "int8", "--calibrate", drive, "--split", "all", "--images", 3]
    code, out, err = run(*command, "--out", "small.onnx")
    assert (code, err) == (0, "")
    assert out.splitlines()[0].startswith("small.onnx (0.")
    assert "F1 of the polylines on 3 calibration images: 0.9" in out
    assert "(it may fall by 0.01). End points moved by 0." in out


def test_a_folder_is_calibration_data_too(run: Run, lines: Path, tmp_path: Path) -> None:
    folder = write_drive(tmp_path / "drive").parent
    command = ["export", lines, "-p", "int8", "--calibrate", folder, "--split", "all", "--max-drop", 0.5]
    assert run(*command, "--out", "small.onnx")[0] == 0


def test_a_new_threshold_needs_no_torch(run: Run, lines: Path) -> None:
    code, out, err = run("export", lines, "--set", "postprocess.threshold=0.4", "--out", "strict.onnx")
    assert (code, out, err) == (0, "strict.onnx (0.4 MB)\n", "")


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["-f", "caffe"], "format 'caffe' is unknown"),
        (["-p", "int4"], "precision 'int4' is unknown"),
        (["-p", "int8"], "int8 needs labelled images"),
        (["--calibrate", "drive", "--split", "all"], "--calibrate is for int8"),
        (["--split", "all"], "--split is for --calibrate"),
        (["-p", "int8", "--calibrate", "nowhere"], "There is no calibration data nowhere"),
        (["-p", "int8", "--calibrate", "drive", "--split", "some"], "some"),
        (["-p", "int8", "--calibrate", "drive", "--split", "empty"], "none.json has no records"),
        (["--max-drop", "2"], "--max-drop"),
        (["--images", "0"], "--images"),
        (["--compact"], "--compact"),
        (["--set", "precision=int8"], "use --precision"),
        (["--set", "postprocess.rotations=4"], "only windows are turned"),
        (["--set", "postprocess.flip=true", "--set", "fit=window"], "nothing is mirrored"),
        (["--set", "postprocess.linker=grph"], "grph"),
        (["--set", "postprocess.nms={epsilo: 1}"], "epsilo"),
    ],
)
def test_mistakes_are_told_and_leave_nothing(
    run: Run, lines: Path, tmp_path: Path, more: list[str], message: str
) -> None:
    write_drive(tmp_path / "drive", 2)
    code, out, err = run("export", lines, "--out", "new.onnx", *more)
    assert (code, out) == (2, "")
    assert message in err
    assert sorted(file.name for file in tmp_path.iterdir()) == ["drive", "lines.onnx"]
