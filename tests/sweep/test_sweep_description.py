"""A folder of experiments is a sweep; sweep.yaml orders it, and its mistakes are told."""

from pathlib import Path

import pytest

from yolino.config import load_experiment
from yolino.sweep import load_sweep
from yolino.sweep.description import METRICS

PAPER = Path(__file__).parents[2] / "configs" / "paper"


def test_without_a_layout_the_rows_are_the_files_in_order(folder):
    sweep = load_sweep(folder)
    assert list(sweep.files) == ["a", "b"]
    assert sweep.layout.title == "mine"
    assert [group.rows for group in sweep.layout.groups] == [("a", "b")]
    assert sweep.layout.columns == {
        "Row": "row",
        "upsample": "model.upsample",
        "representation": "model.representation",
    }


def test_files_that_the_system_hides_are_no_rows(folder):
    (folder / "._a.yaml").write_bytes(b"\x00\x05\x16\x07\xff")  # as macOS leaves them on other disks
    assert list(load_sweep(folder).files) == ["a", "b"]


def test_equal_last_parts_of_keys_are_written_out(folder):
    (folder / "c.yaml").write_text("base: a.yaml\nloss: {classes: 3}\ndata: {classes: [solid]}")
    columns = load_sweep(folder).layout.columns
    assert {"loss.classes", "data.classes"} <= set(columns)


def test_a_layout_orders_groups_and_leaves_out(folder):
    (folder / "c.yaml").write_text("base: a.yaml")
    (folder / "sweep.yaml").write_text(
        "title: Trials\n"
        "columns: {Kind: model.representation, Side: stride}\n"
        "groups: [{title: First, rows: [b, a]}, {rows: [b]}]\n"
        "numbers: {b: {f1: 0.5}}\n"
    )
    sweep = load_sweep(folder)
    assert list(sweep.files) == ["b", "a"]
    assert sweep.layout.title == "Trials"
    assert sweep.layout.columns == {"Kind": "model.representation", "Side": "stride"}
    assert sweep.layout.numbers["b"].of("segment_f1") == 0.5
    assert sweep.layout.numbers["b"].of("accuracy") is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "groups: [{rows: [aa]}]",
            r"no experiment aa\.yaml for the row 'aa'; did you mean 'a'\? The folder has a, b",
        ),
        ("groups: [{row: [a]}]", "unknown key 'groups.0.row'; did you mean 'rows'"),
        ("numbers: {c: {f1: 1}}", r"numbers has the row 'c', which is in no group; .*The groups have a, b\."),
        ("numbers: {a: {F1: 1}}", "unknown key 'numbers.a.F1'"),
        (
            "columns: {P: model.predictor}",
            "columns.P is 'model.predictor', .*did you mean 'model.predictors'",
        ),
        ("columns: {P: out.predictors}", "which no experiment has"),
        ("numbers: {a: {f1: .nan}}", r"numbers\.a\.f1 is nan: .*finite"),
        ("title: x\ntitle: y", "the key 'title' is there twice"),
        ("columns: {P: nothing}", "which no experiment has"),
        ("- 1", r"sweep\.yaml holds no keys; it may have title, "),
        ("a: [", "is not YAML"),
        (
            "groups: [{rows: [a], score_on: [{dataset: synthetic}]}, {rows: [a, b]}]",
            "a is in groups with different score_on",
        ),
    ],
)
def test_a_mistake_in_the_layout_is_told(folder, text, message):
    (folder / "sweep.yaml").write_text(text)
    with pytest.raises(ValueError, match=message):
        load_sweep(folder)


def test_what_is_no_sweep_says_so(tmp_path):
    with pytest.raises(FileNotFoundError, match="no folder"):
        load_sweep(tmp_path / "nothing")
    (tmp_path / "_base.yaml").write_text("")
    with pytest.raises(FileNotFoundError, match="no experiment files"):
        load_sweep(tmp_path)


def test_the_papers_folder_holds_its_table():
    sweep = load_sweep(PAPER)
    ours = [row for row in sweep.files if not row.startswith(("kai", "argoverse"))]
    assert len(ours) == 11
    assert (
        {path.stem for path in PAPER.glob("*.yaml")} - {"sweep"}
        == set(sweep.files)
        == set(sweep.layout.numbers)
    )
    printed = [row for group in sweep.layout.groups[:5] for row in group.rows]
    assert len(printed) == 15  # its lines for TuSimple, three of them twice or thrice
    for row, path in sweep.files.items():
        experiment = load_experiment(path)
        kind, predictors, cell = row.removeprefix("kai_").removeprefix("argoverse_").split("_")
        assert experiment.name == row
        assert experiment.model.representation == kind
        assert experiment.model.predictors == int(predictors)
        assert 32 >> experiment.model.upsample == int(cell.removesuffix("px"))
        if row in ours:  # ten segments (tau_s) at 16 px
            shortest = experiment.postprocess.linker_options["min_length_cells"]
            assert shortest * (32 >> experiment.model.upsample) == 160
        assert experiment.model.backbone == "darknet19"
        assert experiment.training.optimizer == "adam"
        assert experiment.training.lr == (1e-4 if kind == "po" else 1e-3)
        assert experiment.training.weight_decay == 1e-4
        assert experiment.augment.preset == "paper"
        numbers = sweep.layout.numbers[row]
        f1, recall, precision = (numbers.of(f"segment_{name}") for name in ("f1", "recall", "precision"))
        # The paper's F1 is not the one of its rounded precision and recall, but near it.
        assert f1 == pytest.approx(2 * recall * precision / (recall + precision), abs=0.01)
        assert (numbers.of("accuracy") is None) == (row not in ours)


@pytest.mark.parametrize(
    ("row", "size", "batch", "epochs", "frames"),
    [
        ("po_8_16px", (320, 640), 32, 40, 3268),
        ("kai_po_8_16px", (640, 640), 16, 30, 1400),
        ("argoverse_po_8_16px", (448, 960), 16, 55, 2600),
    ],
)
def test_the_papers_training_parameters(row, size, batch, epochs, frames):
    experiment = load_experiment(PAPER / f"{row}.yaml")
    assert experiment.data.size == size
    assert experiment.training.batch_size == batch
    assert abs(experiment.training.steps - epochs * frames / batch) <= 0.5
    basis = next(group.reported_on for group in load_sweep(PAPER).layout.groups if row in group.rows)
    assert basis is not None
    assert basis.train == frames


def test_the_scores_of_the_table_have_reported_names():
    from yolino.sweep.description import Numbers

    assert {metric.removeprefix("segment_") for metric in METRICS} == set(Numbers.model_fields)
