"""The official CULane rules: cases computed by hand, a slow literal twin, and what must not matter."""

from __future__ import annotations

import math
import os
from itertools import pairwise, permutations
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.metrics.culane import THRESHOLDS, CULaneMetric
from yolino.metrics.culane_lines import drawn_pixels, pixels_inside, spline_points
from yolino.types import Polylines, Segments

SIZE = (590, 1640)
SMALL = (60, 90)
DATA = Path(os.environ.get("YOLINO_DATA", Path(__file__).parents[2] / "../shared/data")) / "culane"
vertex = st.tuples(st.integers(-12, 100), st.integers(-12, 72))
small_lanes = st.lists(st.lists(vertex, min_size=0, max_size=4), max_size=4)

Image = tuple[list, list]


def across(*rows: float) -> list[np.ndarray]:
    """Level lanes through the centers of pixel rows, over the whole width and beyond."""
    return [np.array([[-100.0, row + 0.5], [1800.0, row + 0.5]]) for row in rows]


def metric_of(
    *images: Image, frame: tuple[int, int] = SIZE, ignore: tuple = (), **settings: object
) -> CULaneMetric:
    metric = CULaneMetric(**settings)  # type: ignore[arg-type]
    for prediction, truth in images:
        metric.update(Polylines.from_list(prediction), Polylines.from_list(truth), frame, ignore)
    return metric


def counts(*images: Image, **settings: object) -> tuple[int, ...]:
    return tuple(metric_of(*images, **settings).counts().values())  # type: ignore[arg-type]


def small_metric(*images: Image, **settings: object) -> CULaneMetric:
    return metric_of(*images, frame=SMALL, **{"size": SMALL, "width": 6, **settings})  # type: ignore[arg-type]


def wild_lanes(rng: np.random.Generator, n: int, size: tuple[int, int], most: int = 5) -> list[np.ndarray]:
    """Lanes of 0 to `most` vertices that may leave the image."""
    spread = np.array([size[1], size[0]])
    return [rng.uniform(-0.3, 1.3, (rng.integers(0, most + 1), 2)) * spread for _ in range(n)]


def on_road(rng: np.random.Generator, n: int) -> list[np.ndarray]:
    """Lanes like the benchmark's: a vertex in every 20th row from below the image, to a vanishing point."""
    t = np.linspace(0, 1, 17)
    return [
        np.stack(
            [rng.uniform(-900, 2500) * (1 - t) + 800 * t + 200 * rng.normal() * t * (1 - t), 600 - 320 * t],
            axis=1,
        )
        for _ in range(n)
    ]


def moved(lanes: list[np.ndarray], rng: np.random.Generator, by: float) -> list[np.ndarray]:
    return [lane + rng.normal(0, by, 2) for lane in lanes]


# The twin: every rule as it is written, one step after the other.


def literal_points(lane: np.ndarray) -> list[np.ndarray]:
    points = np.float32(lane)
    if len(points) == 2:
        return list(points)
    n = len(points)
    h = [math.dist(a.tolist(), b.tolist()) for a, b in pairwise(points)]
    system, right = np.eye(n), np.zeros((n, 2))
    for i in range(1, n - 1):
        system[i, i - 1 : i + 2] = h[i - 1], 2 * (h[i - 1] + h[i]), h[i]
        right[i] = 6 * ((points[i + 1] - points[i]) / h[i] - (points[i] - points[i - 1]) / h[i - 1])
    bend = np.linalg.solve(system, right)
    curve = []
    for i in range(n - 1):
        slope = (points[i + 1] - points[i]) / h[i] - h[i] * (2 * bend[i] + bend[i + 1]) / 6
        for k in range(50):
            t = h[i] / 50 * k
            cubic = points[i] + slope * t + bend[i] / 2 * t**2 + (bend[i + 1] - bend[i]) / (6 * h[i]) * t**3
            curve.append(np.float32(cubic))
    return [*curve, points[-1]]


def literal_mask(lane: np.ndarray, size: tuple[int, int], width: int) -> np.ndarray:
    mask = np.zeros(size, np.uint8)
    points = [[round(float(x)), round(float(y))] for x, y in literal_points(lane)]
    for start, end in pairwise(points):
        cv2.line(mask, start, end, 1, width)
    return mask.astype(bool)


