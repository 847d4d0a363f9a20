from __future__ import annotations

import dataclasses
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

import yolino
from yolino.header import Header
from yolino.inference import OnnxEngine, Predictor, load
from yolino.inference.loading import model_path
from yolino.inference.postprocessing import build_linker, build_nms
from yolino.types import Output, Polylines, Segments


class FakeEngine:
    """Says what it was told to say, about every image."""

    name, device, precision, streams = "fake", "cpu", "fp32", 1

    def __init__(self, header: Header, output: Output) -> None:
        self.header, self.output, self.batches = header, output, []

    def __call__(self, batch: np.ndarray, /) -> Output:
        self.batches.append(len(batch))
        return Output(
            *(None if part is None else np.repeat(part, len(batch), axis=0) for part in self.output)
        )


def identity(segments: Segments) -> Segments:
    return segments


def one_by_one(segments: Segments) -> Polylines:
    return Polylines.from_list(list(segments.endpoints), segments.scores, segments.labels)


def fake(header: Header, *, scores: list[float], **options: object) -> Predictor:
    n = len(scores)
    endpoints = np.arange(4 * n, dtype=np.float32).reshape(1, n, 2, 2)
    engine = FakeEngine(header, Output(endpoints, np.array([scores], np.float32), None))
    return Predictor(engine, nms=identity, linker=one_by_one, **options)


def test_two_lines_are_found_where_they_are(tiny_model: Path) -> None:
    """The network sees x = 40 and 88 in 64x128; of 256x256 it gets the lower half, halved."""
    polylines = load(tiny_model)(np.full((256, 256, 3), 255, np.uint8))
    assert len(polylines) == 2
    for line, x in zip(sorted(polylines, key=lambda line: line[0, 0]), (80, 176), strict=True):
        np.testing.assert_allclose(line[:, 0], x, atol=1.0)
        assert line[0, 1] == pytest.approx(256, abs=8)
        assert line[-1, 1] == pytest.approx(128, abs=8)
    np.testing.assert_allclose(polylines.scores, 0.9, rtol=1e-6)


def test_a_black_image_has_no_lines(tiny_model: Path) -> None:
    predictor = load(tiny_model)
    black = np.zeros((64, 128, 3), np.uint8)
    assert len(predictor(black)) == 0
    assert len(predictor.segments(black)) == 0
    assert all(len(stage) == 0 for stage in predictor.stages(black))


def test_gray_images_work(tiny_model: Path) -> None:
    assert len(load(tiny_model)(np.full((64, 128), 255, np.uint8))) == 2


def test_a_list_gives_a_list_in_its_order_whatever_the_sizes(tiny_model: Path) -> None:
    predictor = load(tiny_model)
    sizes = [(64, 128), (720, 1280), (64, 128), (33, 77), (100, 100), (64, 128)]
    images = [np.full((*size, 3), 255 * (i != 2), np.uint8) for i, size in enumerate(sizes)]
    together = predictor(images)
    assert isinstance(together, list)
    assert [len(lines) for lines in together] == [2, 2, 0, 2, 2, 2]
    for image, lines in zip(images, together, strict=True):
        np.testing.assert_allclose(predictor(image).vertices, lines.vertices)
    assert predictor([]) == []
    assert len(predictor(np.stack([images[0], images[5]]))) == 2


def test_images_run_in_batches(header: Header) -> None:
    predictor = fake(header, scores=[0.9], batch_size=2)
    predictor([np.zeros((64, 128, 3), np.uint8)] * 5)
    assert predictor.engine.batches == [2, 2, 1]


def test_the_threshold_is_inclusive_and_comes_from_the_header(header: Header) -> None:
    image, scores = np.zeros((64, 128, 3), np.uint8), [0.25, 0.5, 0.75]
    assert len(fake(header, scores=scores).segments(image)) == 2
    assert len(fake(header, scores=scores, threshold=0.75).segments(image)) == 1
    assert len(fake(header, scores=scores, threshold=0.0).segments(image)) == 3
    other = dataclasses.replace(header, postprocess={"threshold": 0.6})
    assert len(fake(other, scores=scores).segments(image)) == 1


@pytest.mark.parametrize("threshold", [-0.1, 1.1, float("nan")])
def test_an_impossible_threshold_is_refused(header: Header, threshold: float) -> None:
    with pytest.raises(ValueError, match="a score is between 0 and 1"):
        fake(header, scores=[0.5], threshold=threshold)


def test_an_empty_batch_size_is_refused(header: Header) -> None:
    with pytest.raises(ValueError, match="batch_size is 0"):
        fake(header, scores=[0.5], batch_size=0)


def test_segments_are_mapped_back_into_the_image(header: Header) -> None:
    """720x1280 into 64x128: the top 80 rows go, the rest becomes a tenth; (0, 1) is (0, 10 + 80) before."""
    segments = fake(header, scores=[0.9, 0.8]).segments(np.zeros((720, 1280, 3), np.uint8))
    np.testing.assert_allclose(segments.endpoints[0], [[0, 90], [20, 110]])
    np.testing.assert_allclose(segments.endpoints[1], [[40, 130], [60, 150]])
    np.testing.assert_allclose(segments.scores, [0.9, 0.8], rtol=1e-6)


