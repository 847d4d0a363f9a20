"""Image(s) in, polylines out: preprocess, network, threshold, NMS, linking, and back into the image."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeVar, overload

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import NDArray

from yolino.compiled import reconsider
from yolino.header import Header
from yolino.inference.engine import Engine, usable_cores
from yolino.inference.flips import mirror_segments, with_mirrors
from yolino.inference.postprocessing import (
    Linker,
    Suppressor,
    build_flip,
    build_linker,
    build_nms,
    build_quarters,
)
from yolino.inference.preprocess import Preprocess
from yolino.inference.rotations import join_views, turn, turn_back, turn_predictors
from yolino.inference.views import ImageRaster, Pixels, view
from yolino.inference.windows import (
    Window,
    WindowPlan,
    drop_invalid,
    join_segments,
    owned_predictors,
    plan_windows,
)
from yolino.postprocess.mapping import map_polylines, map_segments
from yolino.postprocess.thresholding import segments_above
from yolino.types import Output, Polylines, Segments

if TYPE_CHECKING:
    from yolino.inference.stream import ImageResult

Image = NDArray[np.generic]
Item = TypeVar("Item")
Made = TypeVar("Made")

DEFAULT_THRESHOLD = 0.5
_UNWANTED = np.float32(-1)  # below every threshold
_SEVERAL = 8  # images of a batch: starting two threads takes as long as linking half an image
_BATCH_PIXELS = 2**20  # of windows in one run: more is not faster, but takes memory


class Stages(NamedTuple):
    """What each step makes of one image, in image pixels.

    Attributes:
        candidates: Segments of the network with a score above the threshold.
        segments: What the NMS leaves of them.
        polylines: What the linker makes of those.
    """

    candidates: Segments
    segments: Segments
    polylines: Polylines


class Predictor:
    """Detects polylines with a loaded network.

    Post-processing happens in the frame of the network, so its parameters hold at every image size. A model
    whose fit is "window" goes over each image in windows; their segments are joined before one NMS and one
    linking, in the frame of the whole image at the network's scale. With `flip` the network
    sees each image and its mirror image, in one batch; the segments of both are joined before the NMS.

    Args:
        engine: Loaded network.
        header: What the model file says about itself; the engine's by default.
        threshold: Lowest score of a segment, 0..1; the header's by default.
        flip: Whether the network also sees the mirrored image, which takes twice the time; the header's by
            default.
        nms: Merges segments; by default the header's `NMS`.
        linker: Joins segments to polylines; by default the header's. In batches of eight and more, it and
            the NMS are called by several threads at once.
        batch_size: Images per run of the network when several are given; of large windows there are fewer.
        overlap: What neighboring windows share, in pixels of the network (see `plan_windows`).

    Raises:
        ValueError: If an argument, or what the header says about the post-processing, is not allowed.
    """

    def __init__(
        self,
        engine: Engine,
        header: Header | None = None,
        *,
        threshold: float | None = None,
        flip: bool | None = None,
        nms: Suppressor | None = None,
        linker: Linker | None = None,
        batch_size: int = 4,
        overlap: int | None = None,
    ) -> None:
        header = engine.header if header is None else header
        threshold = header.postprocess.get("threshold", DEFAULT_THRESHOLD) if threshold is None else threshold
        if not 0 <= threshold <= 1:
            raise ValueError(f"threshold is {threshold}, but a score is between 0 and 1.")
        if batch_size < 1:
            raise ValueError(f"batch_size is {batch_size}, but must be at least 1.")
        self.engine, self.header, self.batch_size = engine, header, batch_size
        self.threshold = float(threshold)
        self.preprocess = Preprocess(header.size, header.fit)
        self.overlap = overlap
        self.quarters, self.flip = build_quarters(header), build_flip(header, flip)
        if header.fit == "window":
            self.plan(header.size)  # says now what is wrong with the overlap
        self.nms = build_nms(header) if nms is None else nms
        self.linker = build_linker(header) if linker is None else linker

    @overload
    def __call__(self, images: Image) -> Polylines: ...
    @overload
    def __call__(self, images: Sequence[Image]) -> list[Polylines]: ...
    def __call__(self, images: Image | Sequence[Image]) -> Polylines | list[Polylines]:
        """Gives the polylines of an image in its pixels, or a list of them for a list of images.

        Args:
            images: One image, `(h, w, 3)` RGB or `(h, w)` gray of uint8; a list of such images of any sizes;
                or a stack of them, `(b, h, w, 3)`.

        Raises:
            ValueError: If an array is no such image, or the network gives numbers that are not finite.
        """
        if isinstance(images, np.ndarray) and images.ndim != 4:
            return self([images])[0]
        every = list(images)
        lines: list[Polylines] = []
        for start in range(0, len(every), self.batch_size):
            lines += _each(self._link, self._detect(every[start : start + self.batch_size]))
        return lines

    def stream(
        self, sources: Iterable[Path | str | Image], *, workers: int | None = None, reduced: bool = False
    ) -> Generator[ImageResult, None, None]:
        """Gives what is found in each of many images, files or arrays, in their order, several at a time.

        See `yolino.inference.stream.stream`.
        """
        from yolino.inference.stream import stream

        return stream(self, sources, workers=workers, reduced=reduced)

    def segments(self, image: Image) -> Segments:
        """Gives the segments above the threshold as the network gives them, in pixels of the image."""
        return map_segments(*self.detect(image))

    def detect(self, image: Image) -> tuple[Segments, Float[np.ndarray, "3 3"]]:
        """Gives the segments above the threshold where NMS and linker work, and the matrix to the image.

        Segments are in pixels of the network's input; the matrix leads from there to pixels of the image.
        """
        return self._detect([image])[0]

    def stages(self, image: Image) -> Stages:
        """Gives what every step makes of the image, from one run of the network."""
        found, matrix = self.detect(image)
        merged = self.nms(found)
        lines = self.linker(merged)
        return Stages(map_segments(found, matrix), map_segments(merged, matrix), map_polylines(lines, matrix))

    def warm_up(self) -> None:
        """Runs every step once on made-up input, so that the first image takes no longer than the others."""
        height, width = self.header.size
        _above(self.engine(np.zeros((1 + self.flip, height, width, 3), np.uint8)), 0, self.threshold)
        steps = np.linspace(0.0, 1.0, 9)[:, None] * (0.0, -height) + (width / 2, height)
        self.linker(self.nms(Segments(np.repeat(np.stack([steps[:-1], steps[1:]], axis=1), 2, axis=0))))

    @property
    def windows_per_run(self) -> int:
        """Number of windows that the network sees in one run."""
        height, width = self.header.size
        return max(min(self.batch_size, _BATCH_PIXELS // (height * width)), 1)

    def plan(self, size: tuple[int, int]) -> WindowPlan:
        """Gives the windows over a scene of `size` (height, width) in its pixels."""
        return plan_windows(size, self.header, overlap=self.overlap)

    def detect_windows(self, views: Sequence[Pixels], windows: Sequence[Window]) -> list[Segments]:
        """Gives the segments that each window answers for, above the threshold.

        The network runs once for each of the model's rotations.

        Args:
            views: What the windows show.
            windows: Where they lie.

        Returns:
            For each window its segments, in pixels of the network's input counted from the corner of the
            scene. Those whose midpoint lies where the scene has no valid pixel are dropped.

        Raises:
            ValueError: If the network does not give what its header says.
        """
        turned = [self._detect_turned(views, windows, quarters) for quarters in self.quarters]
        return [join_views(parts) for parts in zip(*turned, strict=True)]

    def _detect_turned(
        self, views: Sequence[Pixels], windows: Sequence[Window], quarters: int
    ) -> list[Segments]:
        """Gives what `detect_windows` gives from windows that are turned by quarters."""
        output = self.engine(np.stack([turn(each.rgb, quarters) for each in views]))
        found, size = [], self.header.size
        grid = (size[0] // self.header.stride, size[1] // self.header.stride)
        for i, (each, window) in enumerate(zip(views, windows, strict=True)):
            owned = turn_predictors(owned_predictors(window, self.header), grid, quarters)
            if len(owned) != output.scores.shape[1]:
                raise ValueError(
                    f"The network gives {output.scores.shape[1]} segments, but its header says {len(owned)}: "
                    f"{self.header.predictors} in each cell of {self.header.stride} pixels."
                )
            segments = _above(output, i, self.threshold, owned)
            segments = segments.with_endpoints(turn_back(segments.endpoints, size, quarters))
            segments = drop_invalid(segments, each.valid)
            corner = np.array([window.left, window.top], np.float64)
            found.append(segments.with_endpoints(segments.endpoints + corner))
        return found

    def link(self, parts: Sequence[Segments], size: tuple[int, int]) -> Polylines:
        """Gives the polylines of a scene in its pixels: one NMS and one linking over all windows.

        Args:
            parts: What `detect_windows` gave, in any order.
            size: `(height, width)` of the scene in its pixels.
        """
        joined = join_segments(parts, size, self.header)
        return map_polylines(self.linker(self.nms(joined)), self._to_scene())

    def _to_scene(self) -> Float[np.ndarray, "3 3"]:
        """Gives the matrix from the network's pixels, counted from a scene's corner, to the scene's."""
        return np.diag([1 / self.header.scale, 1 / self.header.scale, 1.0])

    def _detect(self, images: list[Image]) -> list[tuple[Segments, Float[np.ndarray, "3 3"]]]:
        """Gives the segments above the threshold in the network's frame, and each image's matrix back."""
        if self.header.fit == "window":
            return self._scan(images)
        inputs, matrices = zip(*_each(self.preprocess, images), strict=True)
        # One image is no copy of itself; the colors of `bgr[..., ::-1]` are turned here.
        batch = np.ascontiguousarray(inputs[0][None]) if len(inputs) == 1 else np.stack(inputs)
        output = self.engine(with_mirrors(batch) if self.flip else batch)
        return [(self._seen(output, i, len(images)), matrix) for i, matrix in enumerate(matrices)]

    def _seen(self, output: Output, index: int, count: int) -> Segments:
        """Gives the segments above the threshold of one of `count` images, with those of its mirror image."""
        found = _above(output, index, self.threshold)
        if not self.flip:
            return found
        mirrored = _above(output, count + index, self.threshold)
        return join_views([found, mirror_segments(mirrored, self.header.size[1])])

    def _link(self, detected: tuple[Segments, Float[np.ndarray, "3 3"]]) -> Polylines:
        """Gives the polylines of what `_detect` gave for an image."""
        found, matrix = detected
        return map_polylines(self.linker(self.nms(found)), matrix)

    def _scan(self, images: list[Image]) -> list[tuple[Segments, Float[np.ndarray, "3 3"]]]:
        """Does what `_detect` does with windows; a batch may hold windows of several images."""
        rasters = [ImageRaster(image) for image in images]
        jobs = [(i, window) for i, raster in enumerate(rasters) for window in self.plan(raster.size)]
        parts: list[list[Segments]] = [[] for _ in images]
        size, scale = self.header.size, self.header.scale
        for start in range(0, len(jobs), self.windows_per_run):
            owners, windows = zip(*jobs[start : start + self.windows_per_run], strict=True)
            views = [view(rasters[i], window, size, scale) for i, window in zip(owners, windows, strict=True)]
            for i, found in zip(owners, self.detect_windows(views, windows), strict=True):
                parts[i].append(found)
        return [
            (join_segments(found, raster.size, self.header), self._to_scene())
            for found, raster in zip(parts, rasters, strict=True)
        ]


def _each(work: Callable[[Item], Made], items: Sequence[Item]) -> list[Made]:
    """Gives `work(item)` of each; in threads, where there are enough to pay for starting them."""
    if len(items) < _SEVERAL:
        return [work(item) for item in items]
    with ThreadPoolExecutor(min(usable_cores(), len(items))) as pool:
        return list(pool.map(work, items))


def _above(
    output: Output, index: int, threshold: float, wanted: Bool[np.ndarray, " n"] | None = None
) -> Segments:
    """Gives the segments of image `index` with at least the threshold, of the wanted predictors."""
    shares = None if output.probabilities is None else output.probabilities[index]
    scores = output.scores[index] if wanted is None else np.where(wanted, output.scores[index], _UNWANTED)
    found = segments_above(output.endpoints[index], scores, shares, threshold)
    reconsider(len(found))
    return found


__all__ = ["Predictor", "Stages"]