def literal_iou(a: np.ndarray, b: np.ndarray, size: tuple[int, int], width: int, kept: np.ndarray) -> float:
    if min(len(a), len(b)) < 2:
        return 0.0
    one, other = literal_mask(a, size, width) & kept, literal_mask(b, size, width) & kept
    union = (one | other).sum()
    return (one & other).sum() / union if union else 0.0


def literal_counts(
    image: Image, size: tuple[int, int], width: int, iou: float, ignored: np.ndarray | None = None
) -> tuple[int, int, int]:
    kept = np.ones(size, bool) if ignored is None else ~ignored
    sides = [[lane - 0.5 for lane in map(np.array, side)] for side in image]
    masks = [[literal_mask(x, size, width) if len(x) > 1 else kept[:0] for x in side] for side in sides]
    prediction, truth = (
        [lane for lane, mask in zip(*each, strict=True) if not mask.any() or (mask & kept).any()]
        for each in zip(sides, masks, strict=True)
    )
    few, many = sorted((prediction, truth), key=len)
    matrix = np.array([[literal_iou(a, b, size, width, kept) for b in many] for a in few])
    pairings = ([matrix[i, j] for i, j in enumerate(p)] for p in permutations(range(len(many)), len(few)))
    tp = sum(value > iou for value in max(pairings, key=sum))
    return tp, len(prediction) - tp, len(truth) - tp


def in_polygon(x: float, y: float, polygon: list[list[float]]) -> bool:
    """The even-odd rule by the angle-free crossing test, for one point."""
    inside = False
    for (ax, ay), (bx, by) in pairwise([*polygon, polygon[0]]):
        if (ay > y) != (by > y) and x < (bx - ax) * (y - ay) / (by - ay) + ax:
            inside = not inside
    return inside


def mask_of(polygons: list[np.ndarray], size: tuple[int, int]) -> np.ndarray:
    return np.array(
        [
            [any(in_polygon(x + 0.5, y + 0.5, p.tolist()) for p in polygons) for x in range(size[1])]
            for y in range(size[0])
        ]
    )


# By hand


@pytest.mark.parametrize(("shift", "rows"), [(0, 31), (3, 28), (10, 21), (11, 20), (30, 1), (31, 0)])
def test_level_lanes_overlap_in_the_rows_they_share(shift: int, rows: int) -> None:
    # OpenCV paints 30 px as 31 rows: 15 on both sides of the middle one.
    iou = rows / (62 - rows)
    metric = metric_of((across(300 + shift), across(300)))
    assert metric.counts() == {"tp": int(iou > 0.5), "fp": int(iou <= 0.5), "fn": int(iou <= 0.5)}
    assert metric.compute()["f1_mean"] == pytest.approx(sum(iou > 0.05 * i for i in range(10, 20)) / 10)


def test_the_iou_must_exceed_the_threshold() -> None:
    # 2 px are drawn as 3 rows, of which neighbors share 2 of 4.
    image = (across(301), across(300))
    assert counts(image, width=2, iou=0.5) == (0, 1, 1)
    assert counts(image, width=2, iou=0.4999) == (1, 0, 0)
    assert metric_of(image, width=2, iou=0.4999).compute()["f1_mean"] == 0
    assert THRESHOLDS.tolist() == [0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95]


def test_scores_are_ratios_of_the_counts_of_all_images() -> None:
    images = [(across(100, 300, 500), across(100)), (across(200), across(205, 400)), ([], across(50))]
    metric = metric_of(*images)
    assert metric.counts() == {"tp": 2, "fp": 2, "fn": 2}
    # 5 rows apart the IoU is 26/36 = .72: above five of the ten thresholds, and the lane at 100 above all.
    expected = {"precision": 0.5, "recall": 0.5, "f1": 0.5, "f1_mean": (5 * 0.5 + 5 * 0.25) / 10}
    assert metric.compute() == pytest.approx(expected)
    assert metric_of(*images, iou=0.75).compute() == pytest.approx(
        {**expected, "precision": 0.25, "recall": 0.25, "f1": 0.25}
    )


