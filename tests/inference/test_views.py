from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.inference.preprocess import FILL
from yolino.inference.views import Box, ImageRaster, Pixels, view
from yolino.inference.windows import Window


def at(left: int, top: int) -> Window:
    return Window(left, top, (0, 0, 0, 0))


def noise(height: int, width: int) -> np.ndarray:
    return np.random.default_rng(1).integers(0, 256, (height, width, 3), dtype=np.uint8)


class MaskedRaster:
    """An image of which only some pixels are valid; remembers what was read."""

    def __init__(self, image: np.ndarray, valid: np.ndarray) -> None:
        self.image, self.valid, self.boxes = image, valid, []
        self.size = image.shape[:2]

    def read(self, box: Box) -> Pixels:
        left, top, right, bottom = box
        assert 0 <= left < right <= self.size[1]
        assert 0 <= top < bottom <= self.size[0]
        self.boxes.append(box)
        return Pixels(self.image[top:bottom, left:right], self.valid[top:bottom, left:right])


def test_at_scale_1_the_pixels_are_those_of_the_image() -> None:
    image = noise(100, 150)
    pixels, valid = view(ImageRaster(image), at(32, 64), (32, 64), 1.0)
    np.testing.assert_array_equal(pixels, image[64:96, 32:96])
    assert valid is None


def test_beyond_the_scene_it_is_gray_and_not_valid() -> None:
    image = noise(40, 50)
    pixels, valid = view(ImageRaster(image), at(-32, 32), (64, 96), 1.0)
    np.testing.assert_array_equal(pixels[:8, 32:82], image[32:])
    assert valid is not None
    assert valid.sum() == 8 * 50
    assert (pixels[~valid] == FILL).all()
    pixels, valid = view(ImageRaster(image), at(64, 0), (32, 32), 1.0)
    assert (pixels == FILL).all()
    assert not valid.any()


def test_gray_images_work() -> None:
    assert view(ImageRaster(np.full((9, 9), 7, np.uint8)), at(0, 0), (9, 9), 1.0).rgb.shape == (9, 9, 3)


@pytest.mark.parametrize("factor", [2, 4, 8])
def test_half_a_pixel_per_pixel_is_the_mean_of_blocks(factor: int) -> None:
    image = noise(40 * factor, 48 * factor)
    pixels, _ = view(ImageRaster(image), at(32, 0), (32, 16), 1 / factor)
    blocks = image.reshape(40, factor, 48, factor, 3).astype(float).mean(axis=(1, 3))
    np.testing.assert_allclose(pixels, blocks[:32, 32:48], atol=0.51)


@pytest.mark.parametrize("scale", [0.1, 0.3, 0.75, 0.9, 1.0, 1.5, 2.0, 3.7])
def test_a_slope_stays_where_it_is_to_a_fraction_of_a_pixel(scale: float) -> None:
    """The gray of a slope tells the place: pixel u of the network shows the place (u + 0.5) / scale."""
    side, steep = int(80 / scale), 230 * scale / 32
    ramp = np.clip(10 + ((np.arange(side) + 0.5) - 32 / scale) * steep, 0, 255).round().astype(np.uint8)
    image = np.zeros((side, side, 3), np.uint8)
    image[:, :, 0], image[:, :, 1] = ramp[None], ramp[:, None]
    pixels, valid = view(ImageRaster(image), at(32, 32), (32, 32), scale)
    assert valid is None
    wanted = 10 + (np.arange(32) + 0.5) * 230 / 32
    for found in (pixels[0, :, 0], pixels[:, 0, 1]):
        np.testing.assert_allclose(found, wanted, atol=2.1)
        assert abs((found - wanted).mean()) * 32 / 230 < 0.05  # pixels of the network


@given(st.floats(0.06, 4.0), st.integers(0, 6), st.integers(0, 6), st.integers(-3, 3), st.integers(10, 90))
@settings(deadline=None, max_examples=60)
def test_what_two_windows_see_of_one_place_is_the_same(
    scale: float, left: int, top: int, shift: int, edge: int
) -> None:
    image = noise(edge, 140)
    one, seen_one = view(ImageRaster(image), at(32 * left, 32 * top), (128, 128), scale)
    other, seen_other = view(ImageRaster(image), at(32 * (left + shift), 32 * top), (128, 128), scale)
    a, b = max(32 * shift, 0), max(-32 * shift, 0)
    width = 128 - abs(32 * shift)
    np.testing.assert_array_equal(one[:, a : a + width], other[:, b : b + width])
    full = np.ones((128, 128), np.bool_)
    seen_one, seen_other = (full if seen is None else seen for seen in (seen_one, seen_other))
    np.testing.assert_array_equal(seen_one[:, a : a + width], seen_other[:, b : b + width])


@pytest.mark.parametrize("scale", [0.25, 0.6, 1.0, 1.7])
def test_a_pixel_is_valid_where_its_center_is(scale: float) -> None:
    rng = np.random.default_rng(2)
    raster = MaskedRaster(noise(90, 80), rng.random((90, 80)) < 0.7)
    _, valid = view(raster, at(0, 0), (128, 160), scale)
    assert valid is not None
    for row in range(128):
        for column in range(160):
            y, x = (row + 0.5) / scale, (column + 0.5) / scale
            assert valid[row, column] == (y < 90 and x < 80 and raster.valid[int(y), int(x)])


def test_only_what_is_needed_is_read() -> None:
    raster = MaskedRaster(noise(1000, 1000), np.ones((1000, 1000), np.bool_))
    view(raster, at(96, 32), (64, 64), 0.5)
    ((left, top, right, bottom),) = raster.boxes
    assert 190 <= left <= 192
    assert 62 <= top <= 64
    assert 320 <= right <= 322
    assert 192 <= bottom <= 194
