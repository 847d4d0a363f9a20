"""Every section runs, its JSON is complete, and what cannot be measured says why."""

from __future__ import annotations

import json
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from yolino.benchmark import SECTIONS, benchmark, report
from yolino.benchmark import measure as measures
from yolino.benchmark.clock import race
from yolino.benchmark.frames import STEPS, ClockedFrame, made_up_output
from yolino.benchmark.measure import Measure, Target, at_least, at_most
from yolino.benchmark.process import _python, core_distributions
from yolino.benchmark.quantized import quantized_copies
from yolino.benchmark.setup import Setup
from yolino.config import load_experiment
from yolino.inference import Predictor, load
from yolino.inference.loading import model_path

KEYS = {"title", "value", "unit", "low", "high", "target", "bound", "met", "note"}
TRAIN = {"darknet19", "paper", "matching", "training", "loading"}


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def test_every_step_of_a_frame_gets_its_own_time(tiny_model, rng):
    predictor = load(tiny_model)
    pauses = {"network": 0.03, "nms": 0.02, "linking": 0.01}

    def slow(step, pause):
        def run(value):
            time.sleep(pause)
            return step(value)

        return run

    engine = slow(predictor.engine, pauses["network"])
    engine.header = predictor.header
    engine.name, engine.device, engine.precision, engine.streams = "slow", "cpu", "fp32", 1
    slowed = Predictor(
        engine,
        predictor.header,
        nms=slow(predictor.nms, pauses["nms"]),
        linker=slow(predictor.linker, pauses["linking"]),
    )
    frame = ClockedFrame(slowed, np.full((128, 128, 3), 9, np.uint8), made_up_output(predictor, rng))
    times = race({"frame": frame}, rounds=3, seconds=0.0, calls=1)["frame"]
    rows = np.array(frame.rows)
    assert rows.shape == (5, len(STEPS))
    assert (rows > 0).all()
    assert (rows[-3:].sum(axis=1) <= times.seconds).all()
    for name, pause in pauses.items():
        assert (rows[:, list(STEPS).index(name)] >= pause).all()