def test_the_pairing_has_the_largest_sum_of_overlaps() -> None:
    # The best single pair (305, 300: .72) would leave 292 and 312 with .22: the others have .63 and .59.
    assert counts((across(305, 292), across(300, 312))) == (2, 0, 0)
    # Not the most true positives: .94 + .19 is more than .51 + .51.
    assert counts((across(300, 311), across(301, 290))) == (1, 1, 1)


def test_a_label_is_found_once() -> None:
    assert counts((across(300, 300, 301), across(300))) == (1, 2, 0)
    assert counts((across(300), across(300, 300))) == (1, 0, 1)


def test_the_spline_is_natural_and_runs_over_the_chords() -> None:
    # Two chords of 5: 20 M = 6 (-.8 - .8), so the middle of the first is 2 + 25/16 * .48 = 2.75 high.
    points = spline_points(np.array([[0, 0], [3, 4], [6, 0.0]]))
    assert points.shape == (101, 2)
    expected = [[0, 0], [1.5, 2.75], [3, 4], [4.5, 2.75], [6, 0]]
    np.testing.assert_allclose(points[::25], expected, atol=1e-6)
    np.testing.assert_allclose(points[:, 0], np.arange(101) * 0.06, atol=1e-6)


def test_two_vertices_stay_straight() -> None:
    ends = np.array([[3, 4], [500.25, 80]])
    np.testing.assert_array_equal(spline_points(ends), ends)


def test_repeated_vertices_are_one() -> None:
    lane = np.array([[10, 500], [40, 300], [200, 180], [600, 60.0]])
    repeated = lane[[0, 0, 1, 2, 2, 2, 3, 3]]
    np.testing.assert_array_equal(spline_points(repeated), spline_points(lane))
    assert len(spline_points(lane[[0, 1, 1]])) == 2


@pytest.mark.parametrize("times", [2, 3, 5])
def test_a_lane_without_length_is_a_dot(times: int) -> None:
    dot = cv2.circle(np.zeros(SIZE, np.uint8), (70, 80), 15, 1, -1)
    pixels = drawn_pixels(np.array([[70.0, 80.0]] * times), SIZE, 30)
    np.testing.assert_array_equal(pixels, np.flatnonzero(dot))


def test_halves_are_rounded_to_the_even_pixel() -> None:
    for y, row in ((9.5, 10), (10.5, 10), (10.51, 11), (10.5 + 1e-8, 10)):  # the last in single precision
        assert drawn_pixels(np.array([[2, y], [2, y]]), (20, 5), 1).tolist() == [5 * row + 2]


def test_points_on_halves_are_exactly_there() -> None:
    points = spline_points(np.array([[0, 7], [25, 32], [50, 57.0]]))
    np.testing.assert_array_equal(points, np.arange(101)[:, None] / 2 + [0, 7])


def test_coordinates_are_shifted_to_pixel_centers() -> None:
    # The line runs through the pixels of row 50, whose centers lie at 50.5.
    line = [np.array([[0.5, 50.5], [89.5, 50.5]])]
    for top, tp in ((49, 1), (50, 0), (51, 1)):
        box = np.array([[0, top], [90, top], [90, top + 1], [0, top + 1.0]])
        assert counts((line, line), frame=SMALL, size=None, width=1, ignore=(box,)) == (tp, 0, 0)


# The twin


@pytest.mark.parametrize("n", [3, 4, 8, 25])
def test_splines_equal_the_twin(n: int) -> None:
    rng = np.random.default_rng(n)
    for _ in range(20):
        lane = rng.uniform(-300, 1900, (n, 2))
        np.testing.assert_allclose(spline_points(lane), literal_points(lane), rtol=0, atol=2e-3)


@pytest.mark.parametrize("width", [1, 2, 5, 30])
@pytest.mark.parametrize("size", [SIZE, (75, 64), (40, 1)])
def test_pixels_are_those_drawn_on_the_whole_image(size: tuple[int, int], width: int) -> None:
    rng = np.random.default_rng(width)
    lanes = wild_lanes(rng, 30, size)
    if size == SIZE:
        lanes = [*lanes[:10], *on_road(rng, 10)]
    covered = 0
    for lane in lanes:
        pixels = drawn_pixels(lane, size, width)
        points = np.rint(spline_points(lane)).astype(int).tolist()
        mask = np.zeros(size, np.uint8)
        for start, end in pairwise(points):
            cv2.line(mask, start, end, 1, width)
        np.testing.assert_array_equal(pixels, np.flatnonzero(mask))
        covered += len(pixels) > 0
    assert covered > 8


