"""Two files that belong together, replaced together."""

from __future__ import annotations

import contextlib
import os
import uuid
from collections.abc import Iterator
from pathlib import Path

from yolino.io import write_atomic


def write_pair(xml: Path, graph: bytes, weights: bytes) -> None:
    """Writes an `.xml` and the `.bin` beside it such that no moment shows one with another's partner.

    An `.xml` finds its `.bin` by name, and two files cannot be renamed at once. So both are written whole
    under other names; then the old `.xml` goes, the `.bin` takes its place, and last the new `.xml`. A run
    that is killed between these renames leaves a `.bin` alone, which is no model, and at any other time the
    old pair or the new one. Where the weights are the same, only the `.xml` is replaced.

    Raises:
        OSError: The disk is full, or the place cannot be written.
    """
    binary = xml.with_suffix(".bin")
    new_xml, new_binary, old = (xml.with_name(f".{uuid.uuid4().hex[:12]}.tmp") for _ in range(3))
    try:
        if xml.is_file() and binary.is_file() and binary.read_bytes() == weights:
            write_atomic(xml, graph)
            return
        xml.parent.mkdir(parents=True, exist_ok=True)
        _write(new_binary, weights)
        _write(new_xml, graph)
        with _aside(xml, old):
            os.replace(new_binary, binary)
        os.replace(new_xml, xml)
    except OSError as error:
        raise OSError(f"{xml} and its .bin cannot be written: {error.strerror or error}.") from None
    finally:
        for file in (new_xml, new_binary, old):
            with contextlib.suppress(NotADirectoryError):  # it could not be made either
                file.unlink(missing_ok=True)


@contextlib.contextmanager
def _aside(file: Path, aside: Path) -> Iterator[None]:
    """Takes a file away; brings it back if the block fails."""
    if file.exists():
        os.replace(file, aside)
    try:
        yield
    except BaseException:
        if aside.exists():
            os.replace(aside, file)
        raise


def _write(file: Path, data: bytes) -> None:
    with open(file, "xb") as stream:
        stream.write(data)
        stream.flush()
        os.fsync(stream.fileno())


__all__ = ["write_pair"]
