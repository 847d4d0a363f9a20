"""Pictures of what the network sees during training: labels beside predictions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import UInt8

from yolino.training.data import Example, collate_examples
from yolino.viz import draw_polylines, draw_segments

if TYPE_CHECKING:
    from yolino.training.module import TrainingModule


@torch.no_grad()
def prediction_pictures(
    module: TrainingModule, examples: Sequence[Example], threshold: float
) -> UInt8[np.ndarray, "h w 3"]:
    """Gives one picture: a row per example, labels on the left, segments after the NMS on the right."""
    batch = collate_examples(examples)
    images = batch.images.to(module.device).float()
    rows = []
    for example, segments in zip(
        examples, module.segments(module.network(images), images.shape[-2:]), strict=True
    ):
        found = module.validation.nms(segments[segments.scores >= threshold])
        left = draw_polylines(example.image, example.polylines)
        rows.append(np.concatenate([left, draw_segments(example.image, found)], axis=1))
    return np.concatenate(rows)