@pytest.mark.parametrize("iou", [0.2, 0.5, 0.75])
def test_counts_equal_the_twin(iou: float) -> None:
    rng = np.random.default_rng(11)
    total = np.zeros(3, int)
    for _ in range(30):
        truth = wild_lanes(rng, rng.integers(0, 5), SMALL)
        prediction = [*moved(truth[1:], rng, 1.5), *wild_lanes(rng, rng.integers(0, 3), SMALL)]
        expected = literal_counts((prediction, truth), SMALL, 6, iou)
        assert tuple(small_metric((prediction, truth), iou=iou).counts().values()) == expected
        total += expected
    assert (total > 5).all()


def test_counts_equal_the_twin_at_the_benchmarks_size() -> None:
    rng = np.random.default_rng(2)
    for _ in range(3):
        truth = on_road(rng, 3)
        prediction = moved(truth, rng, 8)[::-1]
        assert counts((prediction, truth)) == literal_counts((prediction, truth), SIZE, 30, 0.5)


def test_counts_with_ignored_regions_equal_the_twin() -> None:
    rng = np.random.default_rng(5)
    total = np.zeros(3, int)
    for _ in range(15):
        truth = wild_lanes(rng, 4, SMALL)
        prediction = [*moved(truth[1:], rng, 1.5), *wild_lanes(rng, 1, SMALL)]
        polygons = [rng.uniform(-0.2, 1.2, (rng.integers(3, 6), 2)) * SMALL[::-1] for _ in range(2)]
        expected = literal_counts((prediction, truth), SMALL, 6, 0.5, mask_of(polygons, SMALL))
        assert tuple(small_metric((prediction, truth), ignore=polygons).counts().values()) == expected
        total += expected
    assert (total > 5).all()


def test_insides_equal_the_even_odd_rule() -> None:
    star = np.array([[20, 2], [32, 38], [1, 15], [39, 15], [8, 38.0]])
    beside = np.array([[-5, -5], [3, -5], [3, 45], [-5, 45.0]])
    rng = np.random.default_rng(0)
    for polygons in ([star], [star, beside], [], *([rng.uniform(-10, 50, (6, 2))] for _ in range(4))):
        inside = pixels_inside([p - 0.5 for p in polygons], (40, 40)).reshape(40, 40)
        np.testing.assert_array_equal(inside, mask_of(polygons, (40, 40)))


# What must hold


def test_ignored_pixels_count_on_neither_side() -> None:
    truth, prediction = across(300), [np.array([[0.5, 300.5], [780.5, 300.5]])]
    right = np.array([[780, 0], [1640, 0], [1640, 590], [780, 590.0]])
    assert counts((prediction, truth)) == (0, 1, 1)
    assert counts((prediction, truth), ignore=(right,)) == (1, 0, 0)


def test_a_lane_of_which_nothing_is_left_does_not_count() -> None:
    top = np.array([[0, 0], [1640, 0], [1640, 200], [0, 200.0]])
    images = (across(100, 300), across(100, 150, 400))
    assert counts(images) == (1, 1, 2)
    assert counts(images, ignore=(top,)) == (0, 1, 1)
    for lane in ([[5, 5]], [], [[-99, -99], [-50, -99]]):  # drawn nowhere, so nothing was removed
        assert counts(([lane], [lane]), ignore=(top,)) == counts(([lane], [lane])) == (0, 1, 1)


def test_lanes_that_are_not_seen_are_wrong() -> None:
    for lane in ([[5, 5]], [], [[-99, -99], [-50, -99]], [[5, 900], [9, 950], [20, 970]]):
        assert counts(([lane], [])) == (0, 1, 0)
        assert counts(([], [lane])) == (0, 0, 1)
        assert counts(([lane], [lane])) == (0, 1, 1)
        assert counts(([lane, *across(5)], [*across(5), lane])) == (1, 1, 1)


def test_a_segment_is_a_lane() -> None:
    metric = CULaneMetric()
    lanes = Polylines.from_list(across(100, 300))
    metric.update(Segments(np.array(across(100, 310, 500))), lanes, SIZE)
    metric.update(lanes, Segments(np.zeros((0, 2, 2))), SIZE)
    assert metric.counts() == {"tp": 2, "fp": 3, "fn": 0}


