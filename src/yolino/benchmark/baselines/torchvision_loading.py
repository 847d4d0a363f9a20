"""JPEG file to augmented training tensor with targets on PIL and torchvision's transforms v2."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from jaxtyping import UInt8
from PIL import Image
from torch import Tensor
from torchvision import tv_tensors
from torchvision.transforms import v2

from yolino.grid import Grid
from yolino.training.targets import CellTargets, cell_targets
from yolino.types import Polylines

_GRAY = 114
_LEAST_SIDE = 0.82


class TorchvisionLoader:
    """The paper's augmentation for front views: color jitter, rotation, crop, erasing.

    The image is cropped and halved first, so that all that follows works on few pixels, and stays a PIL image
    to the last step, because torchvision rotates and jitters those faster than tensors on a processor.

    Args:
        size: `(height, width)` of the result.
        grid: The cells of the targets.
        draft: Whether PIL decodes a JPEG at about half its size.
    """

    def __init__(self, size: tuple[int, int], grid: Grid, *, draft: bool) -> None:
        self._size, self._grid, self._draft = size, grid, draft
        self._color = v2.ColorJitter(brightness=0.5, contrast=0.5, saturation=0.5, hue=0.2)
        ratio = size[1] / size[0]
        self._motions = v2.Compose(
            [
                v2.RandomRotation(36, interpolation=v2.InterpolationMode.BILINEAR, fill=_GRAY),
                v2.RandomResizedCrop(size, scale=(_LEAST_SIDE**2, 1.0), ratio=(ratio, ratio)),
            ]
        )
        self._erase = v2.RandomErasing(0.5, scale=(0.02, 0.15), value=_GRAY)

    def __call__(self, path: Path, polylines: Polylines) -> tuple[UInt8[Tensor, "3 h w"], CellTargets]:
        """Gives the training image and its targets; the vertices are in pixels of the file."""
        image, scale, top = self._read(path)
        vertices = (polylines.vertices * scale - (0.0, top)).astype(np.float32)
        points = tv_tensors.KeyPoints(torch.from_numpy(vertices), canvas_size=self._size)
        moved, moved_points = self._motions(self._color(image), points)
        pixels: Tensor = self._erase(v2.functional.to_image(moved))
        lines = polylines.with_vertices(moved_points.numpy().astype(np.float64))
        return pixels, cell_targets(lines, self._grid, border=False)

    def _read(self, path: Path) -> tuple[Image.Image, float, float]:
        """Gives the image scaled to the width and cropped at the top, with the scale and the cropped rows."""
        height, width = self._size
        with Image.open(path) as file:
            full = file.width
            rows = round(file.height * width / file.width)
            if self._draft:
                file.draft("RGB", (width, rows))
            image = file.convert("RGB")
        if image.size != (width, rows):
            image = image.resize((width, rows), Image.Resampling.BILINEAR)
        return image.crop((0, rows - height, width, rows)), width / full, float(rows - height)


__all__ = ["TorchvisionLoader"]
