"""Pixels get the share of them that a stripe covers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.training.bands import Band
from yolino.training.stripes import Cover, cover, mix

ROWS = 9


def band(center: np.ndarray | float, half: float, width: int = 40) -> Band:
    ones = np.ones(ROWS)
    return Band(np.arange(ROWS), ones * center, ones * half, np.zeros(ROWS, np.int64), np.full(ROWS, width))


def slow(center: float, half: float, width: int, samples: int = 400) -> np.ndarray:
    """The covered share of each pixel of a row, with edges that fade over a pixel, by sampling."""
    shares = np.zeros(width)
    for column in range(width):
        x = column + (np.arange(samples) + 0.5) / samples  # the box of the pixel
        shares[column] = np.mean(np.abs(x - center) <= half)
    return shares


def drawn(found: Cover, width: int = 40) -> np.ndarray:
    image = np.zeros((ROWS, width))
    np.add.at(image, (found.rows, found.columns), found.share)
    return image


@settings(deadline=None, max_examples=30)
@given(center=st.floats(8, 30), half=st.floats(0.1, 6))
def test_an_upright_stripe_covers_what_it_covers(center: float, half: float) -> None:
    found = drawn(cover(band(center, half), np.ones(ROWS)))
    assert np.allclose(found, slow(center, half, 40), atol=0.02)


@settings(deadline=None, max_examples=40)
@given(
    center=st.floats(15, 20), slant=st.floats(-1.2, 1.2), half=st.floats(0.5, 3), softness=st.floats(0, 0.9)
)
def test_slant_and_softness_spread_a_stripe_but_keep_its_amount(
    center: float, slant: float, half: float, softness: float
) -> None:
    found = drawn(cover(band(center + slant * np.arange(ROWS), half), np.full(ROWS, 0.5), softness))
    assert np.allclose(found.sum(axis=1), half, rtol=0.12)  # half of 2 * half pixels; edges are sampled


def test_what_is_not_painted_and_what_is_no_picture_have_no_pixels() -> None:
    strength = np.zeros(ROWS)
    strength[3] = 1
    assert set(cover(band(10.0, 2.0), strength).rows) == {3}
    assert cover(band(39.0, 4.0), np.ones(ROWS)).columns.max() == 39
    assert len(cover(band(-90.0, 4.0), np.ones(ROWS)).rows) == 0


def test_across_is_the_distance_from_the_middle() -> None:
    found = cover(band(10.25, 2.0), np.ones(ROWS))
    assert np.allclose(found.across, found.columns + 0.5 - 10.25)


@pytest.mark.parametrize(("share", "want"), [(0.0, 100), (0.5, 150), (1.0, 200)])
def test_colors_are_mixed_by_their_share(share: float, want: int) -> None:
    image = np.full((2, 2, 3), 100, np.uint8)
    one = np.zeros(1, np.int64)
    mix(image, Cover(one, one, one, np.zeros(1), np.array([share])), np.full((1, 3), 200.0))
    assert image[0, 0].tolist() == [want] * 3
    assert np.all(image.reshape(-1, 3)[1:] == 100)