def test_empty_sides_have_defined_scores() -> None:
    zero, one = (dict.fromkeys(("precision", "recall", "f1", "f1_mean"), v) for v in (0.0, 1.0))
    assert metric_of(([], [])).compute() == one
    assert metric_of(([], across(3))).compute() == zero
    assert metric_of((across(3), [])).compute() == zero
    assert metric_of((across(3), across(200))).compute() == zero
    assert metric_of((across(3), across(3)), ([], [])).compute() == one


def test_scores_of_many_weights_at_once() -> None:
    images = [(across(100, 300), across(100)), (across(200), across(203, 400)), ([], [])]
    metric = metric_of(*images)
    scores = metric.weighted(np.array([[1, 0, 0], [2, 1, 0], [0, 0, 1.0]]))
    for i, chosen in enumerate(([0], [0, 0, 1], [2])):
        expected = metric_of(*(images[k] for k in chosen)).compute()
        assert {name: score[i] for name, score in scores.items()} == pytest.approx(expected)


@settings(deadline=None, max_examples=60)
@given(small_lanes, small_lanes, st.randoms(use_true_random=False), st.integers(1, 8))
def test_the_order_of_the_lines_does_not_matter(pred: list, gt: list, random: object, width: int) -> None:
    before = small_metric((pred, gt), width=width, iou=0.25).rows
    pred, gt = list(pred), list(gt)
    random.shuffle(pred)  # type: ignore[attr-defined]
    random.shuffle(gt)  # type: ignore[attr-defined]
    np.testing.assert_array_equal(before, small_metric((pred, gt), width=width, iou=0.25).rows)


def test_the_order_of_the_lines_does_not_choose_among_equally_good_pairings() -> None:
    # 3/19 + 4/33 + 10/33 is 3/19 + 6/33 + 8/33: one pair is above .25, or none.
    found = np.array([[[8, 5], [8, 11]], [[7, 6], [9, 1]], [[10, 7], [9, 4]]]) + 0.5
    wanted = np.array([[[7, 5], [6, 11]], [[11, 3], [1, 8]], [[7, 8], [5, 6]]]) + 0.5
    seen = {
        counts((list(found[list(a)]), list(wanted[list(b)])), frame=(12, 16), size=None, width=2, iou=0.25)
        for a in permutations(range(3))
        for b in permutations(range(3))
    }
    assert len(seen) == 1


@settings(deadline=None, max_examples=60)
@given(small_lanes, small_lanes)
def test_sides_can_be_exchanged(pred: list, gt: list) -> None:
    scores, other = small_metric((pred, gt)).compute(), small_metric((gt, pred)).compute()
    assert all(0 <= score <= 1 for score in scores.values())
    assert (scores["precision"], scores["recall"]) == (other["recall"], other["precision"])


def test_the_order_of_the_images_does_not_matter() -> None:
    rng = np.random.default_rng(1)
    images = [(wild_lanes(rng, 3, SMALL), wild_lanes(rng, 2, SMALL)) for _ in range(4)]
    assert small_metric(*images).compute() == small_metric(*images[::-1]).compute()


def test_the_direction_of_a_line_does_not_matter() -> None:
    rng = np.random.default_rng(8)
    truth = on_road(rng, 4)
    prediction = moved(truth, rng, 6)
    expected = metric_of((prediction, truth)).rows
    assert 0 < expected[0, 3:].reshape(10, 3)[:, 0].mean() < 4
    np.testing.assert_array_equal(metric_of(([x[::-1] for x in prediction], truth)).rows, expected)
    np.testing.assert_array_equal(metric_of((prediction, [x[::-1] for x in truth])).rows, expected)


def test_lanes_of_another_image_size_are_scaled() -> None:
    rng = np.random.default_rng(3)
    truth, region = on_road(rng, 4), np.array([[0, 0], [900, 0], [400, 500.0]])
    prediction = moved(truth, rng, 6)
    expected = metric_of((prediction, truth), ignore=(region,)).rows
    half, other = np.array([0.5, 0.5]), np.array([800 / 1640, 288 / 590])
    for scale, frame in ((half, (295, 820)), (other, (288, 800))):
        image = tuple([lane * scale for lane in side] for side in (prediction, truth))
        scaled = metric_of(image, frame=frame, ignore=(region * scale,))  # type: ignore[arg-type]
        np.testing.assert_array_equal(scaled.rows, expected)


