"""The matrix from the image frame to the network frame."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.geometry import fit_matrix, transform_points

sizes = st.tuples(st.integers(1, 5000), st.integers(1, 5000))


def corners(size: tuple[int, int], fit: str, network: tuple[int, int] = (320, 640)) -> list[list[float]]:
    frame = np.array([[0.0, 0.0], [size[1], size[0]]])
    return transform_points(frame, fit_matrix(size, network, fit)).round(6).tolist()


def test_tusimple_loses_the_top_80_rows_and_is_halved() -> None:
    want = [[0.5, 0.0, 0.0], [0.0, 0.5, -40.0], [0.0, 0.0, 1.0]]
    assert fit_matrix((720, 1280), (320, 640), "bottom").tolist() == want


def test_the_three_fits_by_hand() -> None:
    assert corners((200, 640), "bottom") == [[0, 120], [640, 320]]
    assert corners((100, 320), "stretch") == [[0, 0], [640, 320]]
    assert corners((100, 400), "letterbox") == [[0, 80], [640, 240]]
    assert corners((640, 640), "letterbox") == [[160, 0], [480, 320]]


def test_a_window_is_centered_and_not_scaled() -> None:
    assert corners((640, 660), "window") == [[-10, -160], [650, 480]]
    assert corners((320, 640), "window") == [[0, 0], [640, 320]]


@settings(deadline=None)
@given(image=sizes, network=sizes)
def test_bottom_fills_the_width_and_touches_the_bottom(
    image: tuple[int, int], network: tuple[int, int]
) -> None:
    matrix = fit_matrix(image, network, "bottom")
    assert matrix[0, 0] == matrix[1, 1]
    low = transform_points(np.array([[0.0, image[0]], [image[1], image[0]]]), matrix)
    assert np.allclose(low, [[0, network[0]], [network[1], network[0]]])


@settings(deadline=None)
@given(image=sizes, network=sizes)
def test_letterbox_shows_everything_centered(image: tuple[int, int], network: tuple[int, int]) -> None:
    matrix = fit_matrix(image, network, "letterbox")
    frame = transform_points(np.array([[0.0, 0.0], [image[1], image[0]]]), matrix)
    assert np.all(frame[0] >= -1e-6)
    assert np.all(frame[1] <= np.array(network[::-1]) + 1e-6)
    assert np.allclose(frame.sum(axis=0), network[::-1])
    assert np.isclose(np.max((frame[1] - frame[0]) / network[::-1]), 1)


def test_mistakes() -> None:
    with pytest.raises(ValueError, match="fit is 'top', but must be"):
        fit_matrix((10, 10), (10, 10), "top")
    with pytest.raises(ValueError, match="must be positive"):
        fit_matrix((0, 10), (10, 10), "bottom")
