"""What the name given as `--out` stands for: a folder, or a file of which kind."""

from __future__ import annotations

import difflib
import os
from pathlib import Path

SCENE_SUFFIXES = (".gpkg", ".geojson", ".parquet", ".json")
LINES = ".jsonl"
_SEPARATORS = tuple(filter(None, (os.sep, os.altsep)))
_ALIKE = 0.75  # .gpkp is .gpkg, but .jpg is not


def ending(out: str | Path) -> str:
    """Gives the suffix of the file that a name stands for, in lower case.

    It is "" for a folder: one that is there, a name without a suffix, or one with a separator at its end.
    """
    if str(out).endswith(_SEPARATORS) or Path(out).is_dir():
        return ""
    return Path(out).suffix.lower()


def video_suffixes() -> tuple[str, ...]:
    """Gives the suffixes of what a video can become."""
    from yolino.inference.video_writer import CODECS

    return (*CODECS, LINES)


def check_ending(out: str | Path, source: str, *, video: bool) -> None:
    """Refuses a name for the results that would become a folder by mistake.

    Args:
        out: The name.
        source: The first source.
        video: Whether the sources are videos.

    Raises:
        ValueError: It names no folder, and its suffix is not known, or is that of another kind of source.
    """
    suffix = ending(out)
    if not suffix or Path(out).exists():  # whoever writes tells of a file that is there
        return
    videos = video_suffixes()
    if suffix in videos and not video:
        raise ValueError(f"--out {out} is for a video, but {source} is none (by its name): give a folder.")
    if suffix in (*SCENE_SUFFIXES, *videos):
        return
    near = difflib.get_close_matches(suffix, (*SCENE_SUFFIXES, *videos), n=1, cutoff=_ALIKE)
    hint = f" (did you mean {Path(out).with_suffix(near[0])}?)" if near else ""
    raise ValueError(
        f"--out {out} has the unknown ending {Path(out).suffix}{hint}; a scene goes into "
        f"{_any_of(SCENE_SUFFIXES)}, a video into {_any_of(videos)}, images into a folder (end its name with "
        f"{os.sep} if it must have a dot)."
    )


def _any_of(suffixes: tuple[str, ...]) -> str:
    return f"{', '.join(suffixes[:-1])} or {suffixes[-1]}"


__all__ = ["LINES", "SCENE_SUFFIXES", "check_ending", "ending", "video_suffixes"]
