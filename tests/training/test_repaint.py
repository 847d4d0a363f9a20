"""New paint lies on the label, right in perspective; the old paint goes, and the class is that of the new."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.datasets.road.layout import Pattern
from yolino.datasets.tusimple import CLASSES
from yolino.training import repaint
from yolino.training.augment import Augment
from yolino.training.repaint import DASHES, MARKINGS, Marking, repaint_lines
from yolino.types import Polylines, Sample

HEIGHT, WIDTH, VANISH = 160, 320, np.array([160.0, 30.0])
BOTTOMS = (-40.0, 160.0, 360.0)
LANE = 200.0  # pixels at the lower edge


def line(bottom: float) -> np.ndarray:
    y = np.arange(150.0, 34.0, -5.0)
    share = (y - VANISH[1]) / (HEIGHT - VANISH[1])
    return np.stack([VANISH[0] + share * (bottom - VANISH[0]), y], axis=1)


def road(paint: int = 0, color: tuple[int, int, int] = (230, 230, 230)) -> tuple[np.ndarray, Polylines]:
    image = np.full((HEIGHT, WIDTH, 3), 100, np.uint8)
    for bottom in BOTTOMS if paint else ():
        corners = np.array([VANISH, (bottom - paint / 2, HEIGHT), (bottom + paint / 2, HEIGHT)])
        cv2.fillPoly(image, [np.rint(corners).astype(np.int32)], color)
    return image, Polylines.from_list([line(b) for b in BOTTOMS], labels=[4, 4, 4])


def only(monkeypatch: pytest.MonkeyPatch, *kinds: str, moved: float = 0.0) -> None:
    monkeypatch.setattr(repaint, "MARKINGS", {kind: MARKINGS[kind] for kind in kinds})
    monkeypatch.setattr(repaint, "_MOVED", moved)


def center_of_paint(image: np.ndarray, row: int) -> float:
    weight = np.maximum(image[row, 100:220].astype(float).mean(axis=1) - 108, 0)
    return float((weight * (np.arange(100, 220) + 0.5)).sum() / weight.sum())


@pytest.mark.parametrize("seed", range(6))
def test_continuous_paint_lies_on_the_label(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    only(monkeypatch, "white", moved=1.0)
    image, lines = road()
    before = image.copy()
    found, moved = repaint_lines(image, lines, np.random.default_rng(seed), share=1.0, classes=CLASSES)
    assert np.array_equal(image, before)
    middle = moved[1:2].vertices
    assert np.any(moved.vertices[:, 0] != lines.vertices[:, 0])
    assert np.array_equal(moved.vertices[:, 1], lines.vertices[:, 1])
    assert [CLASSES[label] for label in moved.labels] == ["continuous white"] * 3
    for row in (90, 120, 145):
        x = np.interp(row + 0.5, middle[::-1, 1], middle[::-1, 0])
        assert center_of_paint(found, row) == pytest.approx(x, abs=0.4)


def test_a_line_moves_as_far_in_lanes_at_every_distance(monkeypatch: pytest.MonkeyPatch) -> None:
    only(monkeypatch, "white", moved=1.0)
    image, lines = road()
    _, moved = repaint_lines(image, lines, np.random.default_rng(0), share=1.0)
    shift = (moved.vertices - lines.vertices)[:, 0] / (LANE * (lines.vertices[:, 1] - 30) / 130)
    for own in np.split(shift, lines.offsets[1:-1]):
        assert np.allclose(own, own[0])
        assert 0 < abs(own[0]) < 0.2


def test_dashes_are_regular_on_the_ground(monkeypatch: pytest.MonkeyPatch) -> None:
    """Their beginnings, as reciprocals of the rows below the horizon, are equally far apart."""
    only(monkeypatch, "dashes")
    look = repaint._Look(Pattern(4.0, ((0.0, 2.0),), 0.5), 320.0, 250.0, 1.0, 0.0)
    monkeypatch.setattr(repaint, "_sample_look", lambda width, rng: look)
    image, lines = road()
    found, _ = repaint_lines(image, lines, np.random.default_rng(2), share=1.0)
    painted = found[:, 150:170].max(axis=(1, 2)) > 170
    starts = np.flatnonzero(np.diff(painted.astype(int)) == 1) + 1
    z = 320 * 3.7 / (LANE * (starts - 30) / 130)
    z = z[z < 22]
    assert len(z) >= 3
    assert np.abs(np.diff(z)) == pytest.approx(4.0, abs=0.6)


@pytest.mark.parametrize("stays", [0.0, 1.0])
def test_old_paint_goes_and_a_seam_may_stay(stays: float, monkeypatch: pytest.MonkeyPatch) -> None:
    invisible = Marking(("dashed",), 1.0, 1.0, width=(0.0, 0.0))
    monkeypatch.setattr(repaint, "MARKINGS", {"dashes": invisible})
    monkeypatch.setattr(repaint, "_LEAST_HALF", 0.0)
    monkeypatch.setattr(repaint, "_DARK_STAYS", stays)
    white, lines = road(paint=12)
    cleared, _ = repaint_lines(white, lines, np.random.default_rng(0), share=1.0)
    assert np.abs(cleared[70:].astype(int) - 100).max() <= 15  # grain
    seam, _ = road(paint=8, color=(40, 40, 40))
    cleared, _ = repaint_lines(seam, lines, np.random.default_rng(0), share=1.0)
    kept = np.abs(cleared.astype(int) - seam)[70:].max()
    assert kept <= 1 if stays else kept > 50


def test_paint_is_as_bright_as_the_light_on_the_road(monkeypatch: pytest.MonkeyPatch) -> None:
    only(monkeypatch, "white")
    image, lines = road()
    image[100:130] = 40
    found, _ = repaint_lines(image, lines, np.random.default_rng(0), share=1.0)
    lit, dark = found[145, 155:165].max(), found[115, 155:165].max()
    assert lit > 140
    assert 60 < dark < 0.7 * lit


def test_yellow_is_yellow(monkeypatch: pytest.MonkeyPatch) -> None:
    only(monkeypatch, "yellow")
    image, lines = road()
    found, _ = repaint_lines(image, lines, np.random.default_rng(0), share=1.0)
    red, green, blue = found[140, 160].astype(int)
    assert red > green > blue + 30


def test_a_car_stays() -> None:
    image, lines = road()
    image[95:118, 90:230] = (20, 20, 120)
    for seed in range(6):
        found, _ = repaint_lines(image, lines, np.random.default_rng(seed), share=1.0)
        assert np.array_equal(found[95:118, 90:230], image[95:118, 90:230])


def test_lines_that_are_mostly_covered_stay() -> None:
    _, lines = road()
    blocks = np.random.default_rng(0).integers(0, 256, (HEIGHT // 4, WIDTH // 8, 3), np.uint8)
    image = np.repeat(np.repeat(blocks, 8, axis=1), 4, axis=0)
    found, moved = repaint_lines(image, lines, np.random.default_rng(0), share=1.0, classes=CLASSES)
    assert found is image
    assert np.array_equal(moved.vertices, lines.vertices)
    assert np.array_equal(moved.labels, lines.labels)


def labels_of(classes: tuple[str, ...], count: int = 12) -> set[int]:
    image, lines = road()
    return {
        int(label)
        for seed in range(count)
        for label in repaint_lines(image, lines, np.random.default_rng(seed), share=1.0, classes=classes)[
            1
        ].labels
    }


def test_labels_follow_the_paint_where_the_dataset_can_name_it() -> None:
    named = {CLASSES[label] for label in labels_of(CLASSES)}
    assert named == {"dashed", "continuous white", "continuous yellow", "Botts' dots"}
    assert labels_of(("other", "dashed")) == {1}
    assert labels_of(("continuous", "dashed")) == {0, 1}
    assert labels_of(("lane",)) == {4}
    assert labels_of(()) == {4}


def test_only_what_can_be_named_is_painted() -> None:
    image, lines = road()
    for seed in range(10):
        found, _ = repaint_lines(image, lines, np.random.default_rng(seed), share=1.0, classes=("dashed",))
        bright = found[45:, 150:170].max(axis=(1, 2)) > 125
        assert not bright.all()  # gaps


def test_every_class_is_one_of_the_benchmark_or_a_group_of_them() -> None:
    for marking in MARKINGS.values():
        assert marking.classes[0] in CLASSES
    assert sum(marking.inner for marking in MARKINGS.values()) == pytest.approx(1)
    assert sum(marking.outer for marking in MARKINGS.values()) == pytest.approx(1)
    assert all(0 < length < period for period, length in DASHES)


def test_without_lanes_nothing_changes() -> None:
    image, lines = road()
    outside = lines.with_vertices(lines.vertices + np.array([5000, 0]))
    for labels, share in ((lines, 0.0), (lines[:0], 1.0), (lines[:1], 1.0), (outside, 1.0)):
        found, same = repaint_lines(image, labels, np.random.default_rng(0), share=share)
        assert found is image
        assert np.array_equal(same.vertices, labels.vertices)


def test_far_from_the_lines_the_image_stays() -> None:
    image, lines = road(paint=8)
    image = np.clip(image + np.random.default_rng(0).integers(-8, 9, image.shape), 0, 255).astype(np.uint8)
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    lane = np.maximum(LANE * (y - 30) / 130, 0)
    distance = np.min([np.abs(x - (160 + (b - 160) * lane / LANE)) for b in BOTTOMS], axis=0)
    for seed in range(6):
        found, _ = repaint_lines(image, lines, np.random.default_rng(seed), share=1.0)
        far = distance > 0.25 * lane + 6
        assert np.array_equal(found[far], image[far])


@settings(deadline=None, max_examples=40)
@given(
    points=st.lists(st.lists(st.tuples(st.floats(-400, 700), st.floats(-200, 400)), max_size=5), max_size=5),
    size=st.sampled_from([(HEIGHT, WIDTH), (1, 1), (13, 40), (200, 3)]),
    seed=st.integers(0, 99),
)
def test_any_labels_run_and_a_seed_gives_one_result(
    points: list[list[tuple[float, float]]], size: tuple[int, int], seed: int
) -> None:
    lines = Polylines.from_list(points)
    image = np.random.default_rng(seed).integers(90, 110, (*size, 3), np.uint8)
    first, again = (repaint_lines(image, lines, np.random.default_rng(seed), share=0.7) for _ in range(2))
    assert first[0].shape == image.shape
    assert np.array_equal(first[0], again[0])
    assert np.array_equal(first[1].vertices, again[1].vertices)
    assert np.array_equal(first[1].offsets, lines.offsets)


def test_augment_tells_the_classes() -> None:
    image, lines = road()
    augment = Augment((HEIGHT, WIDTH), lines={"repaint": 1})
    result = augment(Sample("a", image, lines), np.random.default_rng(0), classes=("other", "dashed"))
    assert result.polylines.labels.tolist() == [1, 1, 1]
    with pytest.raises(ValueError, match=r"repaint is -1\.0, but must be a probability"):
        Augment((HEIGHT, WIDTH), lines={"repaint": -1})
