from __future__ import annotations

from collections import Counter
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from yolino.datasets.convert import convert
from yolino.datasets.description import Description, load_description, open_split
from yolino.datasets.grouping import group_names
from yolino.datasets.registry import WRITERS
from yolino.datasets.split import choose_level, split, write_splits
from yolino.types import Polylines, Sample


def names_of(sizes: dict[str, int]) -> list[str]:
    return [f"{folder}/{i}.jpg" for folder, size in sizes.items() for i in range(size)]


def test_whole_groups_meet_the_shares():
    names = names_of({"a": 5, "b": 3, "c": 1, "d": 1})
    found = split(names, {"train": 0.5, "val": 0.3, "test": 0.2}, "folder")
    assert {one: Counter(group_names(found[one], "folder")) for one in found} == {
        "train": {"a": 5},
        "val": {"b": 3},
        "test": {"c": 1, "d": 1},
    }
    assert found["train"] == names[:5]


def test_shares_are_relative_and_no_split_stays_empty():
    names = names_of({"a": 97, "b": 2, "c": 1})
    assert split(names, {"x": 4, "y": 1}, "folder") == split(names, {"x": 0.8, "y": 0.2}, "folder")
    found = split(names, {"train": 98, "val": 1, "test": 1}, "folder")
    assert sorted(map(len, found.values())) == [1, 2, 97]


def test_the_seed_decides_among_equal_groups_and_nothing_else_does():
    names = [f"{i}.jpg" for i in range(50)]
    shares = {"train": 0.8, "val": 0.2}
    first = split(names, shares, "image", 0)
    assert first == split(names, shares, "image", 0)
    assert first != split(names, shares, "image", 1)
    assert {one: len(some) for one, some in first.items()} == {"train": 40, "val": 10}
    turned = split(names[::-1], shares, "image", 0)
    assert {one: some[::-1] for one, some in turned.items()} == first


sizes = st.lists(st.integers(1, 9), min_size=2, max_size=6)
shares = st.lists(st.floats(0.05, 1), min_size=2, max_size=3)


@settings(max_examples=60, deadline=None)
@given(sizes, shares, st.integers(0, 99))
def test_nothing_leaks_nothing_is_lost_and_nobody_could_do_much_better(sizes, shares, seed):
    assume(len(sizes) >= len(shares))
    names = names_of({str(i): size for i, size in enumerate(sizes)})
    wanted = {f"s{i}": share for i, share in enumerate(shares)}
    found = split(names, wanted, "folder", seed)
    assert sorted(name for some in found.values() for name in some) == sorted(names)
    assert all(found.values())
    groups = [set(group_names(some, "folder")) for some in found.values()]
    assert sum(map(len, groups)) == len(set().union(*groups))
    targets = np.array(shares) / sum(shares) * len(names)

    def error(reached) -> float:
        return float(np.abs(np.array(reached) - targets).max())

    best = min(
        error(np.bincount(choice, sizes, len(shares)))
        for choice in product(range(len(shares)), repeat=len(sizes))
        if len(set(choice)) == len(shares)
    )
    assert error([len(some) for some in found.values()]) <= best + max(sizes)


@pytest.mark.parametrize(
    ("names", "level"),
    [
        (names_of({"a": 8, "b": 2}), "1"),
        (names_of({"d/a": 8, "d/b": 2}), "2"),  # one folder at the root
        (names_of({"d/a": 6, "d/b": 2, "e": 2}), "1"),
        (names_of({"a/x": 5, "a/y": 4, "b/z": 95, "b/w": 20}), "2"),  # 9 of 124 are 13 points too few
        (names_of({"images": 10}), "image"),
        (names_of({"a": 5, "b": 5}), "image"),  # half is 30 points off
        (["1.jpg", "2.jpg", "3.jpg"], "image"),
    ],
)
def test_the_coarsest_folders_that_allow_the_shares_are_chosen(names, level):
    assert choose_level(names, {"train": 0.8, "val": 0.2}) == level


def test_auto_is_the_level_that_is_chosen():
    names = names_of({"d/a": 8, "d/b": 2})
    assert split(names, {"train": 0.8, "val": 0.2}) == {"train": names[:8], "val": names[8:]}


@pytest.mark.parametrize(
    ("names", "shares", "by", "message"),
    [
        ([], {"a": 1}, "image", "no images"),
        (["1.jpg", "1.jpg"], {"a": 1}, "image", "several images of the name 1.jpg"),
        (["1.jpg"], {}, "image", "got none"),
        (["1.jpg"], {"a": 0}, "image", "got a=0"),
        (["1.jpg"], {"a": -1, "b": 2}, "image", "got a=-1"),
        (["1.jpg"], {"a": float("nan")}, "image", "got a=nan"),
        (["1.jpg", "2.jpg"], {"a": 1, "b": 1}, "folder", "1 groups of images by 'folder' for 2 splits"),
        (["1.jpg"], {"a": 1, "b": 1}, "auto", "1 groups of images by 'image' for 2 splits"),
        (["1.jpg"], {"a": 1}, "clip", "grouping 'clip' is unknown"),
    ],
)
def test_mistakes_are_told(names, shares, by, message):
    with pytest.raises(ValueError, match=message):
        split(names, shares, by)


