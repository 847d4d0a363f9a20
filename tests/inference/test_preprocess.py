from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yolino.geometry import fit_matrix, transform_points
from yolino.inference import Preprocess
from yolino.inference.preprocess import FILL

FITS = ("bottom", "stretch", "letterbox")


def smooth_image(height: int, width: int) -> np.ndarray:
    """A picture without edges that differs per channel and along both axes."""
    y, x = np.mgrid[0:height, 0:width].astype(np.float64) + 0.5
    u, v = x / width, y / height
    channels = [40 + 150 * u, 60 + 120 * v, 128 + 80 * np.sin(2 * u + 3 * v)]
    return np.stack(channels, axis=2).round().astype(np.uint8)


def sampled(image: np.ndarray, matrix: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """The slow twin: every pixel center of the input is looked up in the image, linearly, gray outside."""
    y, x = np.mgrid[0 : size[0], 0 : size[1]] + 0.5
    at = transform_points(np.stack([x, y], axis=2).reshape(-1, 2), np.linalg.inv(matrix))
    height, width = image.shape[:2]
    column, row = np.clip(at[:, 0] - 0.5, 0, width - 1), np.clip(at[:, 1] - 0.5, 0, height - 1)
    left, top = (
        np.minimum(column.astype(int), max(width - 2, 0)),
        np.minimum(row.astype(int), max(height - 2, 0)),
    )
    right, bottom = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    a, b = (column - left)[:, None], (row - top)[:, None]
    value = (image[top, left] * (1 - a) + image[top, right] * a) * (1 - b)
    value += (image[bottom, left] * (1 - a) + image[bottom, right] * a) * b
    inside = ((at >= 0) & (at <= (width, height))).all(axis=1)
    return np.where(inside[:, None], value, FILL).reshape(*size, 3)


@pytest.mark.parametrize("fit", FITS)
@pytest.mark.parametrize(
    "size",
    [(720, 1280), (360, 640), (320, 640), (590, 1640), (1080, 1920), (480, 640), (101, 333), (1000, 300)],
)
def test_equals_the_warp_with_the_same_matrix(size: tuple[int, int], fit: str) -> None:
    image = smooth_image(*size)
    preprocess = Preprocess((320, 640), fit)
    fitted, to_image = preprocess(image)
    assert fitted.shape == (320, 640, 3)
    matrix = fit_matrix(size, (320, 640), fit)
    np.testing.assert_allclose(to_image @ matrix, np.eye(3), atol=1e-9)
    np.testing.assert_array_equal(preprocess.matrix(size), matrix)
    difference = np.abs(fitted - sampled(image, matrix, (320, 640)))
    rows, columns = _away_from_the_padding(matrix, size)
    assert difference[rows, columns].max() < 1.5
    assert difference[rows, columns].mean() < 0.5


def _away_from_the_padding(matrix: np.ndarray, size: tuple[int, int]) -> tuple[slice, slice]:
    (left, top), (right, bottom) = transform_points(np.array([[0.0, 0.0], size[::-1]]), matrix)
    return slice(max(int(np.ceil(top)) + 1, 0), int(bottom) - 1), slice(
        max(int(np.ceil(left)) + 1, 0), int(right) - 1
    )


def test_tusimple_loses_the_top_80_rows_and_is_halved() -> None:
    image = np.random.default_rng(0).integers(0, 256, (720, 1280, 3), dtype=np.uint8)
    fitted, to_image = Preprocess((320, 640))(image)
    blocks = image[80:].reshape(320, 2, 640, 2, 3).astype(np.float64).mean(axis=(1, 3))
    assert np.abs(fitted - blocks).max() <= 0.5 + 1e-9
    np.testing.assert_allclose(transform_points(np.array([[320.0, 160.0]]), to_image), [[640.0, 400.0]])


@pytest.mark.parametrize(("factor", "most"), [(2, 0.5), (4, 1.0), (8, 1.5)])
def test_halving_several_times_is_the_mean_of_blocks_but_for_rounding(factor: int, most: float) -> None:
    """The slow twin has one rounding; each halving has one of its own."""
    rng = np.random.default_rng(factor)
    image = rng.integers(0, 256, (32 * factor, 64 * factor, 3), dtype=np.uint8)
    fitted, _ = Preprocess((32, 64), "stretch")(image)
    blocks = image.reshape(32, factor, 64, factor, 3).astype(np.float64).mean(axis=(1, 3))
    assert np.abs(fitted - blocks).max() <= most + 1e-9


@pytest.mark.parametrize(
    ("size", "fit", "reduction"),
    [
        ((720, 1280), "bottom", 2),
        ((360, 640), "bottom", 1),
        ((719, 1279), "bottom", 1),  # .5004 is left: less than half the pixels would be there
        ((1080, 1920), "letterbox", 2),
        ((2160, 3840), "bottom", 4),
        ((320, 1280), "stretch", 1),  # the rows are not reduced
        ((20_000, 20_000), "bottom", 8),
    ],
)
def test_images_are_reduced_by_what_loses_nothing(size: tuple[int, int], fit: str, reduction: int) -> None:
    preprocess = Preprocess((320, 640), fit)
    assert preprocess.reduction(size) == reduction
    scale = np.diag(preprocess.matrix(size))[:2].max()
    assert scale * reduction <= 1 + 1e-6


def test_an_image_of_the_right_size_passes_unchanged() -> None:
    image = np.random.default_rng(0).integers(0, 256, (64, 128, 3), dtype=np.uint8)
    for fit in FITS:
        fitted, to_image = Preprocess((64, 128), fit)(image)
        np.testing.assert_array_equal(fitted, image)
        np.testing.assert_array_equal(to_image, np.eye(3))


def test_what_the_image_does_not_cover_is_gray() -> None:
    white = np.full((100, 400, 3), 255, np.uint8)
    bottom, _ = Preprocess((64, 128), "bottom")(white)
    assert (bottom[:32] == FILL).all()
    assert (bottom[32:] == 255).all()
    letterbox, _ = Preprocess((64, 128), "letterbox")(white)
    assert (letterbox[:16] == FILL).all()
    assert (letterbox[16:48] == 255).all()
    assert (letterbox[48:] == FILL).all()


def test_gray_images_are_accepted() -> None:
    gray = smooth_image(72, 128)[:, :, 0]
    fitted, _ = Preprocess((64, 128))(gray)
    np.testing.assert_array_equal(fitted, np.repeat(gray[8:, :, None], 3, axis=2))


@pytest.mark.parametrize("size", [(64, 128), (720, 1280), (590, 1640), (100, 100)])
def test_views_give_what_their_copies_give(size: tuple[int, int]) -> None:
    image = np.random.default_rng(0).integers(0, 256, (*size, 3), dtype=np.uint8)
    for view in (image[:, :, ::-1], image[::-1], image[::2, ::3], image.transpose(1, 0, 2)):
        np.testing.assert_array_equal(Preprocess((64, 128))(view)[0], Preprocess((64, 128))(view.copy())[0])


def test_the_image_is_not_changed() -> None:
    image = smooth_image(64, 128)
    before = image.copy()
    fitted, _ = Preprocess((64, 128), "letterbox")(image[:, :100])
    fitted[:] = 0
    np.testing.assert_array_equal(image, before)


@given(height=st.integers(10, 300), width=st.integers(10, 300), fit=st.sampled_from(FITS))
def test_any_size_works(height: int, width: int, fit: str) -> None:
    image = np.full((height, width, 3), 200, np.uint8)
    fitted, to_image = Preprocess((32, 64), fit)(image)
    assert fitted.shape == (32, 64, 3)
    assert set(np.unique(fitted)) <= {200, FILL}
    assert (fitted == 200).any()
    assert np.isfinite(to_image).all()


@pytest.mark.parametrize("size", [(20_000, 30), (30, 20_000), (1, 40_000), (40_000, 1), (1, 1)])
@pytest.mark.parametrize("fit", FITS)
def test_very_long_images_work(size: tuple[int, int], fit: str) -> None:
    fitted, to_image = Preprocess((64, 128), fit)(np.full((*size, 3), 200, np.uint8))
    assert fitted.shape == (64, 128, 3)
    assert set(np.unique(fitted)) <= {200, FILL}
    assert np.isfinite(to_image).all()


def test_shrinking_does_not_alias() -> None:
    stripes = np.zeros((1181, 3280, 3), np.uint8)
    stripes[:, ::2] = 200
    fitted, _ = Preprocess((320, 640), "letterbox")(stripes)
    inner = fitted[60:-60, 5:-5].astype(float)
    assert abs(inner.mean() - 100) < 1
    assert inner.std() < 25  # a linear warp without reduction has 50 and more


def test_sub_pixel_bands_keep_their_place() -> None:
    """A bright row of a 1640x590 image is found where the matrix says, to a fifth of a pixel."""
    image = np.zeros((590, 1640, 3), np.uint8)
    image[293:303] = 255
    preprocess = Preprocess((320, 640), "bottom")
    fitted, _ = preprocess(image)
    weights = fitted[:, 320, 0].astype(float)
    weights[: int(preprocess.matrix((590, 1640))[1, 2]) + 2] = 0
    center = (weights * (np.arange(320) + 0.5)).sum() / weights.sum()
    wanted = transform_points(np.array([[0.0, 298.0]]), preprocess.matrix((590, 1640)))[0, 1]
    assert abs(center - wanted) < 0.2


def test_wrong_arguments_are_refused() -> None:
    with pytest.raises(ValueError, match="fit is 'top'"):
        Preprocess((32, 64), "top")
    with pytest.raises(ValueError, match="positive"):
        Preprocess((0, 64))
    with pytest.raises(ValueError, match="float64"):
        Preprocess((32, 64))(np.zeros((3, 3, 3)))


def test_resize_and_warp_agree_with_opencv_on_a_real_matrix() -> None:
    image = smooth_image(720, 1280)
    fitted, _ = Preprocess((320, 640))(image)
    matrix = fit_matrix((720, 1280), (320, 640), "bottom")[:2]
    matrix[:, 2] += matrix[:, :2] @ (0.5, 0.5) - 0.5
    warped = cv2.warpAffine(image, matrix, (640, 320), flags=cv2.INTER_LINEAR)
    assert np.abs(fitted[1:-1, 1:-1].astype(int) - warped[1:-1, 1:-1]).max() <= 1
