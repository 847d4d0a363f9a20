"""Which class of a model is meant by a class of the labels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Int

KINDS: Mapping[str, str] = {
    "continuous yellow": "continuous",
    "continuous white": "continuous",
    "double continuous yellow": "continuous",
    "double dashed": "dashed",
}
"""What the lane types of TuSimple are kinds of, for models that tell no more than that."""


def label_map(labelled: Sequence[str], predicted: Sequence[str]) -> Int[np.ndarray, " c"] | None:
    """Gives the model's label for each label of a dataset.

    That is the class of the same name, or else the one of which it is a kind (`KINDS`).

    Args:
        labelled: Names of the dataset's classes.
        predicted: Names of the model's classes.

    Returns:
        Labels; None if the model lacks one of the classes: then classes cannot be compared.
    """
    meant = [name if name in predicted else KINDS.get(name, name) for name in labelled]
    if not predicted or any(name not in predicted for name in meant):
        return None
    return np.array([list(predicted).index(name) for name in meant], np.int64)


__all__ = ["KINDS", "label_map"]