def test_labels_and_probabilities_are_the_networks(class_model: Path) -> None:
    predictor = load(class_model)
    image = np.full((64, 128, 3), 255, np.uint8)
    candidates, segments, polylines = predictor.stages(image)
    assert candidates.probabilities is not None
    for stage in (candidates, segments, polylines):
        assert (stage.labels == 1).all()
        assert len(stage)


def test_stages_agree_with_the_call(tiny_model: Path) -> None:
    predictor = load(tiny_model)
    image = np.full((72, 128, 3), 255, np.uint8)
    stages = predictor.stages(image)
    np.testing.assert_allclose(stages.polylines.vertices, predictor(image).vertices)
    np.testing.assert_allclose(stages.candidates.endpoints, predictor.segments(image).endpoints)


def test_a_network_that_gives_nan_is_refused(header: Header) -> None:
    predictor = fake(header, scores=[0.9])
    predictor.engine.output.endpoints[:] = np.nan
    with pytest.raises(ValueError, match="not finite"):
        predictor(np.zeros((64, 128, 3), np.uint8))


def test_a_wrong_array_is_refused(tiny_model: Path) -> None:
    with pytest.raises(ValueError, match="float64"):
        load(tiny_model)(np.zeros((64, 128, 3)))


def test_an_unknown_model_is_refused_with_what_is_allowed() -> None:
    with pytest.raises(
        ValueError, match=r"'defualt' is unknown: give .*the path of a file in \.onnx, \.xml or \.safeten"
    ):
        load("defualt")


def test_a_missing_model_file_is_told(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"none\.onnx does not exist"):
        load(tmp_path / "none.onnx")


def test_a_file_of_another_kind_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "photo.jpg"
    path.touch()
    with pytest.raises(ValueError, match=r"suffix '\.jpg'; known model files end in"):
        load(path)


def test_the_packaged_model_has_a_path_and_a_header() -> None:
    try:
        path = model_path("default")
    except ValueError:
        pytest.skip("no default model is packaged in this checkout")
    assert OnnxEngine(path).header.size[0] > 0


@pytest.mark.parametrize(
    ("postprocess", "message"),
    [
        ({"linker": "magic"}, r"linker 'magic' is unknown; known are .*chain.*yolino\.load\(model, linker"),
        ({"linker": "os:system"}, "is unknown"),
        ({"linker_options": {"colour": 1}}, "linker_options do not fit the linker 'graph'.*colour"),
        ({"nms": {"epsilom": 1}}, "nms does not fit NMS.*epsilom"),
    ],
)
def test_a_header_that_cannot_be_followed_is_refused(
    header: Header, tiny_model: Path, postprocess: dict[str, object], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        Predictor(OnnxEngine(tiny_model), dataclasses.replace(header, postprocess=postprocess))


def test_post_processing_follows_the_header(header: Header) -> None:
    """Two opposite segments in one place are one line where direction means nothing."""
    pair = Segments(np.array([[[40.0, 32.0], [40, 16]], [[40, 16], [40, 32]]]), [0.9, 0.8])
    assert len(build_nms(header)(pair)) == 2
    assert len(build_nms(dataclasses.replace(header, directed=False))(pair)) == 1
    assert isinstance(build_linker(header)(pair), Polylines)


def test_warming_up_changes_nothing(tiny_model: Path) -> None:
    predictor = load(tiny_model)
    predictor.warm_up()
    assert len(predictor(np.full((64, 128, 3), 255, np.uint8))) == 2


def test_the_package_offers_what_one_needs(tiny_model: Path) -> None:
    assert len(yolino.load(tiny_model)(np.full((64, 128, 3), 255, np.uint8))) == 2
    assert yolino.Polylines is Polylines
    assert yolino.Predictor is Predictor
    assert yolino.__version__
    assert set(yolino.__all__) <= set(dir(yolino))
    with pytest.raises(AttributeError, match="no attribute 'lode'"):
        yolino.lode  # noqa: B018


def test_importing_and_predicting_loads_no_torch(tiny_model: Path) -> None:
    code = (
        "import sys, yolino; assert 'numpy' not in sys.modules;"
        f"import numpy as np; yolino.load({str(tiny_model)!r})(np.full((64, 128, 3), 255, np.uint8));"
        "assert not {'torch', 'torchvision', 'sklearn', 'onnx', 'lightning'} & set(sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_large_batch_is_linked_in_threads_with_the_results_of_one_after_the_other(tiny_model) -> None:
    rng = np.random.default_rng(5)
    images = [rng.integers(0, 256, (90 + i, 128, 3), dtype=np.uint8) for i in range(11)]
    predictor, names = load(tiny_model), set[str]()
    predictor.batch_size, linker = len(images), predictor.linker
    expected = [predictor(image) for image in images]

    def watched(segments: Segments) -> Polylines:
        names.add(threading.current_thread().name)
        return linker(segments)

    predictor.linker = watched
    found = predictor(images)
    assert threading.main_thread().name not in names
    assert [len(lines) for lines in found] == [len(lines) for lines in expected]
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one.vertices, other.vertices, atol=1e-3)
