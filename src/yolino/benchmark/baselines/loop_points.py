"""The point metric's matching as a loop over the ground-truth samples."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Bool

from yolino.metrics.samples import Samples


def match_in_a_loop(
    found: Samples, wanted: Samples, radius: float, angle_radius: float = math.pi / 4
) -> Bool[np.ndarray, " s"]:
    """Gives which predicted samples are the closest, within both radii, to some ground-truth sample.

    All predicted samples are compared at once with each ground-truth sample.
    """
    hit = np.zeros(len(found), np.bool_)
    limit, squared_radius = math.cos(angle_radius), radius * radius
    x, y = found.points[:, 0].copy(), found.points[:, 1].copy()
    ux, uy = found.directions[:, 0].copy(), found.directions[:, 1].copy()
    for (px, py), (vx, vy) in zip(wanted.points, wanted.directions, strict=True):
        squared = (x - px) ** 2 + (y - py) ** 2
        squared[ux * vx + uy * vy < limit] = np.inf
        nearest = squared.argmin()
        if squared[nearest] <= squared_radius:
            hit[nearest] = True
    return hit


__all__ = ["match_in_a_loop"]
