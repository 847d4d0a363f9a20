from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from yolino.datasets import TuSimple
from yolino.evaluate import evaluate
from yolino.evaluate.diagnosis import Diagnosis, diagnose
from yolino.evaluate.diagnosis_report import tables, write_diagnosis
from yolino.evaluate.diagnosis_scores import draw_weights, lost
from yolino.evaluate.oracles import ORACLES
from yolino.evaluate.prior import find_prior
from yolino.header import Header
from yolino.inference import Predictor, load
from yolino.io import read_image
from yolino.types import Polylines, Sample

ROWS = list(range(160, 720, 10))
SEEN = [399.5, 879.5]
"""Pixel columns in 1280x720 of the lines that the tiny model sees at x = 40 and 88 of 128."""


def write_frames(root: Path, *frames: list[float]) -> TuSimple:
    """Writes frames with upright lanes at the given columns, and their labels."""
    records = []
    for i, columns in enumerate(frames):
        name = f"clips/{i}/20.png"
        (root / name).parent.mkdir(parents=True)
        cv2.imwrite(str(root / name), np.full((720, 1280, 3), 200, np.uint8))
        records.append({"raw_file": name, "lanes": [[x] * len(ROWS) for x in columns], "h_samples": ROWS})
    (root / "label_data_test.json").write_text("".join(json.dumps(r) + "\n" for r in records))
    return TuSimple(root)


class Scenes:
    """Bright images of 64 x 128 pixels: of the two lines the left one is labelled, the right edge ignored."""

    classes = ("line",)
    directed = False

    def __len__(self) -> int:
        return 2

    def __getitem__(self, index: int) -> Sample:
        lines = Polylines.from_list([[[42.0, 64.0], [42.0, 0.0]]])
        corner = np.array([[100.0, 0.0], [128.0, 0.0], [128.0, 64.0], [100.0, 64.0]])
        return Sample(f"{index}.png", np.full((64, 128, 3), 200, np.uint8), lines, (corner,), (64, 128))


@pytest.fixture(scope="module")
def predictor(tiny_model: Path) -> Predictor:
    return load(tiny_model)


@pytest.fixture(scope="module")
def misplaced(predictor: Predictor, tmp_path_factory: pytest.TempPathFactory) -> tuple[Diagnosis, TuSimple]:
    """One of the lines of frame 1 lies 60 px beside its label: more than two radii, less than three."""
    dataset = write_frames(tmp_path_factory.mktemp("frames"), SEEN, [SEEN[0] - 60, SEEN[1]])
    return diagnose(predictor, dataset), dataset


def test_the_model_as_it_is_has_the_scores_and_intervals_of_evaluate(
    predictor: Predictor, tmp_path: Path
) -> None:
    dataset = write_frames(tmp_path, SEEN[:1], SEEN, [100.0, 879.5], [640.0])
    groups = {"clips/0/20.png": "a", "clips/1/20.png": "a"}
    wanted = evaluate(predictor, dataset, groups=lambda name: groups.get(name, "b"))
    row = next(
        row
        for row in diagnose(predictor, dataset, groups=lambda name: groups.get(name, "b")).rows
        if row.name == "model"
    )
    for name, value in row.scores.items():
        assert value == pytest.approx(wanted.scores[name])
        assert row.intervals[name] == pytest.approx(wanted.intervals[name])


def test_the_losses_add_up_to_what_the_labels_have_more_than_the_model(
    misplaced: tuple[Diagnosis, TuSimple],
) -> None:
    found, _ = misplaced
    scores = {row.name: row.scores for row in found.rows}
    for name in ("accuracy", "f1", "segment_f1"):
        total = sum(loss.values[name] for loss in found.losses)
        assert total == pytest.approx(scores["labels"][name] - scores["model"][name])
    for name in ("fp", "fn"):
        total = sum(loss.values[name] for loss in found.losses)
        assert total == pytest.approx(scores["model"][name] - scores["labels"][name])


def test_the_losses_of_the_images_have_the_loss_as_their_mean(
    misplaced: tuple[Diagnosis, TuSimple],
) -> None:
    for loss in misplaced[0].losses:
        assert np.mean(loss.images) == pytest.approx(loss.values["accuracy"])
        low, high = loss.intervals["accuracy"]
        assert low - 1e-9 <= loss.values["accuracy"] <= high + 1e-9


def test_the_causes_add_up_to_the_loss_of_accuracy(misplaced: tuple[Diagnosis, TuSimple]) -> None:
    found, _ = misplaced
    model = next(row for row in found.rows if row.name == "model")
    assert sum(found.causes.values()) == pytest.approx(1 - model.scores["accuracy"])
    assert found.causes["no_line"] == pytest.approx(0.25)


def test_the_verdict_names_the_stage_that_costs_most(misplaced: tuple[Diagnosis, TuSimple]) -> None:
    found, _ = misplaced
    assert found.headline == "accuracy"
    assert found.dominant.stage == "misplaced segments"
    assert found.verdict.startswith(
        "What limits the accuracy of this model on these 2 images: misplaced segments (.2"
    )


def test_a_perfect_model_is_limited_by_nothing() -> None:
    found = Diagnosis("f1", [], [], {}, ["a.png"], {})
    assert found.verdict == "Nothing limits this model on this image: its f1 is that of the labels."


