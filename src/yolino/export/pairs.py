"""Two files that belong together, replaced together."""

from __future__ import annotations

import contextlib
import os
import uuid
from pathlib import Path

from yolino.io import write_atomic


def write_pair(xml: Path, graph: bytes, weights: bytes) -> None:
    """Writes an `.xml` and the `.bin` beside it such that no moment shows one with another's partner.

    An `.xml` finds its `.bin` by name, and two files cannot be renamed at once. So both are written whole
    under other names; then the old `.xml` goes, and the old `.bin`; the new `.bin` takes its place, and last
    the new `.xml`. An error or Ctrl-C between these renames brings the old pair back. A run that is killed
    between them leaves no `.xml`, and so no model; the old pair then lies beside it under names that begin
    with a dot. Where the weights are the same, only the `.xml` is replaced.

    Raises:
        OSError: The disk is full, or the place cannot be written.
    """
    binary = xml.with_suffix(".bin")
    new_xml, new_binary = _beside(xml), _beside(xml)
    try:
        if xml.is_file() and binary.is_file() and binary.read_bytes() == weights:
            write_atomic(xml, graph)
            return
        xml.parent.mkdir(parents=True, exist_ok=True)
        _write(new_binary, weights)
        _write(new_xml, graph)
        _exchange(xml, binary, new_xml, new_binary)
    except OSError as error:
        raise OSError(f"{xml} and its .bin cannot be written: {error.strerror or error}.") from None
    finally:
        _remove(new_xml, new_binary)


def _exchange(xml: Path, binary: Path, new_xml: Path, new_binary: Path) -> None:
    """Puts the new pair in the place of the old one; if that fails, the old one is there as before.

    What has been done is seen from the files alone: an interrupt may come right after a rename.
    """
    old_xml, old_binary = _beside(xml), _beside(xml)
    try:
        for file, aside in ((xml, old_xml), (binary, old_binary)):
            if file.is_file():
                os.replace(file, aside)
        os.replace(new_binary, binary)
        os.replace(new_xml, xml)
    except BaseException:
        if new_xml.exists():  # else the new pair is complete
            if not new_binary.exists():
                binary.unlink(missing_ok=True)
            for file, aside in ((binary, old_binary), (xml, old_xml)):
                if aside.exists():
                    os.replace(aside, file)
        _remove(old_xml, old_binary)
        raise
    _remove(old_xml, old_binary)


def _beside(file: Path) -> Path:
    """Gives a name that nothing has, in the same folder."""
    return file.with_name(f".{uuid.uuid4().hex[:12]}.tmp")


def _remove(*files: Path) -> None:
    for file in files:
        with contextlib.suppress(NotADirectoryError):  # it could not be made either
            file.unlink(missing_ok=True)


def _write(file: Path, data: bytes) -> None:
    with open(file, "xb") as stream:
        stream.write(data)
        stream.flush()
        os.fsync(stream.fileno())


__all__ = ["write_pair"]
