"""What an exported network changes: nothing, or not more than is allowed."""

from __future__ import annotations

import logging

import numpy as np
from jaxtyping import UInt8

from yolino.inference.engines import Engine

_log = logging.getLogger(__name__)


def compare(one: Engine, other: Engine, tolerances: tuple[float, float]) -> None:
    """Runs both on random pixels.

    Args:
        one: A network.
        other: The same network, exported.
        tolerances: How much its end points may differ, in pixels, and its scores.

    Raises:
        RuntimeError: They differ by more.
    """
    images = np.random.default_rng(0).integers(0, 256, (2, *one.header.size, 3), dtype=np.uint8)
    ours, theirs = one(images), other(images)
    pixels = float(np.abs(ours.endpoints - theirs.endpoints).max())
    scores = float(np.abs(ours.scores - theirs.scores).max())
    # Asked this way round, numbers that are not finite are a difference too.
    if not (pixels <= tolerances[0] and scores <= tolerances[1]):
        raise RuntimeError(
            f"The exported network differs from the one before by {pixels:.2g} px and {scores:.2g} in score."
        )
    _log.info("exported network equals the one before to %.1e px", pixels)


def endpoint_shift(
    one: Engine, other: Engine, images: UInt8[np.ndarray, "b h w 3"], threshold: float
) -> float:
    """Gives how far the end points of one network lie from those of the other, the mean in its pixels.

    Args:
        one: A network.
        other: The same network, exported.
        images: Inputs of both.
        threshold: Lowest score, by the first network, of the segments that are compared; where none reaches
            it, all are.
    """
    distances, wanted = [], []
    for image in images:  # batches of one keep the memory small
        ours, theirs = one(image[None]), other(image[None])
        distances.append(np.linalg.norm(ours.endpoints - theirs.endpoints, axis=-1).mean(axis=-1).ravel())
        wanted.append(ours.scores.ravel() >= threshold)
    far, seen = np.concatenate(distances), np.concatenate(wanted)
    return float(far[seen].mean() if seen.any() else far.mean())


__all__ = ["compare", "endpoint_shift"]
