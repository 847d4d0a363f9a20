"""What is done of a scene, on the disk: a killed run goes on where it was.

A folder holds `settings.json`, which says what is being done, and files with the segments of some windows
each. Every file is written wholly or not at all.
"""

from __future__ import annotations

import json
import shutil
import zipfile
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from yolino.io import write_atomic
from yolino.types import Segments

_SETTINGS = "settings.json"
_SHORT = 40


class Chunk(NamedTuple):
    """Segments of some windows.

    Attributes:
        windows: Numbers of the windows that are done.
        segments: What they answered, in pixels of the network counted from the corner of the scene.
    """

    windows: Int[np.ndarray, " n"]
    segments: Segments


class SceneStore:
    """The folder of one scene.

    Args:
        folder: Where it is; made when something is added.
        settings: All that the segments depend on.

    Attributes:
        chunks: What is done.

    Raises:
        ValueError: The folder holds something else, or work that was done under other settings.
    """

    def __init__(self, folder: Path, settings: Mapping[str, object]) -> None:
        self.folder = folder
        self._settings: dict[str, object] = json.loads(json.dumps(settings))
        if changed := self._compare():
            if any(folder.glob("*.npz")):
                raise ValueError(
                    f"Earlier work in {folder} differs in: {', '.join(changed)}. Remove {folder} to begin "
                    "anew, or go on as before."
                )
            shutil.rmtree(folder)
        self.chunks = list(filter(None, map(_load, sorted(folder.glob("*.npz")))))
        self._next = 1 + max((int(file.stem) for file in folder.glob("*.npz")), default=0)

    @property
    def done(self) -> set[int]:
        """Numbers of the windows that are done."""
        return {int(window) for chunk in self.chunks for window in chunk.windows}

    def add(self, chunk: Chunk) -> None:
        """Adds windows, on the disk and in memory.

        Raises:
            OSError: The disk is full, or the place cannot be written.
        """
        if not (self.folder / _SETTINGS).is_file():
            write_atomic(self.folder / _SETTINGS, json.dumps(self._settings, indent=1) + "\n")
        segments = chunk.segments
        arrays = {"windows": chunk.windows, "endpoints": segments.endpoints, "scores": segments.scores}
        if segments.probabilities is not None:
            arrays["probabilities"] = segments.probabilities.astype(np.float32)  # as the network gave them
        buffer = BytesIO()
        np.savez(buffer, **arrays)  # type: ignore[arg-type]  # an array named `allow_pickle` would be no array
        write_atomic(self.folder / f"{self._next:06d}.npz", buffer.getvalue())
        self._next += 1
        self.chunks.append(chunk)

    def remove(self) -> None:
        """Removes the folder."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _compare(self) -> list[str]:
        """Gives the names of the settings that earlier work does not share."""
        if not self.folder.exists():
            return []
        file = self.folder / _SETTINGS
        names = {path.name for path in self.folder.glob("*")} if self.folder.is_dir() else {"a file"}
        if any(name != file.name and not name.endswith((".npz", ".tmp")) for name in names):
            raise ValueError(f"{self.folder} is needed for unfinished work, but holds something else.")
        try:
            earlier = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return ["settings"] if names else []
        if not isinstance(earlier, dict):
            return ["settings"]
        keys = [*self._settings, *(key for key in earlier if key not in self._settings)]
        changed = [key for key in keys if earlier.get(key) != self._settings.get(key)]
        return [key + _describe(earlier.get(key)) for key in changed]


def _describe(earlier: object) -> str:
    """Gives what a setting was, if that is a short text: how to go on as before."""
    return f" (it was {earlier})" if isinstance(earlier, str) and len(earlier) <= _SHORT else ""


def _load(file: Path) -> Chunk | None:
    """Gives the windows in a file; None, and removes it, if a disk damaged it: they are done again."""
    try:
        with np.load(BytesIO(file.read_bytes())) as arrays:
            shares = arrays.get("probabilities")
            segments = Segments(arrays["endpoints"], arrays["scores"], probabilities=shares)
            return Chunk(arrays["windows"].astype(np.int64), segments)
    except (ValueError, KeyError, OSError, zipfile.BadZipFile):
        file.unlink()
        return None


__all__ = ["Chunk", "SceneStore"]
