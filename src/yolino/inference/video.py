"""Frames in, polylines with identities out: reading, predicting, tracking and drawing overlap."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Int, UInt8

from yolino.geometry import transform_points
from yolino.inference.frames import Frame, FrameReader
from yolino.inference.predictor import Predictor
from yolino.inference.tracking import Tracker
from yolino.inference.video_pipeline import Pipeline, Step
from yolino.types import Polylines, Segments
from yolino.viz import draw_polylines


@dataclass(frozen=True, eq=False)
class FrameResult:
    """What was found in one frame.

    Attributes:
        frame: The frame.
        polylines: In pixels of the frame.
        ids: Identity of each polyline, the same in all frames; None without a tracker.
        seen: Whether the polyline was found in this frame, or is where the tracker expects it; None without.
        picture: What a step of drawing made of it; None before.
    """

    frame: Frame
    polylines: Polylines
    ids: Int[np.ndarray, " n"] | None = None
    seen: Bool[np.ndarray, " n"] | None = None
    picture: UInt8[np.ndarray, "h w 3"] | None = None


class VideoPrediction:
    """Finds the polylines in the frames of a video, its steps overlapped; iterate it once.

    Reading, the network, NMS and linking with tracking, and each step of `finish` have a thread each. A
    camera's frames are taken as they are needed: older ones are dropped (`dropped`).

    Args:
        predictor: What finds the polylines.
        reader: The open video, which is closed at the end.
        tracker: What gives identities; None for none.
        finish: What else is done with each result, in order, each step in a thread of its own (drawing, say).
        frames: Stop after so many frames.

    Raises:
        ValueError: If `frames` is not positive.
    """

    def __init__(
        self,
        predictor: Predictor,
        reader: FrameReader,
        *,
        tracker: Tracker | None = None,
        finish: Sequence[Step] = (),
        frames: int | None = None,
    ) -> None:
        if frames is not None and frames < 1:
            raise ValueError(f"frames is {frames}, but must be at least 1 (or None: all).")
        self.reader, self.predictor, self.tracker, self.frames = reader, predictor, tracker, frames
        self._begun = 0
        steps = [Step("network", self._detect), Step("linking", self._link), *finish]
        self._pipeline = Pipeline(reader, steps, latest=reader.live, depth=1 if reader.live else 2)

    @property
    def dropped(self) -> int:
        """How many frames of a camera there was no time for."""
        return self._pipeline.dropped

    @property
    def seconds(self) -> dict[str, float]:
        """The time that each step took so far, without that for which it waited."""
        return dict(self._pipeline.seconds)

    def __iter__(self) -> Iterator[FrameResult]:
        """Yields the results in the order of the frames."""
        yield from self._pipeline

    def stop(self) -> None:
        """Reads no more frames; those under way are finished. May be called by a signal handler."""
        self._pipeline.stop()

    def _detect(self, frame: Frame) -> tuple[Frame, Segments]:
        self._begun += 1
        if self._begun == self.frames:
            self._pipeline.stop()
        return frame, self.predictor.segments(frame.image)

    def _link(self, detected: tuple[Frame, Segments]) -> FrameResult:
        frame, segments = detected
        size = (frame.image.shape[0], frame.image.shape[1])
        polylines = link_segments(self.predictor, segments, size)
        if self.tracker is None:
            return FrameResult(frame, polylines)
        tracked = self.tracker(polylines, size)
        return FrameResult(frame, tracked.polylines, tracked.ids, tracked.seen)


def link_segments(predictor: Predictor, segments: Segments, size: tuple[int, int]) -> Polylines:
    """Gives what the predictor's NMS and linker make of the segments that its network gave for an image.

    Args:
        predictor: Their parameters hold in the frame of its network.
        segments: From `Predictor.segments`, in pixels of the image.
        size: `(height, width)` of the image.
    """
    header = predictor.header
    if header.fit == "window":
        matrix = np.diag([header.scale, header.scale, 1.0])
    else:
        matrix = predictor.preprocess.matrix(size)
    inside = segments.with_endpoints(transform_points(segments.endpoints, matrix))
    found = predictor.linker(predictor.nms(inside))
    return found.with_vertices(transform_points(found.vertices, np.linalg.inv(matrix)))


def draw_frame(result: FrameResult, *, color_by: str = "identity", directed: bool = True) -> FrameResult:
    """Gives the result with a picture of the frame and its polylines.

    Args:
        result: The frame and what was found in it.
        color_by: As for `yolino.viz.draw_polylines`; "identity" follows the identities that a tracker gave.
        directed: False draws no arrows.
    """
    polylines = result.polylines
    if color_by == "identity" and result.ids is not None:
        # The color of an index, for identities in place of labels.
        polylines = Polylines(polylines.vertices, polylines.offsets, polylines.scores, result.ids - 1)
        color_by = "label"
    picture = draw_polylines(result.frame.image, polylines, color_by=color_by, directed=directed)
    return replace(result, picture=picture)


__all__ = ["FrameResult", "VideoPrediction", "draw_frame", "link_segments"]
