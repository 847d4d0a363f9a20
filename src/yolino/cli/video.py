"""What `yolino predict` does with videos, cameras and streams."""

from __future__ import annotations

import glob
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from yolino.cli.outputs import LINES, ending, video_suffixes

if TYPE_CHECKING:
    from yolino.cli.video_run import Targets
    from yolino.inference import EngineChoice, Predictor
    from yolino.inference.tracking import Tracker


class Video(NamedTuple):
    """Options that only videos have; None is the default.

    Attributes:
        track: Whether polylines get identities; by default they do.
        smooth: Whether they are steadied, too.
        frames: Stop after so many frames.
    """

    track: bool | None = None
    smooth: bool | None = None
    frames: int | None = None


def are_videos(sources: Sequence[str], options: Video = Video()) -> bool:
    """Tells whether the sources are videos, cameras and streams, by their names alone.

    Raises:
        ValueError: If some are and others are not, or options are given that do not go together.
    """
    others = [source for source in sources if not is_video(source)]
    if 0 < len(others) < len(sources):
        raise ValueError(f"{others[0]} is no video, but others are: give videos and images to separate runs.")
    given = [f"--{name}" for name, value in options._asdict().items() if value is not None]
    if others and given:
        raise ValueError(f"{given[0]} is for videos, but {others[0]} is none (by its name).")
    if options.smooth and options.track is False:
        raise ValueError("--smooth needs to know which line is which: leave out --no-track.")
    return not others


def is_video(source: str) -> bool:
    """Tells whether a source is a video file, a camera or a stream, by its name alone."""
    from yolino.inference.frames import names_video

    return names_video(source)


def predict_videos(
    sources: Sequence[str],
    out: str | Path,
    options: Video,
    *,
    model: str,
    threshold: float | None,
    flip: bool | None,
    choice: EngineChoice,
    pictures: bool = True,
    format: str = "json",
    view: str = "lines",
) -> None:
    """Finds the polylines in videos; writes videos with the lines drawn, JSON lines, or both.

    Args:
        sources: Videos, cameras and streams.
        out: A folder for both; or a file: its suffix says which.
        options: What only videos have.
        model: Name or file of the model.
        threshold: Lowest score of a segment; None for the model's.
        flip: Whether the network also sees the mirrored frame; None for the model's choice.
        choice: What runs the network, and how.
        pictures: Whether to write a video.
        format: "json": other formats of results have no times.
        view: "lines": other views would flicker.

    Raises:
        ValueError: If the sources do not go together or a result cannot be written.
    """
    from yolino.cli.screen import busy, report_problems
    from yolino.cli.video_run import VideoRun
    from yolino.inference import Predictor
    from yolino.inference.frames import open_frames
    from yolino.inference.tracking import warm_up

    if format != "json":
        raise ValueError(f"Videos give JSON lines, not the format {format!r}: leave out --format.")
    if view != "lines":
        raise ValueError(f"Videos show lines, not the view {view!r}: leave out --view.")
    targets = find_targets(sources, out, pictures=pictures)
    problems: list[str] = []
    predictor: Predictor | None = None
    with report_problems(problems):
        for target in targets:
            try:
                reader = open_frames(target.source)
            except (ValueError, OSError) as error:
                problems.append(str(error))
                continue
            try:
                if predictor is None:
                    with busy("loading the model (once after an installation, up to a minute)"):
                        predictor = Predictor(choice.open(model), threshold=threshold, flip=flip)
                        predictor.warm_up()
                        warm_up()
                tracker = None if options.track is False else _tracker(predictor, bool(options.smooth))
                run = VideoRun(predictor, reader, target, tracker=tracker, frames=options.frames)
            except BaseException:
                reader.close()
                raise
            problems += run()


def find_targets(sources: Sequence[str], out: str | Path, *, pictures: bool) -> list[Targets]:
    """Gives where the results of each source go.

    Args:
        sources: Videos, cameras, streams, and globs of videos.
        out: A folder for a video and JSON lines of each; or a file: its suffix says which of both.
        pictures: Whether to write a video.

    Raises:
        ValueError: If a pattern names no video, a result would replace one, or `out` does not fit or is a
            file that is there already.
    """
    from yolino.cli.sources import result_names
    from yolino.cli.video_run import Targets

    every = _expand(sources)
    suffix, out = ending(out), Path(out)
    if not suffix:
        names = result_names([_as_path(source) for source in every])
        found = [
            Targets(source, out / f"{name}.mp4" if pictures else None, out / f"{name}{LINES}")
            for source, name in zip(every, names, strict=True)
        ]
    elif suffix not in video_suffixes():
        known = ", ".join(video_suffixes())
        raise ValueError(f"--out {out} is neither a folder nor a file in {known}: give another name.")
    elif len(every) > 1:
        raise ValueError(f"--out {out} is one file for {len(every)} videos: give a folder.")
    elif suffix == LINES:
        found = [Targets(every[0], None, out)]
    elif not pictures:
        raise ValueError(f"--out {out} is a video, but --no-images wants none: give a name in {LINES}.")
    else:
        found = [Targets(every[0], out, None)]
    _refuse_overwriting(found)
    if suffix and out.exists():
        raise ValueError(f"--out {out} exists already and is not replaced: remove it or give another name.")
    return found


def _expand(sources: Sequence[str]) -> list[str]:
    """Gives the sources, each once, with globs replaced by the videos that they name."""
    every: dict[str, None] = {}
    for source in sources:
        matches = [source]
        if "://" not in source and not Path(source).exists() and glob.has_magic(source):
            matches = sorted(filter(is_video, glob.glob(source, recursive=True)))
            if not matches:
                raise ValueError(f"The pattern {source} names no video.")
        every.update(dict.fromkeys(matches))
    return list(every)


def _as_path(source: str) -> Path:
    """Gives the path of a file, or a name for the results of a camera or stream."""
    from yolino.inference.frames import CAMERA, public_name

    if "://" not in source and not source.lower().startswith(CAMERA):
        return Path(source)
    return Path(re.sub(r"[^A-Za-z0-9_]+", "-", public_name(source)).strip("-"))


def _refuse_overwriting(targets: Sequence[Targets]) -> None:
    originals = {Path(target.source).resolve() for target in targets}
    for target in targets:
        for path in (target.video, target.lines):
            if path is not None and path.resolve() in originals:
                raise ValueError(f"{path} would replace a source video: choose another --out.")


def _tracker(predictor: Predictor, smooth: bool) -> Tracker:
    from yolino.inference.tracking import Tracker

    return Tracker(smooth=smooth, births=2 if smooth else 1, directed=predictor.header.directed)


__all__ = ["Video", "are_videos", "find_targets", "is_video", "predict_videos"]
