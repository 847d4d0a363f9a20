from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from yolino.inference.tracking import Tracked, Tracker
from yolino.types import Polylines

SIZE = (720, 1280)


def upright(x: float, top: float = 100, bottom: float = 700) -> np.ndarray:
    """A straight line upward at `x`, with several vertices."""
    return np.stack([np.full(9, x), np.linspace(bottom, top, 9)], axis=1)


def spiral(turns: float = 2.0) -> np.ndarray:
    angle = np.linspace(0, 2 * np.pi * turns, 120)
    return np.stack([640 + 20 * angle * np.cos(angle), 360 + 20 * angle * np.sin(angle)], axis=1)


def follow(tracker: Tracker, frames: list[list[ArrayLike]]) -> list[Tracked]:
    return [tracker(Polylines.from_list(lines), SIZE) for lines in frames]


def id_near(found: Tracked, line: np.ndarray) -> int:
    """The identity of the polyline whose vertices have nearly the same x as those of `line` on average."""
    away = [abs(one[:, 0].mean() - line[:, 0].mean()) for one in found.polylines]
    return int(found.ids[np.argmin(away)])


def test_identities_are_numbered_from_one_and_stay() -> None:
    lines = [upright(300), upright(600), spiral()]
    for found in follow(Tracker(), [lines] * 5):
        assert found.ids.tolist() == [1, 2, 3]
        assert found.seen.all()


def test_without_smoothing_the_polylines_stay_as_they_were_found() -> None:
    rng = np.random.default_rng(0)
    tracker = Tracker()
    for _ in range(4):
        lines = [upright(300) + rng.normal(0, 5, (9, 2)), upright(600) + rng.normal(0, 5, (9, 2))]
        frame = Polylines.from_list(lines, rng.random(2), rng.integers(0, 3, 2))
        found = tracker(frame, SIZE)
        assert found.ids.tolist() == [1, 2]
        order = np.argsort([line[0, 0] for line in frame])
        np.testing.assert_array_equal(found.polylines.vertices, frame[order].vertices)
        np.testing.assert_array_equal(found.polylines.scores, frame.scores[order])
        np.testing.assert_array_equal(found.polylines.labels, frame.labels[order])


