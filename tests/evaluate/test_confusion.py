"""The picture of confusion matrices is valid, complete, and inside its frame."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import pytest

from yolino.evaluate import draw_confusion

SVG = "{http://www.w3.org/2000/svg}"


def texts(picture: str) -> list[str]:
    return [each.text or "" for each in ET.fromstring(picture).iter(f"{SVG}text")]


def fills(picture: str) -> list[str]:
    """Colors of the cells, row by row."""
    return [each.get("fill", "") for each in ET.fromstring(picture).iter(f"{SVG}rect") if each.get("x")][:-1]


def test_numbers_shares_and_names_are_in_the_picture() -> None:
    found = texts(draw_confusion(("dashed", "a <b> & c"), {"Lines": [[3, 1], [0, 1234]]}))
    assert found.count("dashed") == found.count("a <b> & c") == 2  # of a row and of a column
    assert {"Lines", "3", "75 %", "1", "25 %", "1,234", "100 %"} <= set(found)
    assert "0" not in found


def test_a_share_that_rounds_to_nothing_is_not_called_nothing() -> None:
    assert "<1 %" in texts(draw_confusion(("a", "b"), {"": [[999, 1], [0, 1]]}))


def test_right_is_green_wrong_is_red_and_what_was_not_found_gray() -> None:
    all_right, none, wrong, right = fills(draw_confusion(("a", "b"), {"": [[5, 0], [2, 2]]}))
    assert none == "rgb(255, 255, 255)"
    assert all_right == "rgb(0, 125, 84)"
    red, green, _ = map(int, wrong[4:-1].split(","))
    assert red > green
    red, green, _ = map(int, right[4:-1].split(","))
    assert green > red
    assert set(fills(draw_confusion(("a", "b"), {"": [[0, 0], [0, 0]]}))) == {"rgb(240, 240, 240)"}


@pytest.mark.parametrize("classes", [("a",), ("way", "link"), ("double continuous yellow",) * 7])
def test_matrices_stand_beside_each_other_in_the_frame(classes: tuple[str, ...]) -> None:
    n = len(classes)
    matrix = [[1] * n for _ in range(n)]
    root = ET.fromstring(draw_confusion(classes, {"one": matrix, "two": matrix}))
    width, height = float(root.get("width", 0)), float(root.get("height", 0))
    left = 0.0
    for group in root.iter(f"{SVG}g"):
        shift = float(group.get("transform", "").split("(")[1].split()[0])
        assert shift >= left
        for box in group.iter(f"{SVG}rect"):
            right = shift + float(box.get("x", 0)) + float(box.get("width", 0))
            assert right <= width
            assert float(box.get("y", 0)) + float(box.get("height", 0)) <= height
            left = max(left, right)