class Drives:
    """Images of two drives with the same file names, one polyline each."""

    classes = ("line",)
    directed = True

    def __len__(self) -> int:
        return 6

    def __getitem__(self, index: int, /) -> Sample:
        name = f"{'ab'[index // 3]}/{index % 3}"
        x = 10.0 * index + 5
        return Sample(name, np.full((64, 128, 3), index, np.uint8), Polylines.from_list([[[x, 5], [x, 60]]]))


@pytest.mark.parametrize("format", WRITERS)
def test_the_lists_choose_the_images_of_every_format(format: str, tmp_path: Path):
    root = tmp_path / "data"
    convert(Drives(), format, root)
    description = load_description(root)
    every = open_split(description)
    names = [every[i].name for i in range(len(every))]
    wanted = split(names, {"train": 0.5, "val": 0.5}, seed=1)
    file = write_splits(tmp_path / "lists", description, wanted)
    written = load_description(file)
    assert {name: len(some) for name, some in wanted.items()} == {"train": 3, "val": 3}
    for one, some in wanted.items():
        opened = open_split(written, one)
        assert [opened[i].name for i in range(len(opened))] == some
        assert all(opened[i].image.is_file() for i in range(len(opened)))


def test_the_description_stays_what_it_was_but_for_its_splits(tmp_path: Path):
    (tmp_path / "data").mkdir()
    description = Description(
        format="cvat",
        root=tmp_path / "data",
        splits={"old": "old.txt", "val": "val.txt"},
        classes={"b": "line"},
        ignore=("nothing",),
        licence="ours",
        options={"images": "pictures"},
    )
    file = write_splits(tmp_path / "data" / "lists", description, {"train": ["a 1.jpg"], "val": ["b.jpg"]})
    assert yaml.safe_load(file.read_text()) == {
        "format": "cvat",
        "root": "..",
        "splits": {"old": "old.txt", "val": "lists/val.txt", "train": "lists/train.txt"},
        "classes": {"b": "line"},
        "ignore": ["nothing"],
        "licence": "ours",
        "options": {"images": "pictures"},
    }
    assert (tmp_path / "data/lists/train.txt").read_text() == "a 1.jpg\n"


def test_the_root_is_found_through_a_link(tmp_path: Path):
    (tmp_path / "disk/far/data").mkdir(parents=True)
    (tmp_path / "data").symlink_to(tmp_path / "disk/far/data")
    (tmp_path / "lists").mkdir()
    file = write_splits(
        tmp_path / "lists", Description(format="cvat", root=tmp_path / "data"), {"a": ["1.jpg"]}
    )
    written = load_description(file)
    assert written.root.resolve() == (tmp_path / "disk/far/data").resolve()
    assert (written.root / str(written.splits["a"])).read_text() == "1.jpg\n"


def test_nothing_is_overwritten_unless_that_is_wanted(tmp_path: Path):
    description = Description(format="cvat", root=tmp_path)
    (tmp_path / "val.txt").write_text("mine")
    for _ in range(2):
        with pytest.raises(FileExistsError, match=r"val.txt is there already"):
            write_splits(tmp_path, description, {"train": ["1.jpg"], "val": ["2.jpg"]})
    assert sorted(path.name for path in tmp_path.iterdir()) == ["val.txt"]
    write_splits(tmp_path, description, {"train": ["1.jpg"], "val": ["2.jpg"]}, force=True)
    assert (tmp_path / "val.txt").read_text() == "2.jpg\n"


@pytest.mark.parametrize("name", ["", "../up", "a/b", ".hidden", "a b"])
def test_splits_need_names_for_files(name, tmp_path: Path):
    with pytest.raises(ValueError, match="no name of a split"):
        write_splits(tmp_path, Description(format="cvat", root=tmp_path), {name: ["1.jpg"]})


@pytest.mark.parametrize("name", ["a b", "a.jpg b.jpg", " a.jpg", "a\nb.jpg"])
def test_names_that_a_list_cannot_hold_are_told(name, tmp_path: Path):
    with pytest.raises(ValueError, match="cannot hold the name"):
        write_splits(tmp_path, Description(format="cvat", root=tmp_path), {"train": ["1.jpg", name]})
    assert list(tmp_path.iterdir()) == []
