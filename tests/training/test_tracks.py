"""The width of a lane follows from the lines; the ground beside a line is told from what stands on it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.training.bands import LEAST_ROWS
from yolino.training.tracks import build_road, ground_beside, track_of
from yolino.types import Polylines

HEIGHT, WIDTH, HORIZON, LANE = 160, 320, 30.0, 200.0
GROWTH = LANE / (HEIGHT - HORIZON)


def lanes(*bottoms: float, top: float = 40.0, bottom: float = 150.0) -> Polylines:
    """Straight lines to a vanishing point on the horizon, by their x at the lower edge of the image."""
    y = np.array([bottom, (top + bottom) / 2, top])
    share = (y - HORIZON) / (HEIGHT - HORIZON)
    return Polylines.from_list([np.stack([160 + share * (x - 160), y], axis=1) for x in bottoms])


def plain(value: int = 100) -> np.ndarray:
    return np.full((HEIGHT, WIDTH, 3), value, np.uint8)


def test_a_lane_is_as_wide_as_its_lines_are_apart_in_every_row() -> None:
    road = build_road(lanes(-40, 160, 360), (HEIGHT, WIDTH))
    assert np.allclose(road.growth, GROWTH)
    assert np.allclose(road.offset, -GROWTH * HORIZON)
    assert np.allclose(road.lane(1, np.array([HORIZON, 95.0, HEIGHT])), [0, LANE / 2, LANE])
    assert road.lane(1, np.array(HORIZON - 20)) == 0


def test_lines_are_continued_to_the_lower_edge_but_not_upwards() -> None:
    road = build_road(lanes(60, 260), (HEIGHT, WIDTH))
    rows = np.flatnonzero(~np.isnan(road.centers[0]))
    assert rows[0] == 40
    assert rows[-1] == HEIGHT - 1
    assert road.centers[0, -1] == pytest.approx(160 + (HEIGHT - 0.5 - HORIZON) / 130 * -100)
    assert np.isnan(road.columns[0, -1])


def test_a_line_whose_neighbour_goes_elsewhere_takes_the_lane_of_the_others() -> None:
    side = np.array([[450.0, 150.0], [900.0, 120.0], [450.0, 90.0]])  # its distance is that of no lane
    road = build_road(Polylines.from_list([*lanes(60, 260), side]), (HEIGHT, WIDTH))
    assert np.allclose(road.growth, GROWTH)


@pytest.mark.parametrize("lines", [lanes(), lanes(100), Polylines.from_list([[(5, 5)], [(9, 9), (9, 8)]])])
def test_nothing_is_known_of_a_lane_without_two_lines(lines: Polylines) -> None:
    road = build_road(lines, (HEIGHT, WIDTH))
    assert len(road.growth) == len(lines)
    assert np.isnan(road.growth).all()
    ground = ground_beside(plain(), road)
    assert not ground.bare.any()
    assert [track_of(road, ground, line) for line in range(len(lines))] == [None] * len(lines)


def test_lines_that_get_no_wider_tell_no_lane() -> None:
    lines = Polylines.from_list([[(x, 150), (x, 10)] for x in (50, 100, 150)])
    assert np.isnan(build_road(lines, (HEIGHT, WIDTH)).growth).all()


def test_the_ground_has_its_color_and_is_bare() -> None:
    image = plain()
    image[..., 0] = 90
    ground = ground_beside(image, build_road(lanes(60, 260), (HEIGHT, WIDTH)))
    assert np.allclose(ground.color[:, 41:], [90, 100, 100], atol=1e-3)
    assert np.allclose(ground.bare[:, 41:], 1)
    assert not ground.bare[:, :40].any()  # above the labels


def test_a_shadow_on_the_whole_road_is_bare_and_a_car_is_not() -> None:
    image = plain()
    image[80:110] = 30
    road = build_road(lanes(60, 260), (HEIGHT, WIDTH))
    assert ground_beside(image, road).bare[:, 85:105].min() == pytest.approx(1)
    assert np.allclose(ground_beside(image, road).color[:, 95], 30)
    image = plain()
    x = int(road.centers[0, 120])
    image[110:130, x - 45 : x + 45] = 20
    bare = ground_beside(image, road).bare
    assert not bare[0, 108:132].any()
    assert bare[0, 145] == pytest.approx(1)
    assert bare[1, 120] == pytest.approx(1)


def test_beside_the_picture_the_other_side_stands_for_both() -> None:
    lines, image = lanes(60, 260), plain()
    left = int(build_road(lines, (HEIGHT, WIDTH)).centers[0, 120])
    image[:, :left] = 255
    corners = np.array([[left, 0.0], [WIDTH, 0.0], [WIDTH, HEIGHT], [left, HEIGHT]])
    road = build_road(lines, (HEIGHT, WIDTH), corners)
    track = track_of(road, ground_beside(image, road), 0)
    assert track is not None
    at = track.band.rows == 121
    assert np.allclose(track.color[at], 100)
    assert track.bare[at] > 0.9


def test_a_track_ends_where_its_line_leaves_the_picture() -> None:
    road = build_road(lanes(-440, -140, 160), (HEIGHT, WIDTH))
    track = track_of(road, ground_beside(plain(), road), 0)
    assert track is not None
    assert track.band.rows[-1] < 110
    assert np.allclose(track.lane, road.lane(0, track.band.rows + 0.5))
    assert track_of(build_road(lanes(-4000, -3800), (HEIGHT, WIDTH)), ground_beside(plain(), road), 0) is None


@settings(deadline=None, max_examples=40)
@given(
    points=st.lists(st.lists(st.tuples(st.floats(-400, 700), st.floats(-200, 400)), max_size=5), max_size=5),
    size=st.sampled_from([(HEIGHT, WIDTH), (1, 1), (13, 40), (200, 3)]),
)
def test_any_labels_run(points: list[list[tuple[float, float]]], size: tuple[int, int]) -> None:
    road = build_road(Polylines.from_list(points), size)
    ground = ground_beside(np.full((*size, 3), 77, np.uint8), road)
    assert np.all((ground.bare >= 0) & (ground.bare <= 1))
    assert np.allclose(ground.color[ground.bare > 0], 77, atol=1e-3)
    for line in range(len(points)):
        track = track_of(road, ground, line)
        assert track is None or len(track.band.rows) >= LEAST_ROWS