@pytest.fixture
def small_darknet(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets the sections take a network that is built quickly in place of Darknet-19."""
    if find_spec("torch") is None:
        return
    from yolino.benchmark import darknet, training

    network = training.NETWORKS["default"]
    monkeypatch.setattr(darknet, "NETWORK", network)
    monkeypatch.setitem(training.NETWORKS, "darknet19", network)


@pytest.mark.parametrize("name", SECTIONS)
@pytest.mark.usefixtures("small_darknet")
def test_every_section_gives_complete_json(name, tiny_model, tmp_path):
    if name in TRAIN:
        pytest.importorskip("torch")
    result = benchmark(str(tiny_model), "cpu", only=[name], quick=True, threads=1)
    assert json.loads(json.dumps(result, allow_nan=False)) == result
    (section,) = result["sections"].values()
    assert section["not_measured"] is None
    assert section["measures"]
    for measured in section["measures"].values():
        assert set(measured) == KEYS
        assert measured["title"]
        assert measured["value"] is not None
        assert measured["value"] >= 0 or name in ("stages", "darknet19", "growth")
        assert (measured["target"] is None) == (measured["met"] is None)
    assert (result["model"] is not None) == SECTIONS[name].model
    assert result["machine"]["cpu"]
    assert section["title"] in report(result)
    assert not result["targets"]["not_measured"]


def test_the_frame_can_be_a_file(tiny_model, tmp_path):
    from yolino.io import write_image

    write_image(tmp_path / "a.png", np.full((90, 160, 3), 200, np.uint8))
    result = benchmark(str(tiny_model), only=["stages"], quick=True, image=tmp_path / "a.png")
    assert "90x160" in result["sections"]["stages"]["title"]
    assert result["settings"]["image"] == "a.png"


@pytest.fixture
def missing(monkeypatch: pytest.MonkeyPatch):
    """Makes packages look as if they were not installed."""

    def hide(*names: str) -> None:
        monkeypatch.setattr(measures, "find_spec", lambda name: None if name in names else find_spec(name))

    return hide


def test_without_torch_the_sections_of_training_say_so(missing):
    missing("torch")
    result = benchmark(only=["matching", "training", "loading"], quick=True)
    for section in result["sections"].values():
        assert section["not_measured"] == "not measured: needs yolino[train], pip install 'yolino[train]'"
        assert section["measures"] == {}
    assert result["targets"]["not_measured"] == ["matching", "training", "loading"]
    assert "Not measured: needs yolino[train]" in report(result)


def test_without_scikit_learn_the_nms_is_measured_alone(missing):
    missing("sklearn")
    result = benchmark(only=["nms"], quick=True)
    found = result["sections"]["nms"]["measures"]
    assert found["ours_heap"]["value"] > 0
    for key in ("sklearn_heap", "speedup_heap", "identical_heap"):
        assert found[key]["value"] is None
        assert found[key]["met"] is None
        assert found[key]["note"] == "not measured: pip install scikit-learn"
    assert "nms.speedup_heap" in result["targets"]["not_measured"]


def test_mistakes_are_told_in_a_sentence():
    with pytest.raises(
        ValueError, match=r"The section 'nsm' of the benchmark is unknown; use one of stages,"
    ):
        benchmark(only=["nms", "nsm"])
    with pytest.raises(ValueError, match="repeats is 0"):
        benchmark(only=["nms"], repeats=0)
    with pytest.raises(FileNotFoundError, match=r"nowhere\.onnx does not exist"):
        benchmark("nowhere.onnx", only=["nms", "stages"])


def test_the_first_run_of_all_is_timed_too(tiny_model):
    found = benchmark(str(tiny_model), only=["startup"], quick=True)["sections"]["startup"]["measures"]
    for key in ("first", "predict"):
        assert 0 < found[key]["value"] < 60
        assert (found[key]["bound"], found[key]["target"]) == ("at most", 2.5)


def test_what_fails_in_another_process_is_not_swallowed():
    with pytest.raises(RuntimeError, match="ZeroDivisionError"):
        _python("1 / 0")


def test_the_core_needs_neither_torch_nor_scikit_learn():
    names = core_distributions()
    assert {"yolino", "numpy", "onnxruntime", "llvmlite"} <= names
    assert not {"torch", "scikit-learn", "torchvision"} & names


def test_the_default_network_is_that_of_its_configuration():
    pytest.importorskip("torch")
    from yolino.benchmark.training import NETWORKS
    from yolino.model.network import Network
    from yolino.training.module import network_arguments

    experiment = load_experiment(Path(__file__).parents[2] / "configs" / "default.yaml")
    config = network_arguments(experiment)
    assert {key: config[key] for key in NETWORKS["default"]} == NETWORKS["default"]
    assert Network(**NETWORKS["default"]).stride == 16
    assert experiment.training.precision == "bf16-mixed"


def test_the_report_shows_targets_verdicts_and_notes():
    section = {
        "title": "Two",
        "about": "How.",
        "not_measured": None,
        "measures": {
            "fast": Measure("fast", 0.01234, "ms", 0.01, 0.02, at_most(0.5)).to_dict(),
            "slow": Measure("slow", 12.0, "x", target=at_least(80), note="mean").to_dict(),
            "same": Measure("same", True, target=Target("equal to", True)).to_dict(),
        },
    }
    measured = benchmark(only=["discretize"], quick=True)
    result = measured | {
        "settings": measured["settings"] | {"quick": False},
        "sections": {"two": section},
        "targets": {"met": ["two.fast", "two.same"], "missed": ["two.slow"], "not_measured": ["other"]},
    }
    lines = report(result).splitlines()
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line[:1] == "|"]
    assert cells[2] == ["fast", "0.0123 ms", "0.01 .. 0.02", "<= 0.5 ms", "yes"]
    assert cells[3] == ["slow", "12 x", "", ">= 80 x", "NO"]
    assert cells[4] == ["same", "yes", "", "yes", "yes"]
    assert "- slow: mean" in lines
    assert lines[-1] == "2 of 3 targets met; missed: two.slow; not measured: other."


@pytest.mark.parametrize("section", ["engines", "files"])
def test_a_quantized_model_is_told_by_its_header(section, tmp_path):
    path = next(iter(quantized_copies(model_path("default"), Setup(tmp_path, quick=True))), None)
    if path is None:
        pytest.skip("nncf, OpenVINO and onnx quantize")
    other = path.rename(tmp_path / "renamed.onnx")
    result = benchmark(str(other), "cpu", only=[section], quick=True, threads=1)
    names = set(result["sections"][section]["measures"])
    assert any(name.startswith("onnxruntime_int8") for name in names)
    assert not any("fp32" in name for name in names)


def test_a_checkpoint_races_on_every_engine(tmp_path):
    pytest.importorskip("torch")
    from yolino.benchmark.paper import write_network

    _, checkpoint = write_network(32, 0, Setup(tmp_path, quick=True))
    found = benchmark(str(checkpoint), "cpu", only=["engines"], quick=True, threads=1)["sections"]["engines"]
    assert {"torch_fp32_total", "onnxruntime_fp32_total", "operations"} <= set(found["measures"])
