"""Color as one matrix, light, blur, noise, erasing: what each may and may not do to the pixels."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.training.photometric import (
    Photometric,
    add_glare,
    add_noise,
    blur,
    cast_shadows,
    compress,
    erase_rectangle,
)

RNG = np.random.default_rng
LUMA = np.array([0.299, 0.587, 0.114])
PICTURE = cv2.resize(RNG(0).integers(0, 256, (9, 13, 3), np.uint8), (120, 80), interpolation=cv2.INTER_CUBIC)

EFFECTS: dict[str, Callable[[np.ndarray, np.random.Generator], np.ndarray]] = {
    "shadow": cast_shadows,
    "glare": add_glare,
    "blur": blur,
    "noise": add_noise,
    "jpeg": compress,
    "erasing": lambda image, rng: erase_rectangle(image, rng, (0.02, 0.15)),
}


def color(seed: int, mean: tuple[float, float, float] = (100, 100, 100), **options: float) -> np.ndarray:
    return Photometric(**options).color_matrix(np.array(mean, float), RNG(seed))


def test_without_options_nothing_changes() -> None:
    assert np.array_equal(Photometric()(PICTURE, RNG(0)), PICTURE)


@settings(deadline=None)
@given(seed=st.integers(0, 1000))
def test_brightness_scales_all_values(seed: int) -> None:
    matrix = color(seed, brightness=0.5)
    assert np.allclose(matrix, np.eye(3, 4) * matrix[0, 0])
    assert 0.5 <= matrix[0, 0] <= 1.5


@settings(deadline=None)
@given(seed=st.integers(0, 1000))
def test_contrast_keeps_the_mean_gray(seed: int) -> None:
    mean = np.array([10.0, 200.0, 90.0])
    matrix = color(seed, (10, 200, 90), contrast=0.5)
    gray = float(LUMA @ mean)
    assert np.allclose(matrix @ [gray, gray, gray, 1], gray)
    assert 0.5 <= matrix[0, 0] <= 1.5
    assert np.allclose(matrix[:, :3], np.eye(3) * matrix[0, 0])


@settings(deadline=None)
@given(seed=st.integers(0, 1000))
def test_saturation_keeps_grays_and_luma(seed: int) -> None:
    matrix = color(seed, saturation=0.5)[:, :3]
    assert np.allclose(matrix @ np.full(3, 70.0), 70)
    pixel = np.array([200.0, 30.0, 90.0])
    assert np.isclose(LUMA @ matrix @ pixel, LUMA @ pixel)
    gray = np.full(3, LUMA @ pixel)
    factor = (matrix @ pixel - gray) / (pixel - gray)
    assert np.allclose(factor, factor[0])
    assert 0.5 <= factor[0] <= 1.5


@settings(deadline=None)
@given(seed=st.integers(0, 1000))
def test_hue_keeps_grays_and_luma(seed: int) -> None:
    matrix = color(seed, hue=0.2)[:, :3]
    assert np.allclose(matrix @ np.full(3, 70.0), 70, atol=0.5)
    pixel = np.array([200.0, 30.0, 90.0])
    assert np.isclose(LUMA @ matrix @ pixel, LUMA @ pixel, atol=1)


def test_half_a_turn_of_hue_makes_red_cyan() -> None:
    extreme = max((color(seed, hue=0.5) for seed in range(300)), key=lambda m: -m[0, 0])
    pixel = extreme[:, :3] @ [200.0, 50.0, 50.0]
    assert pixel[0] < pixel[1] + 1e-6
    assert pixel[0] < pixel[2]


def test_temperature_moves_red_against_blue() -> None:
    for seed in range(20):
        red, green, blue = np.diag(color(seed, temperature=0.1)[:, :3])
        assert green == 1
        assert np.isclose(red + blue, 2)
        assert abs(red - 1) <= 0.1


def test_gain_is_per_channel() -> None:
    gains = np.diag(color(3, gain=0.1)[:, :3])
    assert len(set(gains)) == 3
    assert np.all(np.abs(gains - 1) <= 0.1)


def test_the_matrix_is_applied_to_rgb_and_saturates() -> None:
    image = np.zeros((4, 4, 3), np.uint8)
    image[:] = (250, 100, 7)
    jitter = Photometric(brightness=0.5, contrast=0.2, saturation=0.5, hue=0.1)
    probe = RNG(4)
    probe.random()  # the call draws once for shadows before the color
    matrix = jitter.color_matrix(np.array([250.0, 100.0, 7.0]), probe)
    want = np.clip(matrix @ [250, 100, 7, 1], 0, 255)
    assert np.abs(jitter(image, RNG(4))[0, 0] - want).max() <= 1


@settings(deadline=None)
@given(seed=st.integers(0, 1000))
def test_gamma_is_monotone_and_keeps_the_ends(seed: int) -> None:
    ramp = np.repeat(np.arange(256, dtype=np.uint8).reshape(16, 16, 1), 3, axis=2)
    curve = Photometric(gamma=1.5)(ramp, RNG(seed))[..., 0].ravel().astype(int)
    assert (curve[0], curve[255]) == (0, 255)
    assert np.all(np.diff(curve) >= 0)
    assert 255 * 0.5**1.5 - 2 <= curve[128] <= 255 * 0.5 ** (1 / 1.5) + 2


@pytest.mark.parametrize("name", EFFECTS)
@pytest.mark.parametrize("size", [(80, 120), (1, 1), (1, 50), (33, 7)])
def test_every_effect_runs_on_odd_sizes_and_is_deterministic(name: str, size: tuple[int, int]) -> None:
    image = np.ascontiguousarray(PICTURE[: size[0], : size[1]])
    for seed in range(10):
        before = image.copy()
        first, second = (EFFECTS[name](image, RNG(seed)) for _ in range(2))
        assert first.shape == image.shape
        assert first.dtype == np.uint8
        assert np.array_equal(first, second)
        assert np.array_equal(image, before)


@pytest.mark.parametrize("name", EFFECTS)
def test_a_probability_of_one_always_applies_the_effect(name: str) -> None:
    changed = [
        not np.array_equal(Photometric(**{name: 1.0})(PICTURE, RNG(seed)), PICTURE) for seed in range(20)
    ]
    assert sum(changed) >= 18  # a shadow or a glow may fall beside the picture


def test_a_shadow_darkens_only_and_glare_brightens_only() -> None:
    dark = np.array([cast_shadows(PICTURE, RNG(seed)) for seed in range(20)])
    bright = np.array([add_glare(PICTURE, RNG(seed)) for seed in range(20)])
    assert np.all(dark <= PICTURE)
    assert np.all(bright >= PICTURE)
    assert np.any(dark < PICTURE * 0.8)
    assert np.any(bright > PICTURE.astype(int) + 30)


def test_noise_keeps_the_mean() -> None:
    flat = np.full((200, 200, 3), 128, np.uint8)
    for seed in range(5):
        noisy = add_noise(flat, RNG(seed)).astype(float) - 128
        assert abs(noisy.mean()) < 0.6
        assert 0.5 < noisy.std() < 20 / np.sqrt(3) + 0.5
        assert np.abs(noisy).max() <= 21


def test_compression_keeps_the_channels() -> None:
    red = np.zeros((64, 64, 3), np.uint8)
    red[..., 0] = 200
    assert np.abs(compress(red, RNG(0)).astype(int) - red).max() < 10


@settings(deadline=None)
@given(seed=st.integers(0, 10**6))
def test_the_erased_rectangle_has_the_area_and_one_color(seed: int) -> None:
    image = np.zeros((200, 300, 3), np.uint8)
    erased = erase_rectangle(image, RNG(seed), (0.05, 0.1))
    rows, columns = (np.flatnonzero(erased.any(axis=(2, axis))) for axis in (1, 0))
    if len(rows) > 5:  # a black patch cannot be seen on black
        height, width = rows[-1] - rows[0] + 1, columns[-1] - columns[0] + 1
        assert height * width <= 0.1 * image[..., 0].size * 1.02
        patch = erased[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].astype(float)
        assert np.all(patch.std(axis=(0, 1)) < 20 / np.sqrt(3) + 1)
