"""Images in blocks that have little to do with each other: tuned on some, scored on the others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Int

from yolino.datasets.grouping import group_names


def group_images(names: Sequence[str], by: str = "auto") -> Int[np.ndarray, " n"]:
    """Gives the group of each image (see `group_names`), counted in the order of the names.

    If all are in one group, each is a group of its own.
    """
    groups = np.unique(group_names(names, by), return_inverse=True)[1]
    return groups if groups.max() > 0 else np.unique(names, return_inverse=True)[1]


def split_blocks(groups: Int[np.ndarray, " n"], count: int) -> Int[np.ndarray, " n"]:
    """Gives the block of each image: groups that follow each other, about as many images in each block.

    Names of frames follow each other as the frames do, so a block is a stretch of the drive: frames that are
    alike are on one side.

    Args:
        groups: Group of each image, from 0 on.
        count: Number of blocks.

    Raises:
        ValueError: There are fewer groups than blocks.
    """
    sizes = np.bincount(groups)
    if len(sizes) < count:
        raise ValueError(
            f"{count} blocks are asked for, but the images are in {len(sizes)} groups: take fewer folds, or "
            "label more images."
        )
    before = np.cumsum(sizes) - sizes
    blocks = np.minimum((before + sizes / 2) * count // sizes.sum(), count - 1).astype(np.int64)
    # A very large group may leave a block empty; then groups count alike.
    if len(np.unique(blocks)) < count:
        blocks = np.arange(len(sizes)) * count // len(sizes)
    return np.asarray(blocks[groups])


__all__ = ["group_images", "split_blocks"]