def test_the_row_without_an_image_is_the_same_in_every_image(predictor: Predictor, tmp_path: Path) -> None:
    dataset = write_frames(tmp_path, SEEN, SEEN, [100.0, 1200.0])
    found = diagnose(predictor, dataset, prior=find_prior(dataset))
    assert [row.name for row in found.rows] == ["no_image", *ORACLES]
    assert found.rows[0].scores["accuracy"] == pytest.approx((1 + 1 + 0) / 3)
    first, *others = found.lines["no_image"]
    assert all(np.array_equal(first.vertices, each.vertices) for each in others)


def test_windows_have_no_rows_so_points_are_attributed(
    make_model: Callable[..., Path], tiny_endpoints: np.ndarray, tmp_path: Path
) -> None:
    header = Header("0", "w", (64, 128), 16, 1, "po", directed=False, fit="window")
    header = replace(header, postprocess={"threshold": 0.5, "linker": "chain"})
    every_cell = np.tile(tiny_endpoints, (4, 1, 1))
    model = make_model(tmp_path / "windows.onnx", header=header, endpoints=every_cell)
    found = diagnose(load(model), Scenes())
    assert found.headline == "f1"
    assert set(found.rows[0].scores) == {"f1", "precision", "recall", "segment_f1"}
    assert found.causes == {}
    total = sum(loss.values["f1"] for loss in found.losses)
    assert total == pytest.approx(1 - found.rows[0].scores["f1"])
    assert found.dominant.stage == "false segments"
    assert len(tables(found)) == 2


def test_ignored_regions_leave_no_accuracy(predictor: Predictor) -> None:
    assert diagnose(predictor, Scenes()).headline == "f1"


def test_the_report_has_the_tables_and_pictures_of_what_loses_most(
    misplaced: tuple[Diagnosis, TuSimple], tmp_path: Path
) -> None:
    found, dataset = misplaced
    write_diagnosis(tmp_path / "why", found, dataset, title="tiny <model>", facts=["fact & figure"])
    text = (tmp_path / "why/report.md").read_text()
    assert "# tiny <model>" in text
    assert found.verdict in text
    assert text.count("\n| ") == sum(1 + len(table.rows) for table in tables(found))
    assert "![](worst/01-clips-1-20.png)" in text
    assert "02-" not in text  # frame 0 loses nothing
    page = (tmp_path / "why/report.html").read_text()
    assert "<h1>tiny &lt;model&gt;</h1>" in page
    assert 'src="worst/01-clips-1-20.png"' in page
    picture = read_image(tmp_path / "why/worst/01-clips-1-20.png")
    assert picture.shape[1] > 2 * 1280


def test_small_losses_have_no_sign(misplaced: tuple[Diagnosis, TuSimple]) -> None:
    cells = [cell for table in tables(misplaced[0]) for row in table.rows for cell in row]
    assert "0.000" in cells
    assert not {"+0.000", "-0.000"} & set(cells)


def test_lost_is_positive_where_the_model_is_worse() -> None:
    below = {"accuracy": np.array([0.8]), "fp": np.array([0.3])}
    above = {"accuracy": np.array([0.9]), "fp": np.array([0.1])}
    found = lost(below, above)
    assert found["accuracy"] == pytest.approx(0.1)
    assert found["fp"] == pytest.approx(0.2)


def test_each_draw_has_as_many_groups_as_there_are() -> None:
    assert (draw_weights(5, None).sum(axis=1) == 5).all()
    grouped = draw_weights(5, ["a", "b", "a", "b", "c"])
    assert (grouped[:, 0] == grouped[:, 2]).all()
    assert (grouped[:, [0, 1, 4]].sum(axis=1) == 3).all()


def test_an_empty_dataset_is_told(predictor: Predictor, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Scenes, "__len__", lambda self: 0)
    with pytest.raises(ValueError, match="has no samples"):
        diagnose(predictor, Scenes())


def test_images_without_any_label_are_told(predictor: Predictor, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="None of the 2 images has a labelled line"):
        diagnose(predictor, write_frames(tmp_path, [], []))


def test_causes_add_up_with_empty_images_and_lines_too_many(predictor: Predictor, tmp_path: Path) -> None:
    found = diagnose(predictor, write_frames(tmp_path, SEEN, [], [100.0]))
    model = next(row for row in found.rows if row.name == "model")
    assert sum(found.causes.values()) == pytest.approx(1 - model.scores["accuracy"])
    assert found.causes["whole_image"] == pytest.approx(1 / 3)


def test_true_segments_of_real_labels_lose_little(tusimple_root: Path, tmp_path: Path) -> None:
    """Cells of 16 px: .988 when first measured, with another linker."""
    text = (tusimple_root / "label_data_0531.json").read_text().splitlines(keepends=True)
    (tmp_path / "label_data.json").write_text("".join(text[:4]))
    dataset = TuSimple(tusimple_root, [tmp_path / "label_data.json"])
    found = {row.name: row.scores for row in diagnose(load("default"), dataset).rows}
    assert 0.97 < found["true_segments"]["accuracy"] <= found["true_segments_linked"]["accuracy"] + 0.005
    assert found["true_segments"]["fn"] == 0
    assert found["labels"]["accuracy"] == 1
