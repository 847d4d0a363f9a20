from __future__ import annotations

import numpy as np
import pytest

from yolino.image import as_rgb


def test_rgb_stays_the_same_array() -> None:
    image = np.zeros((2, 3, 3), np.uint8)
    assert as_rgb(image) is image


def test_gray_is_repeated() -> None:
    gray = np.arange(6, dtype=np.uint8).reshape(2, 3)
    rgb = as_rgb(gray)
    assert rgb.shape == (2, 3, 3)
    assert (rgb == gray[:, :, None]).all()


def test_what_is_no_array_is_refused_with_a_hint() -> None:
    with pytest.raises(ValueError, match=r"got str; read a file with yolino\.io\.read_image"):
        as_rgb("road.jpg")


@pytest.mark.parametrize(
    ("image", "hint"),
    [
        (np.zeros((2, 3, 4), np.uint8), r"image\[\.\.\., :3\]"),
        (np.zeros((2, 3, 1), np.uint8), r"\(2, 3, 1\)"),
        (np.zeros(3, np.uint8), r"\(3,\)"),
        (np.zeros((1, 2, 3, 3), np.uint8), r"\(1, 2, 3, 3\)"),
        (np.zeros((0, 3, 3), np.uint8), "empty"),
        (np.zeros((0, 3), np.uint8), "empty"),
        (np.zeros((2, 3, 3), np.float32), r"float32.*\* 255"),
        (np.zeros((2, 3, 3), np.bool_), r"bool.*\* 255"),
        (np.zeros((2, 3, 3), np.uint16), "uint16.*>> 8"),
        (np.zeros((2, 3, 3), np.int64), r"int64.*astype"),
    ],
)
def test_other_arrays_are_refused_with_a_hint(image: np.ndarray, hint: str) -> None:
    with pytest.raises(ValueError, match=hint):
        as_rgb(image)
