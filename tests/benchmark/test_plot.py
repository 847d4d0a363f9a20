"""Plots are drawn from the JSON alone, whatever of it there is."""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import struct
from pathlib import Path

import pytest

from benchmark_results import growth, small_result
from yolino.benchmark import SECTIONS, plot, plot_engines, plot_races, plot_roofline
from yolino.benchmark.measure import Measure, Section
from yolino.benchmark.plot import DRAWN, PICTURES, check_plot, drawable
from yolino.benchmark.plot_frame import draw as draw_frame
from yolino.benchmark.plot_growth import draw as draw_growth
from yolino.benchmark.plot_races import draw as draw_races
from yolino.benchmark.plot_style import digits

WIDTH = 1280


@pytest.fixture(autouse=True)
def _matplotlib(request: pytest.FixtureRequest) -> None:
    if "without" not in request.node.name:
        pytest.importorskip("matplotlib", reason="matplotlib draws the plots")


def size(path: Path) -> tuple[int, int]:
    """Gives width and height of a PNG file."""
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = struct.unpack(">II", data[16:24])
    return width, height


def texts(figure) -> str:
    """Gives all that is written in a figure."""
    importlib.import_module("matplotlib.backends.backend_agg").FigureCanvasAgg(figure).draw()
    return " | ".join(text.get_text() for text in figure.findobj(lambda artist: hasattr(artist, "get_text")))


def test_every_picture_is_written_1280_pixels_wide(tmp_path):
    result = json.loads(json.dumps(small_result()))
    written = plot(result, tmp_path / "new")
    names = ["frame.png", "races.png", "growth.png", "engines.png", "roofline.png"]
    assert [path.name for path in written] == names
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == sorted(names)
    for path in written:
        width, height = size(path)
        assert width == WIDTH
        assert 200 < height < 1500
        assert path.stat().st_size < 150_000


def test_the_same_result_gives_the_same_bytes(tmp_path):
    result = small_result(growth=growth(3))
    (a,), (b,) = plot(result, tmp_path / "a"), plot(result, tmp_path / "b")
    assert a.read_bytes() == b.read_bytes()


@pytest.mark.parametrize("name", ["stages", "nms", "growth", "engines", "roofline"])
def test_each_section_is_drawn_alone(name, tmp_path):
    result = small_result()
    result["sections"] = {name: result["sections"][name]}
    result["model"] = None
    (path, *more) = plot(result, tmp_path)
    assert size(path)[0] == WIDTH
    assert [path.name for path in more] == ["roofline.png"] * (name == "engines")  # the part that they reach


def test_sections_that_were_not_measured_are_left_out(tmp_path):
    absent = Section("NMS", "", not_measured="not measured: needs luck")
    result = small_result(stages=absent, nms=absent, engines=absent, roofline=absent, growth=growth(2))
    assert [path.name for path in plot(result, tmp_path)] == ["growth.png"]


