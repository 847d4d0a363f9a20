from __future__ import annotations

import numpy as np

from yolino.types import Polylines
from yolino.viz.density import fitting_widths, line_density

CANVAS = np.zeros((1800, 1800, 3), np.uint8)


def lanes(count: int, apart: float, top: float = 900.0, first: int = 0) -> Polylines:
    lines = [[[300.0, top + i * apart], [1500.0, top + i * apart]] for i in range(count)]
    return Polylines.from_list(lines, labels=range(first, first + count))


def test_the_density_is_length_per_area() -> None:
    """Surroundings have 1800 / 32 px: a line alone has 56.25 px on 56.25 px squared."""
    np.testing.assert_allclose(line_density(CANVAS, lanes(1, 0.0)), [32 / 1800], rtol=0.03)
    np.testing.assert_allclose(line_density(CANVAS, lanes(3, 0.0)), [3 * 32 / 1800] * 3, rtol=0.03)
    np.testing.assert_allclose(line_density(CANVAS, lanes(2, 500.0)), [32 / 1800] * 2, rtol=0.03)


def test_lines_in_a_crowd_are_thinner_and_others_are_not() -> None:
    crowd, alone = lanes(10, 5.0), lanes(1, 0.0, top=200.0, first=10)
    lines = Polylines(
        np.concatenate([crowd.vertices, alone.vertices]), np.arange(0, 23, 2), None, np.arange(11)
    )
    widths = fitting_widths(CANVAS, lines, "auto")
    assert widths.tolist() == [2] * 10 + [6]
    assert fitting_widths(CANVAS, lines, 6).tolist() == [6] * 11
    assert fitting_widths(CANVAS, lanes(2, 500.0), "auto").tolist() == [6, 6]


def test_parts_of_one_line_have_one_thickness() -> None:
    parts = [*lanes(8, 5.0), [[300.0, 200.0], [400.0, 200.0]]]
    lines = Polylines.from_list(parts, labels=[*range(8), 7])
    widths = fitting_widths(CANVAS, lines, "auto")
    assert widths[7] == widths[8] < 6


def test_no_lines_have_no_widths() -> None:
    assert fitting_widths(CANVAS, Polylines.from_list([]), "auto").shape == (0,)
    points = Polylines.from_list([[[5.0, 5.0]], [[9.0, 9.0], [9.0, 9.0]]], labels=[0, 1])
    assert fitting_widths(CANVAS, points, "auto").tolist() == [6, 6]
