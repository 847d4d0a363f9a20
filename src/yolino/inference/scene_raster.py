"""Scenes from files: any number of bands, any number type, in parts that are read when they are needed."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Shaped, UInt8

from yolino.datasets.georeference import may_be_georeferenced
from yolino.image import IMAGE_SUFFIXES
from yolino.inference.preprocess import FILL
from yolino.inference.views import Box, ImageRaster, Pixels, Raster
from yolino.io import image_size, read_image

_SMALL = 2**27  # pixels that an image without a place on the map may have to be read at once
_GEO = (".tif", ".tiff", ".jp2")
_SHARE = (2.0, 98.0)
_LOOKED_AT = 1024
_CACHE_BYTES = 2**29
# A damaged JPEG is an error, not gray. The cache holds a row of windows of what can only be read in order; it
# is given in bytes: rasterio takes small numbers for bytes, too, not for megabytes as GDAL alone does.
_SETTINGS = {"GDAL_CACHEMAX": _CACHE_BYTES, "GDAL_ERROR_ON_LIBJPEG_WARNING": "YES"}


class SceneRaster:
    """A raster that rasterio reads, as RGB pixels of uint8.

    Colors come from the bands given, or else from those that say they are red, green and blue, or else from
    the first three; of one or two bands the first is gray, or the index of a color table. Numbers other than
    uint8 are stretched: per band, 2 % of the scene's valid pixels become black and 2 % white, from a sample
    that is taken once. What the raster says is no data (its nodata value, mask, transparency, not a number)
    is not valid, and gray.

    Args:
        path: The file.
        bands: Numbers of three bands (or one) from 1 on; None chooses.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It is no raster, has no such bands, or its numbers are complex.
        ModuleNotFoundError: rasterio is not installed.
    """

    def __init__(self, path: Path, bands: Sequence[int] | None = None) -> None:
        import rasterio

        if not path.is_file():
            raise FileNotFoundError(f"There is no scene {path}.")
        self.path = path
        try:
            with _gdal(), warnings.catch_warnings():
                warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
                self._raster = rasterio.open(os.fspath(path))
        except rasterio.errors.RasterioIOError as error:
            raise ValueError(f"{path} cannot be read as a raster ({error}).") from None
        self.size = (int(self._raster.height), int(self._raster.width))
        self.bands = _choose_bands(self._raster, bands, path)
        self._colors = _color_table(self._raster, self.bands)
        kinds = {np.dtype(self._raster.dtypes[band - 1]) for band in self.bands}
        if any(kind.kind not in "uif" for kind in kinds):
            raise ValueError(f"{path} has {kinds.pop()} pixels, but real numbers are needed.")
        # GDAL's own masks know one of these only: a nodata value hides transparency.
        nodata = [self._raster.nodatavals[band - 1] for band in self.bands]
        self._nodata = None if None in nodata else np.array(nodata, np.float64)
        colors = [interpretation.name for interpretation in self._raster.colorinterp]
        self._alphas = [band for band, name in enumerate(colors, 1) if name == "alpha"]
        self._masked = {flag.name for flag in self._raster.mask_flag_enums[0]} == {"per_dataset"}
        self._limits = None if kinds == {np.dtype(np.uint8)} else self._measure()

    def read(self, box: Box) -> Pixels:
        """Gives the pixels in a box that lies inside.

        Raises:
            ValueError: They cannot be read; the message is GDAL's.
        """
        values, valid = self._values(box)
        if self._colors is not None:
            rgb = self._colors[values[0].astype(np.uint8)]
        else:
            scaled = values if self._limits is None else _stretch(values, *self._limits)
            rgb = np.moveaxis(scaled.astype(np.uint8, copy=False), 0, 2)
        if rgb.shape[2] == 1:
            rgb = np.repeat(rgb, 3, axis=2)
        if valid is None or valid.all():
            return Pixels(np.ascontiguousarray(rgb), None)
        return Pixels(np.where(valid[:, :, None], rgb, np.uint8(FILL)), valid)

    def close(self) -> None:
        """Closes the file."""
        self._raster.close()

    def _values(self, box: Box) -> tuple[Shaped[np.ndarray, "c h w"], Bool[np.ndarray, "h w"] | None]:
        """Gives the numbers in the bands, and which pixels are valid; None: all."""
        import rasterio
        from rasterio.windows import Window

        left, top, right, bottom = box
        window = Window(left, top, right - left, bottom - top)
        try:
            with _gdal():
                values = self._raster.read(list(self.bands), window=window)
                masks = [self._raster.read([band], window=window)[0] for band in self._alphas]
                if self._masked:
                    masks.append(self._raster.read_masks(1, window=window))
        except rasterio.errors.RasterioError as error:
            raise ValueError(" ".join(str(error.__cause__ or error).split()).rstrip(".")) from None
        valid = None if self._nodata is None else _unlike(values, self._nodata)
        for mask in masks:
            valid = mask > 0 if valid is None else valid & (mask > 0)
        if values.dtype.kind == "f":
            finite = np.isfinite(values).all(axis=0)
            valid = finite if valid is None else valid & finite
        return values, valid

    def _measure(self) -> tuple[Float[np.ndarray, " c"], Float[np.ndarray, " c"]]:
        """Gives which numbers become black and white, per band, from a sample of the valid pixels."""
        found = [np.zeros((len(self.bands), 0))]
        for box in _sample_boxes(self.size):
            try:
                values, valid = self._values(box)
            except ValueError:  # a damaged part is reported when it is predicted
                continue
            found.append(values.reshape(len(values), -1) if valid is None else values[:, valid])
        sample = np.concatenate([part.astype(np.float64) for part in found], axis=1)
        if not sample.shape[1]:
            return np.zeros(len(self.bands)), np.ones(len(self.bands))
        low, high = np.percentile(sample, _SHARE, axis=1)
        return low, np.where(high > low, high, low + 1)


def open_scene(path: Path, bands: Sequence[int] | None = None) -> Raster:
    """Gives a scene from a file: read whole if it is a photo of common size, else in parts.

    Args:
        path: The file.
        bands: See `SceneRaster`.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It cannot be read, or has no such bands.
        ModuleNotFoundError: It needs rasterio, which is not installed.
    """
    if not path.is_file():
        raise FileNotFoundError(f"There is no scene {path}.")
    common = path.suffix.lower() in IMAGE_SUFFIXES and path.suffix.lower() not in _GEO
    if bands is None and common and not may_be_georeferenced(path):
        height, width = image_size(path)
        if height * width <= _SMALL:
            return ImageRaster(read_image(path))
    return SceneRaster(path, bands)


@contextmanager
def _gdal() -> Iterator[None]:
    """Runs GDAL with our settings."""
    import rasterio

    with rasterio.Env(**_SETTINGS):
        yield


def _choose_bands(raster: Any, bands: Sequence[int] | None, path: Path) -> tuple[int, ...]:
    count = int(raster.count)
    if bands is not None:
        if len(bands) not in (1, 3) or any(not 1 <= band <= count for band in bands):
            raise ValueError(
                f"The bands {', '.join(map(str, bands))} were asked for, but {path} has {count}: give three "
                f"numbers (or one) from 1 to {count}."
            )
        return tuple(int(band) for band in bands)
    if count < 3:
        return (1,)
    names = [interpretation.name for interpretation in raster.colorinterp]
    if {"red", "green", "blue"} <= set(names):
        return tuple(names.index(color) + 1 for color in ("red", "green", "blue"))
    return (1, 2, 3)


def _color_table(raster: Any, bands: tuple[int, ...]) -> UInt8[np.ndarray, "256 3"] | None:
    """Gives the colors of the indices of a band with a color table."""
    if len(bands) != 1 or raster.colorinterp[bands[0] - 1].name != "palette":
        return None
    if raster.dtypes[bands[0] - 1] != "uint8":
        return None
    table = np.zeros((256, 3), np.uint8)
    for index, color in raster.colormap(bands[0]).items():
        table[index] = color[:3]
    return table


def _unlike(values: Shaped[np.ndarray, "c h w"], nodata: Float[np.ndarray, " c"]) -> Bool[np.ndarray, "h w"]:
    """Tells where one band at least differs from its nodata value, in the precision of the numbers."""
    if values.dtype.kind == "f":
        nodata = nodata.astype(values.dtype)
    return np.asarray((values != nodata[:, None, None]).any(axis=0))


def _sample_boxes(size: tuple[int, int]) -> Iterator[Box]:
    """Yields 64 boxes, spread evenly: all of a small scene, a part of a large one."""
    edge = _LOOKED_AT // 8
    height, width = size
    rows, columns = (np.linspace(0, max(side - edge, 0), 8).astype(int).tolist() for side in (height, width))
    for top in dict.fromkeys(rows):
        for left in dict.fromkeys(columns):
            yield (left, top, min(left + edge, width), min(top + edge, height))


def _stretch(
    values: Shaped[np.ndarray, "c h w"], low: Float[np.ndarray, " c"], high: Float[np.ndarray, " c"]
) -> UInt8[np.ndarray, "c h w"]:
    """Gives numbers between `low` and `high` as 0..255; what is no number is 0."""
    low, high = (limit.astype(np.float32)[:, None, None] for limit in (low, high))
    share = (np.nan_to_num(values.astype(np.float32)) - low) / (high - low)
    return np.asarray((np.clip(share, 0, 1) * 255 + 0.5).astype(np.uint8))


__all__ = ["SceneRaster", "open_scene"]