@pytest.mark.parametrize("smooth", [False, True])
def test_identities_are_stable_under_noise_and_changing_ends(smooth: bool) -> None:
    rng = np.random.default_rng(1)
    tracker = Tracker(smooth=smooth)
    truth = [upright(200), upright(500), upright(800), spiral()]
    for step in range(30):
        frame = []
        for line in truth:
            moved = line + rng.normal(0, 4, line.shape) + np.array([3.0 * np.sin(step / 5), 0])
            frame.append(moved[: rng.integers(len(line) // 2 + 1, len(line) + 1)])
        found = tracker(Polylines.from_list([frame[i] for i in rng.permutation(4)]), SIZE)
        assert sorted(found.ids) == [1, 2, 3, 4]
        assert [id_near(found, line) for line in truth[:3]] == [1, 2, 4]  # in the order of their starts
    assert tracker.born == 4


def test_winding_lines_keep_their_identities() -> None:
    rng = np.random.default_rng(5)
    walks = [
        rng.uniform((200, 200), (1000, 600)) + rng.normal(2, 12, (20, 2)).cumsum(axis=0) for _ in range(20)
    ]
    tracker = Tracker()
    for _ in range(6):
        found = tracker(Polylines.from_list([walk + rng.normal(0, 2, (20, 2)) for walk in walks]), SIZE)
        assert found.ids.tolist() == list(range(1, 21))


def test_a_line_keeps_its_identity_while_it_is_hidden() -> None:
    frames: list[list[ArrayLike]] = [[upright(300), upright(600)]] * 3 + [[upright(300)]] * 5
    found = follow(Tracker(deaths=5), [*frames, [upright(300), upright(600)]])
    assert [one.ids.tolist() for one in found[3:8]] == [[1]] * 5
    assert found[-1].ids.tolist() == [1, 2]


def test_a_line_that_was_hidden_for_too_long_is_a_new_one() -> None:
    frames: list[list[ArrayLike]] = [[upright(300), upright(600)]] * 3 + [[upright(300)]] * 6
    found = follow(Tracker(deaths=5), [*frames, [upright(300), upright(600)]])
    assert found[-1].ids.tolist() == [1, 3]


def test_a_hidden_line_is_found_where_its_motion_took_it() -> None:
    frames: list[list[ArrayLike]] = [[upright(300.0 + 20 * i)] for i in range(20)]
    frames[12:16] = [[]] * 4  # it moves by 100 pixels meanwhile, the reach is 64
    found = follow(Tracker(deaths=4), frames)
    assert all(one.ids.tolist() == [1] for one in found if len(one.ids))


def test_lines_that_pass_each_other_keep_their_identities() -> None:
    frames: list[list[ArrayLike]] = [[upright(400.0 + 6 * i), upright(600.0 - 6 * i)] for i in range(40)]
    found = follow(Tracker(), frames)
    assert found[0].ids.tolist() == [1, 2]
    for one, (right, left) in list(zip(found, frames, strict=True))[20:]:
        assert (id_near(one, np.asarray(right)), id_near(one, np.asarray(left))) == (1, 2)


def test_lines_that_cross_keep_their_identities() -> None:
    rng = np.random.default_rng(2)
    steps = np.linspace(0, 1, 12)[:, None]
    ids = []
    tracker = Tracker()
    for i in range(40):
        falling = np.array([300.0 + 5 * i, 200.0]) + steps * (400.0, 300.0)
        rising = np.array([500.0 - 5 * i, 500.0]) + steps * (400.0, -300.0)
        lines = [line + rng.normal(0, 2, line.shape) for line in (falling, rising)]
        found = tracker(Polylines.from_list(lines), SIZE)
        ids.append([int(k) for line in lines for k in found.ids if _is(found, int(k), line)])
    assert ids == [[1, 2]] * 40


def _is(found: Tracked, number: int, line: np.ndarray) -> bool:
    (index,) = np.flatnonzero(found.ids == number)
    return bool(np.array_equal(list(found.polylines)[index], line))


def test_a_new_line_gets_a_new_identity() -> None:
    found = follow(Tracker(), [[upright(300)], [upright(300), upright(900)], [upright(900)]])
    assert [one.ids.tolist() for one in found] == [[1], [1, 2], [2]]


def test_an_opposite_line_in_the_same_place_is_another_one_where_direction_counts() -> None:
    frames = [[upright(300)], [upright(300)[::-1]]]
    assert follow(Tracker(), frames)[1].ids.tolist() == [2]
    undirected = follow(Tracker(directed=False), frames)[1]
    assert undirected.ids.tolist() == [1]
    np.testing.assert_array_equal(undirected.polylines.vertices, upright(300)[::-1])
    smooth = follow(Tracker(directed=False, smooth=True), frames)[1]
    assert smooth.ids.tolist() == [1]
    np.testing.assert_allclose(smooth.polylines.vertices, upright(300))


def test_labels_decide_between_lines_that_are_close() -> None:
    tracker = Tracker()
    tracker(Polylines.from_list([upright(300), upright(320)], labels=[0, 1]), SIZE)
    found = tracker(Polylines.from_list([upright(318), upright(302)], labels=[0, 1]), SIZE)
    labels = dict(zip(found.ids.tolist(), found.polylines.labels.tolist(), strict=True))
    assert labels == {1: 0, 2: 1}


def test_the_choice_is_the_best_for_all_lines_together() -> None:
    # The known line at 300 is nearest to the one found at 310, but then the one at 330 would have none.
    found = follow(Tracker(), [[upright(300), upright(330)], [upright(310), upright(370)]])[1]
    assert found.ids.tolist() == [1, 2]
    assert [line[0, 0] for line in found.polylines] == [310, 370]


def test_births_wait_for_several_frames_but_in_the_first() -> None:
    found = follow(Tracker(births=3), [[upright(300)], *([[upright(300), upright(900)]] * 4)])
    assert [one.ids.tolist() for one in found] == [[1], [1], [1], [1, 2], [1, 2]]
    flickering: list[list[ArrayLike]] = [[], [upright(300)], [], [upright(300)], [upright(300)]]
    assert [len(one.ids) for one in follow(Tracker(births=2), flickering)] == [0, 0, 0, 0, 1]


def test_smoothing_by_hand() -> None:
    tracker = Tracker(smooth=True, weight=0.5)
    tracker(Polylines.from_list([[(100, 200), (200, 200)]], [0.8], [1]), SIZE)
    found = tracker(Polylines.from_list([[(120, 204), (250, 204)]], [0.4], [1]), SIZE)
    # Half of the way across; along the line, the ends are those that were found.
    np.testing.assert_allclose(found.polylines.vertices, [(120, 202), (250, 202)])
    np.testing.assert_allclose(found.polylines.scores, [0.6])
    # The motion takes alpha^2 / (2 - alpha) = 1/6 of the 4 pixels: the line is expected at 202 + 2/3. It is
    # found at 204: at 203 + 1/3.
    found = tracker(Polylines.from_list([[(120, 204), (250, 204)]], [0.6], [1]), SIZE)
    np.testing.assert_allclose(found.polylines.vertices, [(120, 203 + 1 / 3), (250, 203 + 1 / 3)])
    np.testing.assert_allclose(found.polylines.scores, [0.6])
    # It is missed: it goes on by 2/3 + (4/3)/6, and half of its score is gone.
    held = tracker(Polylines.from_list([]), SIZE)
    assert held.seen.tolist() == [False]
    np.testing.assert_allclose(held.polylines.vertices[:, 1], 203 + 1 / 3 + 2 / 3 + 2 / 9)
    np.testing.assert_allclose(held.polylines.scores, [0.3])


def test_smoothing_calms_a_trembling_line_and_follows_a_moving_one() -> None:
    rng = np.random.default_rng(3)
    still, moving = Tracker(smooth=True), Tracker(smooth=True)
    found, calm = [], []
    for i in range(100):
        line = upright(600 + rng.normal(0, 4))
        found.append(line[:, 0].mean())
        calm.append(still(Polylines.from_list([line]), SIZE).polylines.vertices[:, 0].mean())
        seen = moving(Polylines.from_list([upright(100.0 + 5 * i)]), SIZE).polylines.vertices
        if i > 30:  # no lag behind a steady motion
            np.testing.assert_allclose(seen[:, 0], 100.0 + 5 * i, atol=0.01)
    assert np.std(calm[20:]) < 0.75 * np.std(found[20:])
    assert np.std(np.diff(calm[20:])) < 0.5 * np.std(np.diff(found[20:]))


def test_smoothing_does_not_pull_at_the_ends_or_the_shape() -> None:
    tracker = Tracker(smooth=True)
    line = spiral()
    for part in (line, line[:60], line[20:], line, line[5:80]):
        found = tracker(Polylines.from_list([part]), SIZE)
        assert found.ids.tolist() == [1]
        np.testing.assert_allclose(found.polylines.vertices, part, atol=1e-9)


def test_labels_are_voted_on() -> None:
    tracker = Tracker(smooth=True, weight=0.4)
    voted = []
    for label in (0, 0, 0, 1, 0, 1, 1, 1):
        found = tracker(Polylines.from_list([upright(300)], labels=[label]), SIZE)
        assert found.ids.tolist() == [1]
        voted += found.polylines.labels.tolist()
    # Votes in units of the weight, for 0: 1, 1.6, 1.96, 1.18, 1.71, 1.02, ...; for 1: 0, 0, 0, 1, .6, 1.36.
    assert voted == [0, 0, 0, 0, 0, 1, 1, 1]


@pytest.mark.parametrize("smooth", [False, True])
def test_the_order_of_the_polylines_does_not_matter(smooth: bool) -> None:
    rng = np.random.default_rng(4)
    one, other = Tracker(smooth=smooth), Tracker(smooth=smooth)
    for _ in range(15):
        count = int(rng.integers(2, 7))
        lines = [upright(float(x)) + rng.normal(0, 3, (9, 2)) for x in rng.choice(12, count, False) * 100]
        scores, labels = rng.random(count), rng.integers(0, 2, count)
        frame = Polylines.from_list(lines, scores, labels)
        first, second = one(frame, SIZE), other(frame[rng.permutation(count)], SIZE)
        np.testing.assert_array_equal(first.ids, second.ids)
        np.testing.assert_array_equal(first.polylines.vertices, second.polylines.vertices)


def test_nothing_and_lines_without_length_are_no_lines() -> None:
    tracker = Tracker()
    assert len(tracker(Polylines.from_list([]), SIZE).ids) == 0
    points = Polylines.from_list([[(5, 5)], np.zeros((0, 2)), [(7, 7), (7, 7)], upright(300)])
    assert tracker(points, SIZE).ids.tolist() == [1]
    assert len(tracker(Polylines.from_list([]), SIZE).ids) == 0


@pytest.mark.parametrize(
    "wrong",
    [{"reach": 0.0}, {"births": 0}, {"deaths": -1}, {"weight": 0.0}, {"weight": 1.5}, {"label_cost": -1.0}],
)
def test_wrong_arguments_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="A tracker needs"):
        Tracker(**wrong)  # type: ignore[arg-type]


coordinates = st.integers(0, 60).map(lambda value: 10.0 * value)
line = st.lists(st.tuples(coordinates, coordinates), min_size=0, max_size=4)
frames = st.lists(st.lists(st.tuples(line, st.integers(0, 2)), max_size=5), min_size=1, max_size=8)


@given(frames, st.booleans(), st.booleans(), st.integers(1, 3), st.integers(0, 3))
@settings(max_examples=40, deadline=None)
def test_there_are_never_more_lines_than_found_and_known_and_identities_are_unique(
    video: list[list[tuple[list[tuple[float, float]], int]]],
    smooth: bool,
    directed: bool,
    births: int,
    deaths: int,
) -> None:
    tracker, highest = Tracker(smooth=smooth, directed=directed, births=births, deaths=deaths), 0
    for frame in video:
        before = tracker.alive
        polylines = Polylines.from_list([points for points, _ in frame], labels=[label for _, label in frame])
        found = tracker(polylines, SIZE)
        assert tracker.alive <= before + len(frame)
        assert len(found.ids) == len(found.polylines) == len(found.seen) <= tracker.alive
        assert len(set(found.ids.tolist())) == len(found.ids)
        assert found.seen.sum() <= len(frame)
        assert (found.ids >= 1).all()
        assert (np.diff(found.ids) > 0).all()
        assert np.isfinite(found.polylines.vertices).all()
        assert ((found.polylines.scores >= 0) & (found.polylines.scores <= 1)).all()
        assert found.ids.max(initial=0) <= tracker.born
        assert tracker.born >= highest
        highest = tracker.born
