"""The network also sees the mirrored image."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from striped_model import make_striped_model, striped_header
from yolino.header import Header
from yolino.inference import OnnxEngine, Predictor, load
from yolino.inference.flips import mirror_segments, with_mirrors
from yolino.types import Output, Segments

WIDTH = 128


def flipped(predictor: Predictor) -> Predictor:
    header = predictor.header
    return Predictor(predictor.engine, replace(header, postprocess={**header.postprocess, "flip": True}))


@pytest.fixture(scope="module")
def striped(tmp_path_factory: pytest.TempPathFactory) -> Predictor:
    """A model that finds bright lines where they are, in images of its own size."""
    pytest.importorskip("onnx", reason="onnx builds the model of this test")
    header = replace(striped_header(classes=("steep", "flat")), fit="stretch")
    return Predictor(OnnxEngine(make_striped_model(tmp_path_factory.mktemp("striped") / "a.onnx", header)))


@pytest.fixture
def photo() -> np.ndarray:
    image = np.zeros((128, WIDTH, 3), np.uint8)
    image[8:12, 4:100] = image[30:120, 20:24] = 255
    return image


def test_a_mirror_exchanges_left_and_right_alone() -> None:
    one = Segments([[[1.0, 60.0], [10.0, 4.0]]], [0.4], probabilities=[[0.25, 0.75]])
    seen = mirror_segments(one, 128)
    assert seen.endpoints.tolist() == [[[127.0, 60.0], [118.0, 4.0]]]
    assert seen.scores.tolist() == [0.4]
    assert seen.probabilities is not None
    assert seen.probabilities.tolist() == [[0.25, 0.75]]
    assert one.endpoints[0, 0, 0] == 1.0


@given(row=st.integers(0, 4), column=st.integers(0, 6))
def test_the_center_of_a_pixel_comes_back(row: int, column: int) -> None:
    images = np.zeros((2, 5, 7, 3), np.uint8)
    images[1, row, column] = 255
    ((which, y, x),) = np.argwhere(with_mirrors(images)[2:, ..., 0])
    assert which == 1
    mirrored = Segments([[[x + 0.5, y + 0.5], [0.0, 0.0]]])
    assert mirror_segments(mirrored, 7).endpoints[0].tolist() == [[column + 0.5, row + 0.5], [7.0, 0.0]]


def test_lines_of_the_mirror_image_come_back_mirrored(
    make_model: Callable[..., Path], tmp_path: Path, tiny_endpoints: np.ndarray
) -> None:
    """The model answers alike whatever it sees: what it says of the mirror image lies at 128 - 40 = 88."""
    predictor = load(make_model(tmp_path / "one.onnx", endpoints=tiny_endpoints[:4]))
    bright = np.full((64, WIDTH, 3), 200, np.uint8)
    found = flipped(predictor).segments(bright)
    assert found.midpoints[:, 0].tolist() == [40.0] * 4 + [88.0] * 4
    assert (found.endpoints[:, 0, 1] > found.endpoints[:, 1, 1]).all()
    assert len(predictor(bright)) == 1
    assert len(flipped(predictor)(bright)) == 2


def test_each_image_of_a_batch_gets_its_own_mirror_image(
    make_model: Callable[..., Path], tmp_path: Path, tiny_endpoints: np.ndarray
) -> None:
    predictor = flipped(load(make_model(tmp_path / "one.onnx", endpoints=tiny_endpoints[:4])))
    black, bright = np.zeros((64, WIDTH, 3), np.uint8), np.full((64, WIDTH, 3), 200, np.uint8)
    assert [len(lines) for lines in predictor([bright, black, bright])] == [2, 0, 2]


def test_both_views_find_every_line_at_its_place(striped: Predictor, photo: np.ndarray) -> None:
    once, both = striped.segments(photo), flipped(striped).segments(photo)
    assert len(both) == 2 * len(once)
    for middle in once.midpoints:
        assert (np.abs(both.midpoints - middle).max(axis=1) < 0.01).sum() == 2
    assert both.probabilities is not None
    assert len(flipped(striped)(photo)) == len(striped(photo))


def test_a_mirrored_image_has_mirrored_lines(striped: Predictor, photo: np.ndarray) -> None:
    predictor = flipped(striped)
    here, there = predictor(photo), predictor(np.ascontiguousarray(photo[:, ::-1]))
    assert len(here) == len(there) == 2
    wanted = sorted(sorted({round(float(WIDTH - x), 1) for x in line[[0, -1], 0]}) for line in here)
    assert sorted(sorted({round(float(x), 1) for x in line[[0, -1], 0]}) for line in there) == wanted


def test_warming_up_sees_as_many_images_as_predicting(
    striped: Predictor, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[int] = []

    class Counting(OnnxEngine):
        def __call__(self, batch: np.ndarray, /) -> Output:
            seen.append(len(batch))
            return super().__call__(batch)

    predictor = flipped(striped)
    monkeypatch.setattr(predictor.engine, "__class__", Counting)
    predictor.warm_up()
    predictor(np.zeros((128, WIDTH, 3), np.uint8))
    assert seen == [2, 2]


def test_windows_are_not_mirrored(striped: Predictor) -> None:
    header = replace(striped.header, fit="window", postprocess={"flip": True})
    with pytest.raises(ValueError, match=r"\(rotations\) and nothing is mirrored: leave flip out"):
        Predictor(striped.engine, header)
    with pytest.raises(ValueError, match="nothing is mirrored"):
        Predictor(striped.engine, replace(header, postprocess={}), flip=True)
    assert not Predictor(striped.engine, header, flip=False).flip


def test_the_caller_decides_against_the_header(
    make_model: Callable[..., Path], tmp_path: Path, header: Header, tiny_endpoints: np.ndarray
) -> None:
    bright = np.full((64, WIDTH, 3), 200, np.uint8)
    for wanted in (False, True):
        said = replace(header, postprocess={**header.postprocess, "flip": wanted})
        path = make_model(tmp_path / f"{wanted}.onnx", header=said, endpoints=tiny_endpoints[:4])
        assert [len(load(path, flip=flip)(bright)) for flip in (None, False, True)] == [1 + wanted, 1, 2]


def test_the_header_says_true_or_false(header: Header) -> None:
    with pytest.raises(ValueError, match=r"postprocess\.flip is 1, but must be true or false"):
        replace(header, postprocess={"flip": 1})
    assert Header.from_json(replace(header, postprocess={"flip": True}).to_json()).postprocess == {
        "flip": True
    }
