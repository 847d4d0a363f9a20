from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yolino.tuning.folds import group_images, split_blocks


def test_clips_are_groups_and_frames_of_one_folder_are_on_their_own() -> None:
    assert group_images(["b/1.jpg", "a/1.jpg", "b/2.jpg"]).tolist() == [1, 0, 1]
    assert group_images(["a/3.jpg", "a/1.jpg", "a/2.jpg"]).tolist() == [2, 0, 1]
    assert group_images(["0/a/1.jpg", "0/b/1.jpg", "1/a/1.jpg"], "1").tolist() == [0, 0, 1]


def test_blocks_are_stretches_of_about_the_same_length() -> None:
    assert split_blocks(np.arange(7), 3).tolist() == [0, 0, 1, 1, 1, 2, 2]
    assert split_blocks(np.array([3, 0, 1, 2]), 2).tolist() == [1, 0, 0, 1]


def test_a_large_group_leaves_no_block_empty() -> None:
    groups = np.array([0] * 50 + [1, 2])
    assert sorted(set(split_blocks(groups, 3).tolist())) == [0, 1, 2]


@given(
    sizes=st.lists(st.integers(1, 9), min_size=2, max_size=12),
    count=st.integers(2, 6),
    seed=st.integers(0, 9),
)
def test_no_group_is_torn_apart_and_no_block_is_empty(sizes: list[int], count: int, seed: int) -> None:
    groups = np.random.default_rng(seed).permutation(np.repeat(np.arange(len(sizes)), sizes))
    if len(sizes) < count:
        with pytest.raises(ValueError, match="take fewer folds"):
            split_blocks(groups, count)
        return
    blocks = split_blocks(groups, count)
    assert set(blocks.tolist()) == set(range(count))
    of_group = [set(blocks[groups == group].tolist()) for group in range(len(sizes))]
    assert all(len(found) == 1 for found in of_group)
    order = [min(found) for found in of_group]
    assert order == sorted(order)
