from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yolino.datasets.grouping import CONTAINERS, group_names

NAMES = ["anna/monday/images/1.jpg", "anna/tuesday/2.jpg", "images/3.jpg", "/4.jpg"]


@pytest.mark.parametrize(
    ("by", "groups"),
    [
        ("image", ["anna/monday/images/1.jpg", "anna/tuesday/2.jpg", "images/3.jpg", "4.jpg"]),
        ("folder", ["anna/monday/images", "anna/tuesday", "images", "."]),
        ("1", ["anna", "anna", "images", "."]),
        ("2", ["anna/monday", "anna/tuesday", "images", "."]),
        ("9", ["anna/monday/images", "anna/tuesday", "images", "."]),
        ("auto", ["anna/monday", "anna/tuesday", "images/3.jpg", "4.jpg"]),
        (r"regex:(\d)", ["1", "2", "3", "4"]),
        (r"regex:[a-z]+/|\d", ["anna/", "anna/", "images/", "4"]),
        (r"regex:^(an)?", ["an", "an", "", ""]),
    ],
)
def test_each_way_to_group(by, groups):
    assert group_names(NAMES, by) == groups


def test_folders_that_hold_anything_are_told_by_name_whatever_their_case():
    assert group_names(["drive/JPEGImages/1.jpg", "drive/Frames/rgb/2.jpg"]) == ["drive", "drive"]
    assert all(name == name.lower() for name in CONTAINERS)


@pytest.mark.parametrize("by", ["", "0", "-1", "1.5", "folders", "regex"])
def test_an_unknown_way_is_told(by):
    with pytest.raises(ValueError, match=f"The grouping {by!r} is unknown; use auto, image, folder"):
        group_names(NAMES, by)


def test_an_expression_that_does_not_fit_is_told():
    with pytest.raises(ValueError, match=r"is no regular expression: .*unterminated"):
        group_names(NAMES, "regex:(")
    with pytest.raises(ValueError, match=r"does not match images/3.jpg"):
        group_names(NAMES, "regex:(anna)")


parts = st.lists(st.sampled_from(["a", "b", "images"]), min_size=1, max_size=4)


@given(st.lists(parts, max_size=9), st.integers(1, 4))
def test_deeper_groups_lie_within_coarser_ones(names, depth):
    names = ["/".join(one) for one in names]
    coarse, fine = group_names(names, str(depth)), group_names(names, str(depth + 1))
    assert len(set(zip(fine, coarse, strict=True))) == len(set(fine))
