"""Oracles on the two lines that the tiny model sees, in a network frame of 64 x 128 with cells of 16 px."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from yolino.evaluate.oracles import LADDER, ORACLES, Found
from yolino.evaluate.oracles_case import Case, make_case, see_everything
from yolino.evaluate.oracles_nearest import best_candidates, covered_share, places_along
from yolino.inference import load
from yolino.metrics import PointMetric
from yolino.types import Polylines, Sample, Segments

SIZE = (64, 128)
LEFT, RIGHT = [[40.0, 64.0], [40.0, 0.0]], [[88.0, 64.0], [88.0, 0.0]]
Lines = Sequence[Sequence[Sequence[float]]]
MakeCase = Callable[..., Case]


def up(x: float, rows: Sequence[int] = (0, 1, 2, 3)) -> np.ndarray:
    """Gives upward segments at x in the given cell rows, counted from the bottom."""
    return np.array([[[x, 64 - 16 * i], [x, 48 - 16 * i]] for i in rows], np.float64)


@pytest.fixture
def case_of(make_model: Callable[..., Path], tmp_path: Path) -> MakeCase:
    """Makes a case of what a network sees (all with score .9) and of labels, without any scaling."""

    def make(seen: np.ndarray, labels: Lines, *, threshold: float = 0.5, **options: object) -> Case:
        model = make_model(tmp_path / "seen.onnx", endpoints=seen)
        polylines = Polylines.from_list(labels)
        image = np.full((*SIZE, 3), 200, np.uint8)
        predictor = see_everything(load(model))
        sample = Sample("a", image, polylines, (), SIZE)
        return make_case(predictor, sample, image, threshold=threshold, **options)  # type: ignore[arg-type]

    return make


def scores(found: Found, labels: Lines) -> dict[str, float]:
    return PointMetric().match(found.polylines, Polylines.from_list(labels), SIZE).scores()


@pytest.mark.parametrize("name", ORACLES)
def test_a_model_that_is_right_loses_nothing(case_of: MakeCase, name: str) -> None:
    case = case_of(np.concatenate([up(40), up(88)]), [LEFT, RIGHT])
    found = ORACLES[name].apply(case)
    assert len(found.polylines) == 2
    assert scores(found, [LEFT, RIGHT])["f1"] > 0.98


@pytest.mark.parametrize("name", ORACLES)
def test_a_model_that_sees_nothing_is_no_mistake(case_of: MakeCase, name: str) -> None:
    case = case_of(np.concatenate([up(40), up(88)]), [LEFT], threshold=0.95)
    assert len(case.stages.candidates) == 0
    assert len(case.unsure) == 8
    found = ORACLES[name].apply(case)
    complete = {
        "no_missed_lines",
        "perfect_confidence",
        "perfect_threshold",
        "true_segments",
        "true_segments_linked",
        "labels",
    }
    assert len(found.polylines) == (1 if name in complete else 0)


@pytest.mark.parametrize("name", ORACLES)
def test_an_image_without_labels_is_no_mistake(case_of: MakeCase, name: str) -> None:
    case = case_of(up(40), [])
    kept = {"model", "no_missed_lines", "perfect_linking", "perfect_places", "perfect_ends"}
    assert len(ORACLES[name].apply(case).polylines) == (1 if name in kept else 0)


def test_the_ladder_leads_from_the_model_to_the_labels_without_a_gap() -> None:
    assert LADDER[0].below == "model"
    assert LADDER[-1].above == "labels"
    assert [step.above for step in LADDER[:-1]] == [step.below for step in LADDER[1:]]
    assert {name for step in LADDER for name in step[1:]} <= set(ORACLES)


def test_a_line_beside_its_label_is_repaired_by_places_and_by_nothing_before(case_of: MakeCase) -> None:
    """5 px are twice the radius (128 / 50 = 2.56 px), but less than three times."""
    case = case_of(up(45), [LEFT])
    assert scores(ORACLES["model"].apply(case), [LEFT])["f1"] == 0
    assert scores(ORACLES["perfect_linking"].apply(case), [LEFT])["f1"] == 0
    assert len(ORACLES["no_false_candidates"].apply(case).polylines) == 0
    assert scores(ORACLES["perfect_places"].apply(case), [LEFT])["f1"] > 0.98


def test_a_line_that_goes_on_too_far_is_cut_by_ends(case_of: MakeCase) -> None:
    label = [[40.0, 64.0], [40.0, 32.0]]
    case = case_of(up(40), [label])
    for name in ("model", "perfect_places", "perfect_linking"):
        assert scores(ORACLES[name].apply(case), [label])["precision"] == pytest.approx(0.5, abs=0.06)
    for name in ("perfect_ends", "perfect_linking_only", "no_false_candidates"):
        assert scores(ORACLES[name].apply(case), [label])["precision"] > 0.95


def test_a_made_up_line_goes_where_false_ones_are_dropped(case_of: MakeCase) -> None:
    case = case_of(np.concatenate([up(40), up(88)]), [LEFT])
    for name in ("model", "no_missed_lines", "perfect_linking", "perfect_places", "perfect_ends"):
        assert len(ORACLES[name].apply(case).polylines) == 2, name
    for name in (
        "no_false_lines",
        "perfect_linking_only",
        "no_false_candidates",
        "perfect_confidence",
        "perfect_candidates",
    ):
        assert len(ORACLES[name].apply(case).polylines) == 1, name


def test_a_missed_line_is_added_and_segments_that_nobody_saw_come_last(case_of: MakeCase) -> None:
    case = case_of(up(40), [LEFT, RIGHT])
    for name, count in {"model": 1, "no_missed_lines": 2, "perfect_threshold": 1, "true_segments": 2}.items():
        assert len(ORACLES[name].apply(case).polylines) == count


def test_perfect_linking_keeps_what_the_linker_finds_too_short(case_of: MakeCase) -> None:
    case = case_of(up(40, [1]), [LEFT])
    assert len(ORACLES["model"].apply(case).polylines) == 0
    (line,) = ORACLES["perfect_linking"].apply(case).polylines
    assert line[[0, -1]] == pytest.approx(np.array([[40.0, 48.0], [40.0, 32.0]]))


def test_of_segments_side_by_side_perfect_linking_takes_one(case_of: MakeCase) -> None:
    case = case_of(np.concatenate([up(39), up(41.5)]), [LEFT])
    (line,) = ORACLES["perfect_linking_only"].apply(case).polylines
    assert np.ptp(line[:, 0]) < 0.5


def test_perfect_confidence_takes_the_best_of_each_place_whatever_its_score(case_of: MakeCase) -> None:
    case = case_of(np.concatenate([up(41.5), up(40.5)]), [LEFT], threshold=0.95)
    (line,) = ORACLES["perfect_confidence"].apply(case).polylines
    assert line[:, 0] == pytest.approx(40.5)


def test_places_say_where_along_which_label(case_of: MakeCase) -> None:
    case = case_of(up(40), [[[40.0, 48.0], [40.0, 16.0]], RIGHT])
    asked = Segments(np.concatenate([up(41), up(87, [2]), up(64, [1]), up(40, [1])[:, ::-1]]))
    places = places_along(asked, case, 2.56)
    assert places.owners.tolist() == [0, 0, 0, 0, 1, -1, -1]
    assert places.beyond.tolist() == [True, False, False, True, False, False, False]
    assert places.at[:5] == pytest.approx([-8, 8, 24, 40, 40], abs=1)
    assert places.directions[1] == pytest.approx([0, -1])


def test_the_continuation_follows_the_end_of_the_label(case_of: MakeCase) -> None:
    """The label bends to the right; what lies straight on from its lower part is not behind its end."""
    label = [[20.0, 64.0], [20.0, 32.0], [52.0, 32.0]]
    case = case_of(up(20), [label])
    ahead = Segments([[[60.0, 32.0], [70.0, 32.0]], [[20.0, 16.0], [20.0, 6.0]]])
    assert places_along(ahead, case, 2.0).beyond.tolist() == [True, False]


def test_best_candidates_equal_a_slow_search(case_of: MakeCase) -> None:
    case = case_of(up(40), [LEFT, RIGHT])
    rng = np.random.default_rng(3)
    chosen = case.chords.endpoints[rng.integers(0, len(case.chords), 60)]
    candidates = Segments(chosen + rng.normal(0, 2, (60, 2, 2)))
    best = best_candidates(case.chords, candidates, case)
    for chord, index in zip(case.chords.endpoints, best, strict=True):
        distances = [np.sqrt(((chord - each) ** 2).sum(axis=1).mean()) for each in candidates.endpoints]
        nearest = int(np.argmin(distances))
        assert index == (nearest if distances[nearest] <= case.radius else -1)
    assert (best >= 0).any()


def test_undirected_candidates_may_point_back(case_of: MakeCase) -> None:
    back = Segments(up(40)[:, ::-1])
    assert (best_candidates(back, Segments(up(40)), case_of(up(40), [LEFT])) == -1).all()
    either = case_of(up(40), [LEFT], directed=False)
    assert best_candidates(back, Segments(up(40)), either).tolist() == [0, 1, 2, 3]
    backwards = case_of(up(40), [LEFT[::-1]], directed=False)
    (line,) = ORACLES["perfect_linking"].apply(backwards).polylines
    assert line[0] == pytest.approx([40, 0], abs=0.5)


def test_the_covered_share_is_a_part_of_the_length(case_of: MakeCase) -> None:
    case = case_of(up(40), [LEFT])
    half = Polylines.from_list([[[40.0, 64.0], [40.0, 32.0]], [[100.0, 60.0], [100.0, 10.0]]])
    assert covered_share(half, case.truth, case).tolist() == [1, 0]
    assert covered_share(case.truth, half, case) == pytest.approx([0.5], abs=0.06)  # the radius reaches on


def test_slack_makes_labels_longer_in_the_image(case_of: MakeCase) -> None:
    case = case_of(up(40), [[[40.0, 48.0], [40.0, 16.0]], [[5.0, 5.0]]], slack=2.5)
    assert case.truth.vertices.tolist() == [[40, 50.5], [40, 13.5], [5, 5]]
    assert case.labels.vertices.tolist() == [[40, 48], [40, 16], [5, 5]]


def test_a_larger_image_has_the_same_result_in_its_own_pixels(tiny_model: Path) -> None:
    predictor = see_everything(load(tiny_model))
    labels = Polylines.from_list([np.array(LEFT) * 10 + (0, 80), np.array(RIGHT) * 10 + (0, 80)])
    image = np.full((720, 1280, 3), 200, np.uint8)
    case = make_case(predictor, Sample("a", image, labels, (), (720, 1280)), image, threshold=0.5)
    assert case.radius == pytest.approx(128 / 50)
    for name, oracle in ORACLES.items():
        (left, right) = oracle.apply(case).polylines
        assert left[[0, -1]] == pytest.approx(np.array(LEFT) * 10 + (0, 80), abs=5), name
        assert right[:, 0] == pytest.approx(880, abs=5), name
