from __future__ import annotations

import colorsys
import itertools

import numpy as np
import pytest

from yolino.viz import FALSE_ALARM, HIT, MISS, PALETTE, direction_colors, palette, score_colors
from yolino.viz.colors import COLORS, DARKEST, OUTLINE, item_colors
from yolino.viz.colors import luminance as relative_luminance


def distances(colors: np.ndarray) -> np.ndarray:
    """Distance in CIELAB (D65), written out from its definition, of each pair of colors."""
    shares = colors / 255
    linear = np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    xyz = linear @ to_xyz.T / np.array([0.9505, 1.0, 1.0890])
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    places = np.stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], axis=1)
    pairs = np.linalg.norm(places[:, None] - places, axis=2)
    return pairs[np.triu_indices(len(colors), 1)]


def test_any_two_of_64_classes_can_be_told_apart() -> None:
    colors = palette(np.arange(64))
    np.testing.assert_array_equal(colors[: len(PALETTE)], PALETTE)
    for count in range(2, 65):
        np.testing.assert_array_equal(palette(np.arange(count)), colors[:count])
        assert distances(colors[:count]).min() > (30 if count <= 16 else 20)


def test_the_palette_repeats_after_256_different_colors() -> None:
    colors = palette(np.arange(2 * COLORS))
    assert len(np.unique(colors[:COLORS], axis=0)) == COLORS == 256
    np.testing.assert_array_equal(colors[:COLORS], colors[COLORS:])
    np.testing.assert_array_equal(palette(np.array([-1])), colors[-1:])


def luminance(color: tuple[int, int, int]) -> float:
    """Relative luminance as in WCAG 2."""
    linear = [c / 12.92 if c <= 0.03928 else ((c + 0.055) / 1.055) ** 2.4 for c in (v / 255 for v in color)]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("color", [(0, 0, 0), (255, 255, 255), (255, 0, 0), (10, 40, 200), (128, 128, 128)])
def test_luminance_is_that_of_wcag(color: tuple[int, int, int]) -> None:
    assert relative_luminance(np.array(color, np.uint8)) == pytest.approx(luminance(color), abs=1e-12)


ANGLES = np.linspace(0, 2 * np.pi, 721)
USED = {
    "palette": palette(np.arange(COLORS)),
    "directions": direction_colors(np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)),
    "scores": score_colors(np.linspace(0, 1, 101)),
}


@pytest.mark.parametrize("name", USED)
def test_every_color_of_a_line_or_its_outline_stands_out_from_any_background(name: str) -> None:
    lines, outline = relative_luminance(USED[name]) + 0.05, luminance(OUTLINE) + 0.05
    assert lines.min() / outline > 4
    backgrounds = np.linspace(0, 1, 101)[:, None] + 0.05
    to_line = np.maximum(lines / backgrounds, backgrounds / lines)
    to_outline = np.maximum(outline / backgrounds, backgrounds / outline)
    assert np.maximum(to_line, to_outline).min() > 2


@pytest.mark.parametrize("color", [*PALETTE, HIT, FALSE_ALARM, MISS])
def test_every_named_color_stands_out_from_the_outline(color: tuple[int, int, int]) -> None:
    assert (luminance(color) + 0.05) / (luminance(OUTLINE) + 0.05) > 3


def without_red_or_green(color: tuple[int, int, int], *, red: bool) -> np.ndarray:
    """How a dichromat sees a color (Viénot, Brettel and Mollon 1999), in linear RGB."""
    linear = (np.array(color) / 255) ** 2.2
    to_lms = np.array(
        [[17.8824, 43.5161, 4.11935], [3.45565, 27.1554, 3.86714], [0.0299566, 0.184309, 1.46709]]
    )
    lms = to_lms @ linear
    if red:
        lms[0] = 2.02344 * lms[1] - 2.52581 * lms[2]
    else:
        lms[1] = 0.494207 * lms[0] + 1.24827 * lms[2]
    return np.clip(np.linalg.inv(to_lms) @ lms, 0, 1) ** (1 / 2.2) * 255


@pytest.mark.parametrize("red", [True, False])
def test_the_first_colors_differ_for_the_color_blind(red: bool) -> None:
    for a, b in itertools.combinations(PALETTE[:4], 2):
        assert np.linalg.norm(without_red_or_green(a, red=red) - without_red_or_green(b, red=red)) > 40


def test_directions_are_the_hues_of_the_color_circle() -> None:
    """The hue is the angle; blue and violet are paler, to stand out."""
    angles = np.linspace(0, 2 * np.pi, 73)[:-1]
    colors = direction_colors(np.stack([np.cos(angles), np.sin(angles)], axis=1) * 7)
    for angle, color in zip(angles, colors, strict=True):
        wanted = np.array(colorsys.hsv_to_rgb(angle / (2 * np.pi), 0.85, 1.0)) * 255
        if luminance(tuple(wanted.tolist())) > DARKEST:
            np.testing.assert_allclose(color, wanted, atol=1)
        else:
            hue, _, value = colorsys.rgb_to_hsv(*(color / 255).tolist())
            assert abs(hue - angle / (2 * np.pi)) < 0.005
            assert value == 1
            assert luminance(tuple(color.tolist())) < DARKEST + 0.02


def test_undirected_lines_have_one_hue_both_ways() -> None:
    delta = np.random.default_rng(0).normal(size=(50, 2))
    forth, back = direction_colors(delta, directed=False), direction_colors(-delta, directed=False)
    assert np.abs(forth.astype(int) - back).max() <= 1
    assert np.abs(direction_colors(delta).astype(int) - direction_colors(-delta)).max(axis=1).min() > 100


def test_scores_become_brighter() -> None:
    colors = score_colors(np.linspace(-0.5, 1.5, 41))
    light = np.array([luminance(tuple(color)) for color in colors])
    assert (np.diff(light) >= -1e-3).all()
    assert light[-1] > light[0] + 0.5
    assert score_colors(np.zeros(0)).shape == (0, 3)


def test_items_are_colored_by_what_is_asked() -> None:
    labels, scores = np.array([3, 3, 0]), np.array([0.1, 0.5, 0.9])
    np.testing.assert_array_equal(item_colors("identity", labels, scores), PALETTE[:3])
    np.testing.assert_array_equal(item_colors("label", labels, scores), [PALETTE[3], PALETTE[3], PALETTE[0]])
    np.testing.assert_array_equal(item_colors("score", labels, scores), score_colors(scores))
    with pytest.raises(
        ValueError, match="color_by is 'length', but must be 'identity', 'label', 'direction' or"
    ):
        item_colors("length", labels, scores)
