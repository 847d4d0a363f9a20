"""The pixels of mask files, and the outlines of regions in them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float, Shaped

from yolino import jpeg
from yolino.datasets.annotation import LabelError
from yolino.io import read_image

_PNG = b"\x89PNG\r\n\x1a\n"
_PALETTE = 3
# Of a JPEG's values, which are blurred, those from here on are lines.
_HALF = 128


def read_lines(path: Path) -> Bool[np.ndarray, "h w"]:
    """Gives where a mask of one class is not black and not transparent; of a JPEG, where it is light.

    Raises:
        LabelError: It is no readable image.
    """
    pixels, data = _decode(path)
    least = _HALF if data.startswith(jpeg.START) else 1
    lines = np.asarray(pixels >= least)
    return lines if lines.ndim == 2 else _opaque(pixels, np.asarray(lines[..., :3].any(axis=2)))


def read_classes(path: Path) -> Shaped[np.ndarray, "h w"]:
    """Gives the value of each pixel, of a palette image its index; what is transparent is 0.

    Raises:
        LabelError: It is no readable image, a JPEG, or has colors.
    """
    pixels, data = _decode(path)
    if data.startswith(jpeg.START):
        raise LabelError(
            str(path), "is a JPEG, whose values are blurred; use PNG for masks of several values"
        )
    if data[:3] == b"GIF" or (data.startswith(_PNG) and data[25] == _PALETTE):
        from PIL import Image

        with Image.open(path) as image:
            return np.asarray(image if image.mode in ("P", "L") else image.convert("P"))
    if pixels.ndim == 3:
        gray = pixels[..., 0]
        if (pixels[..., 1:3] != gray[..., None]).any():
            raise LabelError(str(path), "has colors, but one value per pixel is needed")
        pixels = _opaque(pixels, gray)
    return pixels


def _decode(path: Path) -> tuple[Shaped[np.ndarray, "h w *c"], bytes]:
    """Gives the pixels as the file holds them, and the file."""
    data = path.read_bytes()
    try:
        read_image(path)  # tells all that can be wrong with it, but for pixels that are no whole numbers
    except ValueError as error:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if _is_tiff(data) else None
        reason = str(error).removeprefix(f"{path} ").removesuffix(".")
        if pixels is not None and pixels.dtype not in (np.uint8, np.uint16):
            reason = f"has {pixels.dtype} pixels, but whole numbers of 8 or 16 bits are needed, convert it"
        raise LabelError(str(path), reason) from None
    return np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)), data


def _is_tiff(data: bytes) -> bool:
    return data[:4] in (b"II*\x00", b"MM\x00*")


def _opaque(
    pixels: Shaped[np.ndarray, "h w c"], values: Shaped[np.ndarray, "h w"]
) -> Shaped[np.ndarray, "h w"]:
    """Gives the values, 0 where the pixels are transparent."""
    return np.where(pixels[..., 3] > 0, values, values.dtype.type(0)) if pixels.shape[2] == 4 else values


def mask_to_polygons(mask: Bool[np.ndarray, "h w"], tolerance: float = 0.0) -> list[Float[np.ndarray, "_ 2"]]:
    """Gives the outlines of the regions that are True, in pixels: along the edges of the pixels.

    Corners that point into a region are cut by half a pixel; all centers of pixels lie on their side. Regions
    that touch at a corner are one. A hole becomes part of the outline: it is entered and left along
    the same line, which the even-odd rule does not see.

    Args:
        mask: The regions.
        tolerance: Largest distance in pixels by which the outline is simplified.
    """
    height, width = mask.shape
    # Points at half pixels: a pixel covers three by three, so that outlines of points are those of pixels.
    points = np.zeros((2 * height + 1, 2 * width + 1), np.uint8)
    for y in range(3):
        for x in range(3):
            points[y : y + 2 * height : 2, x : x + 2 * width : 2][:height, :width] |= mask
    contours, tree = cv2.findContours(points, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    polygons: dict[int, np.ndarray] = {}
    holes = []
    for i, contour in enumerate(contours):
        outline = contour[:, 0] if tolerance == 0 else cv2.approxPolyDP(contour, 2 * tolerance, True)[:, 0]
        outline = (outline if len(outline) > 2 else contour[:, 0]) / 2
        parent = int(tree[0, i, 3])
        if parent < 0:
            polygons[i] = outline
        else:
            holes.append((parent, outline))
    for parent, hole in holes:
        polygons[parent] = _bridge(polygons[parent], hole)
    return list(polygons.values())


def _bridge(outline: Float[np.ndarray, "v 2"], hole: Float[np.ndarray, "w 2"]) -> Float[np.ndarray, "_ 2"]:
    """Gives the outline with a detour around the hole, from where both are closest."""
    apart = np.hypot(*(outline[:, None] - hole).transpose(2, 0, 1))
    i, j = np.unravel_index(int(apart.argmin()), apart.shape)
    around = np.concatenate([hole[j:], hole[: j + 1]])
    return np.concatenate([outline[: i + 1], around, outline[i:]])


__all__ = ["mask_to_polygons", "read_classes", "read_lines"]
