"""The curves of a run are read from its logs, over all of its parts, and drawn."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from yolino.sweep import draw_curves, load_sweep, read_rows
from yolino.sweep.curves import last_step, read_curves
from yolino.sweep.result import RUNS


def write_log(folder: Path, version: int, *lines: str) -> None:
    path = folder / "csv" / f"version_{version}" / "metrics.csv"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(["epoch,step,train/loc,val/f1,val/loc", *lines]) + "\n")


def test_a_curve_has_its_steps_and_values(tmp_path):
    write_log(tmp_path, 0, "0,9,0.5,,", "0,10,,0.1,0.7", "1,19,0.4,,", "1,20,,0.2,nan")
    curves = read_curves(tmp_path)
    assert set(curves) == {"train/loc", "val/f1", "val/loc"}
    np.testing.assert_array_equal(curves["val/f1"], [[10, 20], [0.1, 0.2]])
    np.testing.assert_array_equal(curves["train/loc"], [[10, 20], [0.5, 0.4]])
    assert np.isnan(curves["val/loc"][1][1])
    assert last_step(tmp_path) == 20


def test_a_later_part_replaces_what_it_repeats(tmp_path):
    write_log(tmp_path, 9, "0,10,,0.1,", "1,20,,0.2,", "2,30,,0.3,")
    write_log(tmp_path, 10, "2,20,,0.4,", "3,25,,0.5,")
    np.testing.assert_array_equal(read_curves(tmp_path)["val/f1"], [[10, 20, 25], [0.1, 0.4, 0.5]])


def test_a_line_that_a_kill_left_unfinished_does_not_count(tmp_path):
    write_log(tmp_path, 0, "0,10,,0.1,0.7", "1,20,,0.2,0.6")
    path = tmp_path / "csv" / "version_0" / "metrics.csv"
    whole = path.read_text()
    for part in ("2,30,,0.3e-", "2,30,,0.3", "2,-"):
        path.write_text(whole + part)
        assert last_step(tmp_path) == 20


def test_without_logs_there_are_no_curves(tmp_path):
    assert read_curves(tmp_path) == {}
    write_log(tmp_path, 0)
    assert read_curves(tmp_path) == {}
    assert last_step(tmp_path) == 0


class TestPicture:
    def test_nothing_is_drawn_of_nothing(self, folder, tmp_path):
        sweep = load_sweep(folder)
        assert draw_curves(sweep, read_rows(sweep, tmp_path / "out"), tmp_path / "out") is None

    def test_each_run_leaves_its_color(self, folder, tmp_path):
        pytest.importorskip("matplotlib", reason="matplotlib draws the curves")
        out = tmp_path / "out"
        sweep = load_sweep(folder)
        write_log(out / RUNS / "a-seed0", 0, "0,9,0.5,0.1,0.7", "1,19,0.3,0.5,0.4")
        path = draw_curves(sweep, read_rows(sweep, out), out)
        assert path == out / "curves.png"
        one = cv2.imread(str(path))
        write_log(out / RUNS / "b-seed1", 0, "0,9,0.5,0.9,0.7", "1,19,0.3,0.2,0.4")
        write_log(out / RUNS / "b-seedling", 0, "0,9,0.5,0.9,0.7")
        both = cv2.imread(str(draw_curves(sweep, read_rows(sweep, out), out)))
        blue, orange = (0xB2, 0x72, 0x00), (0x00, 0x5E, 0xD5)  # as OpenCV orders them
        assert (one == blue).all(axis=2).any()
        assert not (one == orange).all(axis=2).any()
        assert (both == orange).all(axis=2).any()
