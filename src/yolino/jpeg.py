"""What a JPEG says of itself without being decoded: its size, its orientation, whether its end is there."""

from __future__ import annotations

import os
import struct
from io import BufferedIOBase
from typing import NamedTuple

START = b"\xff\xd8\xff"

_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_SCAN, _APP1, _ORIENTATION = 0xDA, 0xE1, 0x0112
_TAIL = 4096  # bytes: what stands behind the end mark is rarely longer


class Header(NamedTuple):
    """Height and width as stored, and the EXIF orientation: 1 to 8, transposed from 5 on."""

    height: int
    width: int
    orientation: int

    @property
    def size(self) -> tuple[int, int]:
        """`(height, width)` after the rotation that the orientation asks for."""
        return (self.width, self.height) if self.orientation >= 5 else (self.height, self.width)


def read_header(stream: BufferedIOBase) -> Header | None:
    """Gives the header of a JPEG; None if the stream holds no JPEG or its header is broken."""
    if stream.read(2) != START[:2]:
        return None
    orientation = 1
    while True:
        head = stream.read(4)
        if len(head) < 4 or head[0] != 0xFF:
            return None
        marker, length = head[1], int.from_bytes(head[2:], "big")
        if marker == 0xFF:  # padding
            stream.seek(-3, os.SEEK_CUR)
        elif length < 2:
            return None
        elif marker in _FRAMES:
            frame = stream.read(5)
            if len(frame) < 5:
                return None
            _, height, width = struct.unpack(">BHH", frame)
            return Header(height, width, orientation) if height and width else None
        elif marker == _APP1:
            orientation = _exif_orientation(stream.read(length - 2)) or orientation
        else:
            stream.seek(length - 2, os.SEEK_CUR)


def is_complete(data: bytes) -> bool:
    """Tells whether the end mark is there; thumbnails have one too, so it must follow the first scan."""
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if marker == _SCAN:
            return data.rfind(b"\xff\xd9") > at
        at += 1 if marker == 0xFF else 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return False


def ends_whole(stream: BufferedIOBase) -> bool:
    """Tells whether the end mark is near the end of the file, as it is unless the file is cut."""
    stream.seek(max(stream.seek(0, os.SEEK_END) - _TAIL, 0))
    return b"\xff\xd9" in stream.read()


def _exif_orientation(exif: bytes) -> int | None:
    """Gives the orientation that an APP1 segment states, or None."""
    if exif[:6] != b"Exif\0\0" or exif[6:8] not in (b"II", b"MM"):
        return None
    order = "<" if exif[6:8] == b"II" else ">"
    tiff = exif[6:]
    try:
        (start,) = struct.unpack_from(order + "I", tiff, 4)
        (count,) = struct.unpack_from(order + "H", tiff, start)
        for entry in range(count):
            tag, _, _, value = struct.unpack_from(order + "HHIH", tiff, start + 2 + 12 * entry)
            if tag == _ORIENTATION:
                return int(value) if 1 <= value <= 8 else None
    except struct.error:
        pass  # a broken EXIF block states nothing
    return None
