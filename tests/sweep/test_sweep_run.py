"""Several experiments become one table; a killed sweep goes on, and a failing row stops no other."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from yolino.config import load_experiment
from yolino.evaluate import evaluate
from yolino.inference import Predictor
from yolino.model.engine import TorchEngine
from yolino.sweep import Outcome, load_sweep, plan, prospects, run_sweep
from yolino.sweep.curves import read_curves
from yolino.sweep.result import PROBLEM, RESULT, RUNS, read_result
from yolino.sweep.thresholds import TRIED
from yolino.training.callbacks import BEST
from yolino.training.data import build_dataset

pytestmark = pytest.mark.filterwarnings(
    "ignore::DeprecationWarning", "ignore::FutureWarning", "ignore::UserWarning"
)
Sweeping = Callable[..., tuple[Outcome, list[str]]]


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "out"


@pytest.fixture
def run(folder: Path, out: Path) -> Sweeping:
    """Runs the sweep; gives what came of it and what was said."""

    def sweep(*changes: str, seeds: tuple[int, ...] = (), only: tuple[str, ...] = ()):
        found, said = load_sweep(folder), list[str]()
        jobs = plan(found, changes, out, only=only, seeds=seeds)
        return run_sweep(found, prospects(jobs), out, say=said.append), said

    return sweep


def kill_at(monkeypatch: pytest.MonkeyPatch, step: int) -> None:
    """Stops the process, as it were, before the so-manieth training step from now on."""
    from yolino.training.module import TrainingModule

    original, count = TrainingModule.training_step, [0]

    def killed(self, batch, batch_idx):
        count[0] += 1
        if count[0] == step:
            raise KeyboardInterrupt
        return original(self, batch, batch_idx)

    monkeypatch.setattr(TrainingModule, "training_step", killed)


def test_a_killed_sweep_goes_on_and_ends_with_a_table(run, out, monkeypatch):
    with monkeypatch.context() as patch:
        kill_at(patch, 8)  # the last step of the second run
        with pytest.raises((KeyboardInterrupt, SystemExit)):
            run()
    first = read_result(out / RUNS / "a-seed0")
    assert first is not None
    assert (first.steps, first.parameters > 1000, first.train[0].images) == (4, True, 50)
    assert {"segment_f1", "f1", "images"} <= set(first.scores)
    assert not {"accuracy", "fp", "fn", "fn_strict"} & set(
        first.scores
    )  # no labels of the TuSimple benchmark
    assert "Not run yet: b." in (out / "table.md").read_text()
    assert not (out / RUNS / "b-seed0" / RESULT).exists()
    changed = (out / RUNS / "a-seed0" / "last.ckpt").stat().st_mtime_ns

    outcome, said = run()
    assert outcome == Outcome({}, {})
    assert said[0] == "[1 of 2] a, seed 0: finished before"
    assert said[1].startswith("[2 of 2] b, seed 0: goes on from step 2 of 4")
    assert said[2].startswith("[2 of 2] b, seed 0: step 4 of 4, ")
    assert said[-1].startswith("[2 of 2] b, seed 0: finished in ")
    assert (out / RUNS / "a-seed0" / "last.ckpt").stat().st_mtime_ns == changed
    second = read_result(out / RUNS / "b-seed0")
    assert second is not None
    assert second.settings["model"]["representation"] == "eu"
    assert second.steps == 4
    steps = read_curves(out / RUNS / "b-seed0")["val/f1"][0]
    assert steps.tolist() == [2, 4]
    rows = json.loads((out / "table.json").read_text())["rows"]
    assert [len(row["runs"]) for row in rows] == [1, 1]

    # A run that was trained, but not yet scored: nothing is trained again.
    (out / RUNS / "b-seed0" / RESULT).unlink()
    kill_at(monkeypatch, 1)
    outcome, said = run()
    assert outcome == Outcome({}, {})
    again = read_result(out / RUNS / "b-seed0")
    assert again is not None
    assert again.scores["segment_f1"] == second.scores["segment_f1"]
    assert again.seconds >= 0


def test_what_fails_or_has_no_data_stops_no_other(folder, run, out, monkeypatch):
    (folder / "b.yaml").write_text("base: a.yaml\ndata: {train: [{data: nowhere}]}")
    (folder / "_c.yaml").write_text("name: never")
    (folder / "c.yaml").write_text("base: a.yaml\ntraining: {start_from: nothing.safetensors}")
    (folder / "d.yaml").write_text("base: a.yaml\ndata: {val: [{dataset: synthetic, options: {kin: 1}}]}")
    outcome, said = run("training.steps=1")
    assert read_result(out / RUNS / "a-seed0") is not None
    assert list(outcome.missing) == ["b-seed0"]
    assert outcome.missing["b-seed0"].startswith("not run: There is no data description nowhere")
    assert list(outcome.failed) == ["c-seed0", "d-seed0"]
    assert "nothing.safetensors" in outcome.failed["c-seed0"]
    assert "kin" in outcome.failed["d-seed0"]
    assert "Traceback" in (out / RUNS / "c-seed0" / PROBLEM).read_text()
    assert [line[:8] for line in said if "failed" in line or "not run" in line] == [
        "[2 of 4]",
        "[3 of 4]",
        "[4 of 4]",
    ]
    text = (out / "table.md").read_text()
    for row in ("b", "c", "d"):
        assert f"- {row}, seed 0: " in text
    # Put right, it is run, and the problem is forgotten.
    (folder / "d.yaml").write_text("base: a.yaml")
    outcome, _ = run("training.steps=1", only=("d",))
    assert outcome == Outcome({}, {})
    assert not (out / RUNS / "d-seed0" / PROBLEM).exists()


def test_a_change_of_settings_is_an_error_that_says_what_to_do(folder, finish, out):
    finish("a", f1=0.5)
    sweep = load_sweep(folder)
    with pytest.raises(
        ValueError, match=r"a-seed0 is a run of a with other settings \(training\.steps\): give .*--out"
    ):
        plan(sweep, ["training.steps=9"], out)
    with pytest.raises(ValueError, match=r"other settings \(training\.lr\)"):
        plan(sweep, ["training.lr=9"], out, seeds=[1])
    plan(sweep, ["training.steps=9"], out, only=["b"])
    plan(sweep, ["training.workers=1"], out)
    assert [(job.row, job.finished) for job in plan(sweep, [], out)] == [("a", True), ("b", False)]


def test_names_of_rows_may_hold_brackets_and_spaces(folder, finish, out):
    for name in ("po[8]", "a b", "*"):
        (folder / f"{name}.yaml").write_text("base: a.yaml")
        finish(name, f1=0.5)
        with pytest.raises(ValueError, match=r"other settings \(training\.lr\)"):
            plan(load_sweep(folder), ["training.lr=9"], out, only=[name])


def test_names_may_hold_any_letters(folder, out):
    (folder / "größe 😀.yaml").write_text("base: a.yaml")
    (job,) = plan(load_sweep(folder), [], out / "😀", only=["größe 😀"])
    assert job.folder == out / "😀" / RUNS / "größe 😀-seed0"


def test_settings_of_a_stopped_run_that_are_no_yaml_are_named(folder, out):
    stopped = out / RUNS / "a-seed0"
    stopped.mkdir(parents=True)
    (stopped / "last.ckpt").write_bytes(b"")
    (stopped / "experiment.yaml").write_text("a: [")
    with pytest.raises(ValueError, match=r"a-seed0/experiment\.yaml is not YAML"):
        plan(load_sweep(folder), [], out)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("augment.preset=gentl", "will fail: augmentation preset 'gentl' is unknown"),
        ("augment.options={nois: {}}", "will fail: unknown key 'augment.options.nois'"),
        ("model.representation=ep", "will fail: representation 'ep' is unknown"),
        ("model.backbone=resnet", "will fail: backbone 'resnet' is unknown"),
        ("model.backbone_args={width: 3}", "will fail: unknown key 'model.backbone_args.width'"),
        ("model.backbone_args={widths: [8, 8, 8, x]}", "will fail: "),
        ("training.freeze=[backbone.stam]", "will fail: training.freeze names 'backbone.stam'"),
    ],
)
def test_what_will_fail_is_known_before_its_turn(folder, out, change, message):
    found = prospects(plan(load_sweep(folder), [change], out, only=["a"]))
    assert found[0].state.startswith(message)


def test_what_older_runs_do_not_know_has_its_default(folder, finish, out):
    finish("a", f1=0.5)
    path = out / RUNS / "a-seed0" / RESULT
    result = json.loads(path.read_text())
    del result["settings"]["model"]["neck"]
    path.write_text(json.dumps(result))
    plan(load_sweep(folder), [], out)
    result["settings"]["model"]["gone"] = 1
    path.write_text(json.dumps(result))
    with pytest.raises(ValueError, match=r"another version of yolino: unknown key 'model\.gone'"):
        plan(load_sweep(folder), [], out)


def test_seeds_and_rows_are_chosen(folder, out):
    sweep = load_sweep(folder)
    jobs = plan(sweep, ["training.lr=0.5"], out, seeds=[3, 1, 3])
    assert [(job.row, job.seed) for job in jobs] == [("a", 3), ("b", 3), ("a", 1), ("b", 1)]
    assert {job.experiment.training.lr for job in jobs} == {0.5}
    assert jobs[2].folder == out / RUNS / "a-seed1"
    assert [job.row for job in plan(sweep, [], out, only=["b"])] == ["b"]
    assert [job.seed for job in plan(sweep, ["training.seed=7"], out)] == [7, 7]


@pytest.mark.parametrize(
    ("changes", "options", "message"),
    [
        (["name=x"], {}, "name cannot be changed .*; use the names of the files"),
        (["out=x"], {}, "use --out"),
        (["training.seed=1"], {"seeds": [1]}, "use --seeds"),
        ([], {"only": ["c"]}, "no row 'c'; .*It has a, b"),
        (["training.step=1"], {}, "did you mean 'steps'"),
        (["postprocess.linker=tre"], {}, r"a\.yaml: postprocess\.linker 'tre' is unknown"),
    ],
)
def test_mistakes_are_told_before_anything_runs(folder, out, changes, options, message):
    with pytest.raises(ValueError, match=message):
        plan(load_sweep(folder), changes, out, **options)
    assert not out.exists()


def test_another_post_processing_scores_finished_runs_anew(folder, run, out, monkeypatch):
    run("training.steps=1")
    before = read_result(out / RUNS / "a-seed0")
    assert before is not None
    kill_at(monkeypatch, 1)  # nothing is trained
    change = "postprocess.linker_options.min_length_cells=99.0"
    outcome, said = run("training.steps=1", change)
    assert outcome == Outcome({}, {})
    assert said[0] == (
        "[1 of 2] a, seed 0: finished before, to score anew with other "
        "postprocess.linker_options.min_length_cells"
    )
    assert said[1].startswith("[1 of 2] a, seed 0: scored anew: F1 ")
    after = read_result(out / RUNS / "a-seed0")
    assert after is not None
    assert after.scores["recall"] == 0.0  # no line is as long
    assert after.scores["segment_f1"] == before.scores["segment_f1"]
    assert after.settings["postprocess"]["linker_options"] == {"min_length_cells": 99.0}
    same = ("steps", "step", "seconds", "train", "parameters", "commit")
    assert [getattr(after, name) for name in same] == [getattr(before, name) for name in same]
    assert run("training.steps=1", change)[1] == [
        f"[{i} of 2] {row}, seed 0: finished before" for i, row in ((1, "a"), (2, "b"))
    ]
    # Runs with other seeds of the row would keep the old one.
    with pytest.raises(ValueError, match=r"a-seed0 is a run of a with other settings \(postprocess\."):
        run("training.steps=1", seeds=(1,))


def test_what_cannot_be_scored_anew_keeps_its_result(run, out):
    run("training.steps=1")
    (out / RUNS / "a-seed0" / BEST).unlink()
    before = read_result(out / RUNS / "a-seed0")
    outcome, said = run("training.steps=1", "postprocess.linker_options.min_length_cells=99.0")
    assert list(outcome.failed) == ["a-seed0"]
    assert outcome.failed["a-seed0"].startswith("could not be scored anew: ")
    assert read_result(out / RUNS / "a-seed0") == before
    assert said[-1].startswith("[2 of 2] b, seed 0: scored anew: ")


def test_thresholds_are_those_with_the_best_scores(folder, run, out):
    longer = ("training.steps=200", "training.validate_every=200", "training.lr=0.01", "training.ema_decay=0")
    run(*longer, only=("a",))
    result = read_result(out / RUNS / "a-seed0")
    assert result is not None
    experiment = load_experiment(folder / "a.yaml")
    val = build_dataset(experiment.data.val[0], experiment.data.root, ())
    engine = TorchEngine(out / RUNS / "a-seed0" / BEST, device="cpu")
    scores = {t: evaluate(Predictor(engine, threshold=t), val).scores for t in TRIED}
    assert len({score["segment_f1"] for score in scores.values()}) > 2
    assert result.threshold == max(TRIED, key=lambda t: scores[t]["segment_f1"])
    assert result.line_threshold == max(TRIED, key=lambda t: scores[t]["f1"])
    assert result.scores["f1"] == scores[result.line_threshold]["f1"]
    assert result.scores["segment_precision"] == scores[result.threshold]["segment_precision"]
    run(*longer, "postprocess.threshold=0.35", only=("a",))
    result = read_result(out / RUNS / "a-seed0")
    assert result is not None
    assert (result.threshold, result.line_threshold) == (0.35, 0.35)


def test_other_data_may_be_scored(folder, run, out):
    (folder / "sweep.yaml").write_text(
        "groups: [{rows: [a], score_on: ["
        "{dataset: synthetic, options: {kind: shapes, length: 2, size: [64, 96]}},"
        "{dataset: synthetic, options: {kind: shapes, length: 1, seed: 5, size: [64, 96]}}]}]"
    )
    outcome, _ = run("training.steps=1")
    assert outcome == Outcome({}, {})
    result = read_result(out / RUNS / "a-seed0")
    assert result is not None
    assert result.scores["images"] == 3
    assert sum(part.images for part in result.scored) == 3
