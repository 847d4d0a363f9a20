from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from yolino.evaluate.prior import find_prior, scaled
from yolino.types import Polylines, Sample


class Lines:
    """Samples with one upright line each, at the given parts of the width."""

    classes = ("line",)
    directed = True

    def __init__(self, *places: float, size: tuple[int, int] = (360, 640)) -> None:
        self.places, self.shape = places, size

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, index: int) -> Sample:
        x, (height, width) = self.places[index], self.shape
        line = Polylines.from_list([[[x * width, height], [x * width, height / 2]]])
        return Sample(f"{index}.png", Path(f"{index}.png"), line, (), self.shape)


def test_the_medoid_is_the_sample_that_fits_most_others() -> None:
    """Within 2 % of the width: 2 fits 1 and 3, all others fit one or none."""
    prior = find_prior(Lines(0.1, 0.485, 0.5, 0.515, 0.9))
    assert prior.name == "2.png"
    assert prior.f1 == pytest.approx(2 / 4)


def test_of_many_samples_evenly_chosen_ones_are_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("yolino.evaluate.prior.MOST", 3)
    seen: list[int] = []
    find_prior(Lines(*[0.5] * 11), progress=lambda indices: (seen.append(i) or i for i in indices))
    assert seen == [0, 1, 2]


def test_a_single_sample_is_its_own_medoid() -> None:
    assert find_prior(Lines(0.3)).f1 == 1


def test_the_size_of_the_images_does_not_matter() -> None:
    small, large = (find_prior(Lines(0.1, 0.5, 0.5, size=size)) for size in ((180, 320), (1080, 1920)))
    assert small.name == large.name
    assert small.size == (180, 320)


def test_lines_are_scaled_to_the_image() -> None:
    lines = scaled(Polylines.from_list([[[64.0, 36.0], [0.0, 18.0]]], labels=[2]), (36, 64), (720, 640))
    assert lines.vertices == pytest.approx(np.array([[640.0, 720.0], [0.0, 360.0]]))
    assert lines.labels.tolist() == [0]


def test_labels_without_samples_are_told() -> None:
    with pytest.raises(ValueError, match="the dataset has no samples: check --prior"):
        find_prior(Lines())


def test_labels_without_lines_are_told() -> None:
    class Empty(Lines):
        def __getitem__(self, index: int) -> Sample:
            return Sample(f"{index}.png", Path(f"{index}.png"), Polylines.from_list([]), (), self.shape)

    with pytest.raises(ValueError, match="no sample has a line: check --prior"):
        find_prior(Empty(0.1, 0.2))