def test_a_result_with_nothing_to_draw_is_told(tmp_path):
    result = small_result(startup=Section("Start", "", {"import": Measure("import", 1.0, "s")}))
    with pytest.raises(ValueError, match=r"Nothing can be drawn of the sections .*\(startup\)"):
        plot(result, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_results_from_before_there_were_curves_are_drawn(tmp_path):
    result = small_result()
    for section in result["sections"].values():
        del section["curves"]
    assert "growth.png" not in [path.name for path in plot(result, tmp_path)]


def test_growth_shows_exponents_and_a_line_of_slope_one():
    shown = texts(draw_growth(small_result()))
    assert "NMS, $n^{1.00}$" in shown
    assert "linker graph, $n^{2.00}$" in shown
    assert "slope 1" in shown
    assert "time (ms) by candidates" in shown
    assert "classes" not in shown  # a curve without points


def test_one_point_is_drawn_without_exponent(tmp_path):
    result = small_result(growth=growth(1))
    assert size(plot(result, tmp_path)[0])[0] == WIDTH
    assert "n^" not in texts(draw_growth(result))


def test_memory_that_is_not_known_is_not_drawn(tmp_path):
    result = small_result(growth=growth(2))
    for curve in result["sections"]["growth"]["curves"]:
        for point in curve["points"]:
            point["megabytes"] = None
    assert "too little to measure" in texts(draw_growth(result))
    plot(result, tmp_path)


def test_a_race_needs_its_factor_and_both_times():
    result = small_result()
    shown = texts(draw_races(result))
    assert "NMS, 500 candidates: scikit-learn" in shown
    assert "120x" in shown
    result["sections"]["nms"]["measures"]["sklearn_500"]["value"] = None
    assert draw_races(result) is None


def test_the_steps_of_a_frame_add_up():
    shown = texts(draw_frame(small_result()))
    assert "18 ms" in shown  # .5 + 1.5 + ... + 5.5
    assert "16.5 ms" in shown  # without the network's 1.5
    assert "this image,\n7 candidates" in shown


def test_a_quick_result_says_that_it_means_nothing():
    result = small_result()
    assert "QUICK" not in texts(draw_frame(result))
    result["settings"]["quick"] = True
    assert "QUICK" in texts(draw_frame(result))


def test_a_quick_result_has_no_roofline(tmp_path):
    result = small_result()
    result["settings"]["quick"] = True
    names = ["frame.png", "races.png", "growth.png", "engines.png"]
    assert [path.name for path in plot(result, tmp_path)] == names
    result["sections"] = {"roofline": result["sections"]["roofline"]}
    with pytest.raises(ValueError, match="Nothing can be drawn of the sections that were measured"):
        plot(result, tmp_path)


def test_the_sections_that_can_be_drawn_are_those_that_the_pictures_read():
    assert list(DRAWN) == list(PICTURES)
    assert DRAWN["races"] == tuple(plot_races._PAIRS)
    assert DRAWN["engines"] == tuple(plot_engines._SECTIONS)
    assert DRAWN["roofline"] == ("roofline", *plot_roofline._PREFIXES)
    assert set(drawable()) < set(SECTIONS)
    assert set(drawable()) - set(drawable(quick=True)) == {"roofline"}


def test_sections_that_cannot_be_drawn_are_told_before(tmp_path):
    with pytest.raises(
        ValueError, match=r"^Nothing can be drawn of startup, install: measure stages, nms, .* or roofline\.$"
    ):
        check_plot(tmp_path, ["startup", "install"])
    with pytest.raises(ValueError, match=r"drawn of a quick run of roofline: measure stages, .* or files\.$"):
        check_plot(tmp_path, ["roofline"], quick=True)
    check_plot(tmp_path, ["startup", "nms"])
    check_plot(tmp_path, ["roofline"])


def test_a_file_in_place_of_the_folder_is_told_before(tmp_path):
    (tmp_path / "a").write_text("mine")
    for folder in (tmp_path / "a", tmp_path / "a" / "b" / "c"):
        with pytest.raises(ValueError, match=r"/a is a file, but the pictures need a folder"):
            check_plot(folder)
    check_plot(tmp_path / "new" / "folder")
    assert not (tmp_path / "new").exists()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written_is_told_before(tmp_path):
    (tmp_path / "a").mkdir(mode=0o500)
    with pytest.raises(PermissionError, match="cannot be written: give another one"):
        check_plot(tmp_path / "a" / "b")


def test_without_matplotlib_one_sentence_says_what_to_do(tmp_path, monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda n, *a: None if n == "matplotlib" else find(n, *a))
    with pytest.raises(ModuleNotFoundError, match=r"^Plots need matplotlib: pip install 'yolino\[plot\]'\.$"):
        plot(small_result(), tmp_path)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0123, "0.012"),
        (0.5, "0.5"),
        (12.34, "12.3"),
        (999.0, "999"),
        (999.7, "1,000"),
        (1000.0, "1,000"),
        (1113.4, "1,113"),
        (100_000.0, "100,000"),
        (1e6, "1M"),
        (2.346e6, "2.35M"),
        (1e9, "1,000M"),
        (0.0, "0"),
    ],
)
def test_numbers_are_short(value, text):
    assert digits(value) == text
