"""What the chunks of a PNG file say without decoding its pixels."""

from __future__ import annotations

import os
import struct
from typing import BinaryIO

START = b"\x89PNG\r\n\x1a\n"
_HEAD = 2**16  # bytes: what stands before the pixels is rarely longer
_TAIL = 64


def read_size(stream: BinaryIO) -> tuple[int, int] | None:
    """Gives `(height, width)`; None for other files, for cut ones, and where EXIF may turn the picture."""
    stream.seek(0)
    head = stream.read(_HEAD)
    stream.seek(max(stream.seek(0, os.SEEK_END) - _TAIL, 0))
    if not head.startswith(START) or head[12:16] != b"IHDR" or b"IEND" not in stream.read():
        return None
    at = len(START)
    while at + 8 <= len(head):
        length, kind = struct.unpack(">I4s", head[at : at + 8])
        if kind == b"IDAT":
            return stated_size(head)
        if kind == b"eXIf":
            return None
        at += length + 12
    return None


def stated_size(data: bytes) -> tuple[int, int]:
    """Gives `(height, width)` of the first chunk."""
    width, height = struct.unpack(">II", data[16:24])
    return height, width


def is_complete(data: bytes) -> bool:
    """Gives whether the last chunk is there."""
    return data.rfind(b"IEND") > 24


def has_alpha(data: bytes) -> bool:
    """Gives whether pixels can be transparent: by the color type, or by a chunk before the pixels."""
    first_pixels = data.find(b"IDAT")
    return data[25] in (4, 6) or 0 < data.find(b"tRNS", 33) < first_pixels


__all__ = ["START", "has_alpha", "is_complete", "read_size", "stated_size"]