def test_without_a_size_every_image_is_drawn_at_its_own() -> None:
    line = [np.array([[5, 900.5], [95, 900.5]])]
    below = [np.array([[5, 911.5], [95, 911.5]])]
    assert counts((line, below), frame=(1000, 100), size=None) == (0, 1, 1)
    # Scaled to 590 rows the two are 6.5 px apart.
    assert counts((line, below), frame=(1000, 100)) == (1, 0, 0)


@pytest.mark.parametrize("iou", [0.0, 1.0, -0.5, 50.0, math.nan])
def test_the_iou_must_be_between_0_and_1(iou: float) -> None:
    with pytest.raises(ValueError, match="iou must be above 0 and below 1"):
        CULaneMetric(iou=iou)


@pytest.mark.parametrize("width", [0, -1, 2.5, math.nan, math.inf, 40000])
def test_the_width_must_be_a_whole_number(width: float) -> None:
    with pytest.raises(ValueError, match="whole number of pixels"):
        CULaneMetric(width=width)


@pytest.mark.parametrize("size", [(0, 5), (5, -1)])
def test_sizes_must_be_positive(size: tuple[int, int]) -> None:
    nothing = Polylines.from_list([])
    with pytest.raises(ValueError, match="positive"):
        CULaneMetric(size=size)
    with pytest.raises(ValueError, match="positive"):
        CULaneMetric().update(nothing, nothing, size)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1.1e6])
def test_coordinates_must_be_finite_and_near(value: float) -> None:
    good, bad = Polylines.from_list(across(3)), Polylines.from_list([[[5, 5], [value, 9]]])
    metric = CULaneMetric()
    with pytest.raises(ValueError, match="The prediction has a line with a coordinate"):
        metric.update(bad, good, SIZE)
    with pytest.raises(ValueError, match="The truth has a line with a coordinate"):
        metric.update(good, Segments(bad.endpoints), SIZE)
    with pytest.raises(ValueError, match="an ignored polygon with a coordinate"):
        metric.update(good, good, SIZE, [np.array([[0, 0], [9, 9], [value, 0]])])
    with pytest.raises(ValueError, match="at least 3 corners"):
        metric.update(good, good, SIZE, [np.zeros((2, 2))])
    assert len(metric) == 0
    with pytest.raises(ValueError, match="first image"):
        metric.counts()


def test_the_farthest_allowed_lanes_are_drawn() -> None:
    far = [np.array([[-1e6, 300.5], [1e6, 300.5]]), np.array([[-1e6, -1e6], [800, 300], [1e6, 9e5]])]
    assert counts((far, far)) == (2, 0, 0)
    assert counts((far[:1], across(300))) == (1, 0, 0)


# Real files


def real_labels() -> list[list[np.ndarray]]:
    names = (DATA / "list" / "val.txt").read_text().split()
    files = [(DATA / name.lstrip("/")).with_suffix(".lines.txt") for name in names]
    return [
        [np.array(row.split(), float).reshape(-1, 2) + 0.5 for row in path.read_text().splitlines()]
        for path in files
    ]


@pytest.mark.skipif(not DATA.is_dir(), reason="the CULane frames are not here: set YOLINO_DATA")
def test_real_labels_score_perfectly_against_themselves() -> None:
    labels = real_labels()
    metric = metric_of(*((lanes[::-1], lanes) for lanes in labels))
    assert metric.counts() == {"tp": sum(map(len, labels)), "fp": 0, "fn": 0}
    assert metric.compute()["f1_mean"] == 1


@pytest.mark.skipif(not DATA.is_dir(), reason="the CULane frames are not here: set YOLINO_DATA")
def test_real_labels_are_counted_as_by_the_twin() -> None:
    rng = np.random.default_rng(6)
    for lanes in real_labels()[::12]:
        image = ([lane + rng.normal(0, 8, 2) for lane in lanes[1:]], lanes)
        assert counts(image) == literal_counts(image, SIZE, 30, 0.5)
