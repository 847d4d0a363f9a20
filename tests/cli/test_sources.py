from __future__ import annotations

from pathlib import Path

import pytest

from yolino.cli.sources import find_images, result_names


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    names = [
        "a.jpg",
        "b.PNG",
        "notes.txt",
        ".hidden.jpg",
        "sub/a.jpg",
        "sub/deep/c.jpeg",
        ".git/x.png",
        "out/a.png",
    ]
    for name in names:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    return tmp_path


def found(tree: Path, *sources: str, out: str = "out") -> list[str]:
    images, problems = find_images([str(tree / source) for source in sources], excluded=tree / out)
    assert problems == []
    return [path.relative_to(tree).as_posix() for path in images]


def test_a_folder_is_all_images_below_it_but_hidden_ones_and_earlier_results(tree: Path) -> None:
    assert found(tree, "") == ["a.jpg", "b.PNG", "sub/a.jpg", "sub/deep/c.jpeg"]
    assert found(tree, "", out="other") == ["a.jpg", "b.PNG", "out/a.png", "sub/a.jpg", "sub/deep/c.jpeg"]


def test_results_can_be_named_as_a_source(tree: Path) -> None:
    assert found(tree, "out") == ["out/a.png"]


def test_files_are_taken_as_they_are(tree: Path) -> None:
    assert found(tree, "notes.txt", "missing.jpg") == ["notes.txt", "missing.jpg"]


def test_globs_are_expanded(tree: Path) -> None:
    assert found(tree, "*.jpg") == ["a.jpg"]
    assert found(tree, "**/*.jp*g") == ["a.jpg", "sub/a.jpg", "sub/deep/c.jpeg"]
    assert found(tree, "s*") == ["sub/a.jpg", "sub/deep/c.jpeg"]
    assert found(tree, "[ab].*") == ["a.jpg", "b.PNG"]


def test_a_file_whose_name_looks_like_a_glob_is_a_file(tree: Path) -> None:
    (tree / "x[1].jpg").touch()
    assert found(tree, "x[1].jpg") == ["x[1].jpg"]


def test_each_image_is_taken_once(tree: Path) -> None:
    assert found(tree, "sub", "sub/a.jpg", "sub/../sub/a.jpg", "*/a.jpg") == ["sub/a.jpg", "sub/deep/c.jpeg"]


def test_sources_without_images_are_told(tree: Path) -> None:
    (tree / "empty").mkdir()
    images, problems = find_images(
        [str(tree / "empty"), str(tree / "*.bmp"), str(tree / "a.jpg")], excluded=tree
    )
    assert [path.name for path in images] == ["a.jpg"]
    assert len(problems) == 2
    assert "folder" in problems[0]
    assert "empty names no image" in problems[0]
    assert "pattern" in problems[1]
    assert "*.bmp names no image" in problems[1]


def names(*paths: str) -> list[str]:
    return result_names([Path("/data") / path for path in paths])


def test_results_have_the_stem_of_their_image() -> None:
    assert names("a/x.jpg", "b/y.png", "z.1.jpg") == ["x", "y", "z.1"]
    assert names() == []


def test_images_of_one_stem_keep_the_folders_that_tell_them_apart() -> None:
    assert names("clips/1/20.jpg", "clips/2/20.jpg", "clips/2/19.jpg") == ["1/20", "2/20", "19"]
    assert names("x.jpg", "sub/x.jpg") == ["x", "sub/x"]


def test_images_that_differ_in_the_suffix_alone_keep_it() -> None:
    assert names("x.jpg", "x.png") == ["x.jpg", "x.png"]
    assert names("a/x.jpg", "a/x.png", "b/x.jpg") == ["a/x.jpg", "a/x.png", "b/x"]


def test_upper_and_lower_case_are_the_same_file_on_some_disks() -> None:
    assert names("x.jpg", "X.png", "y.JPG") == ["x.jpg", "X.png", "y"]


def test_names_are_always_different() -> None:
    every = names("x.jpg", "x.png", "x.jpg.png", "b/x.jpg.png", "b/x.png", "X.png")
    assert len({name.casefold() for name in every}) == 6
