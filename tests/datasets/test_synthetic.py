from __future__ import annotations

import pickle
import subprocess
import sys
import zlib

import numpy as np
import pytest

from yolino.datasets import DATASETS
from yolino.datasets.synthetic import SCENES, Synthetic
from yolino.types import Sample


def same(a: Sample, b: Sample) -> bool:
    return (
        a.name == b.name
        and np.array_equal(a.image, b.image)
        and np.array_equal(a.polylines.vertices, b.polylines.vertices)
        and np.array_equal(a.polylines.labels, b.polylines.labels)
    )


@pytest.mark.parametrize("kind", SCENES)
def test_a_sample_depends_on_seed_and_index_alone(kind: str) -> None:
    data = Synthetic(kind, 6, seed=3, size=(64, 128))
    forward = [data[i] for i in range(6)]
    other = Synthetic(kind, 100, seed=3, size=(64, 128))
    assert all(same(other[i], forward[i]) for i in (5, 2, 0, 3))
    assert same(pickle.loads(pickle.dumps(data))[4], forward[4])


@pytest.mark.parametrize("kind", SCENES)
def test_samples_differ_and_so_do_seeds(kind: str) -> None:
    data = Synthetic(kind, 3, seed=0, size=(64, 128))
    images = [data[0].image, data[1].image, Synthetic(kind, 3, seed=1, size=(64, 128))[0].image]
    assert len({np.asarray(image).tobytes() for image in images}) == 3
    assert data[0].name != data[1].name


def test_a_fresh_process_draws_the_same() -> None:
    code = (
        "import zlib\n"
        "from yolino.datasets.synthetic import Synthetic\n"
        "s = Synthetic('road', 9, 5, (48, 96))[7]\n"
        "print(zlib.crc32(s.image.tobytes()), s.polylines.vertices.sum())"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    sample = Synthetic("road", 9, 5, (48, 96))[7]
    assert isinstance(sample.image, np.ndarray)
    assert run.stdout.split() == [
        str(zlib.crc32(sample.image.tobytes())),
        str(sample.polylines.vertices.sum()),
    ]


@pytest.mark.parametrize("kind", SCENES)
@pytest.mark.parametrize("size", [(32, 32), (320, 640), (96, 300), (300, 96), (1, 1), (7, 400)])
def test_every_size_gives_an_image_and_polylines_inside_it(kind: str, size: tuple[int, int]) -> None:
    data = Synthetic(kind, 4, seed=2, size=size)
    for i in range(4):
        sample = data[i]
        assert isinstance(sample.image, np.ndarray)
        assert sample.image.shape == (*size, 3)
        assert sample.image.dtype == np.uint8
        vertices = sample.polylines.vertices
        assert np.isfinite(vertices).all()
        assert (vertices >= 0).all()
        assert (vertices <= (size[1], size[0])).all()
        assert ((sample.polylines.labels >= 0) & (sample.polylines.labels < len(data.classes))).all()
        assert (np.diff(sample.polylines.offsets) >= 2).all()


def test_the_dataset_is_a_sequence() -> None:
    data = Synthetic("shapes", 4, size=(32, 32))
    assert len(data) == 4
    assert same(data[-1], data[3])
    assert len(list(data)) == 4  # type: ignore[call-overload]
    with pytest.raises(IndexError, match="Sample 4"):
        data[4]


def test_it_is_registered_and_directed() -> None:
    assert DATASETS["synthetic"] is Synthetic
    assert Synthetic.directed
    assert len(Synthetic("road").classes) == 7


def test_classes_are_chosen_merged_and_left_out() -> None:
    """Colors are merged, and dots left out; the pictures stay the same."""
    names = {"continuous yellow": "line", "continuous white": "line", "dashed": "dash"}
    every = Synthetic("road", 12, size=(90, 160))
    chosen = Synthetic("road", 12, size=(90, 160), classes=names)
    assert chosen.classes == ("line", "dash")
    assert chosen.key != every.key
    seen = set()
    for one, other in zip(every, chosen, strict=True):  # type: ignore[call-overload]
        assert np.array_equal(one.image, other.image)
        kept = [i for i, label in enumerate(one.polylines.labels) if every.classes[label] in names]
        lines = one.polylines[np.array(kept, np.int64)]
        assert np.array_equal(other.polylines.vertices, lines.vertices)
        assert [chosen.classes[i] for i in other.polylines.labels] == [
            names[every.classes[i]] for i in lines.labels
        ]
        seen |= set(other.polylines.labels.tolist())
    assert seen == {0, 1}
    assert Synthetic("road", classes=["dashed", "unknown"]).classes == ("dashed", "unknown")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"kind": "moon"}, "kind is 'moon', but only road, shapes"),
        ({"length": 0}, "length is 0"),
        ({"seed": -1}, "seed -1"),
        ({"size": (0, 64)}, r"size is \(0, 64\)"),
        ({"classes": ["lane"]}, r"continuous yellow, .*, but there is none 'lane'"),
        ({"classes": {}}, "but none of them is chosen"),
    ],
)
def test_bad_arguments_are_named(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Synthetic(**arguments)  # type: ignore[arg-type]
