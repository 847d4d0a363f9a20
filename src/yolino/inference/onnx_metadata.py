"""The metadata of an ONNX file, without loading its network.

An ONNX file is a message of Protocol Buffers: fields, each a key (number and kind of the field) and a value.
The network is one field, which is skipped by its length; each entry of the metadata is another.
"""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

_ENTRIES, _KEY, _VALUE = 14, 1, 2  # fields of ModelProto and StringStringEntryProto in onnx.proto
_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5
_LONGEST = 10  # bytes of a varint


def read_onnx_metadata(path: Path) -> dict[str, str]:
    """Gives the metadata of an ONNX file; none if it is damaged: its engine says how."""
    found: dict[str, str] = {}
    try:
        with open(path, "rb") as file:
            end = path.stat().st_size
            while file.tell() < end:
                number, content = _read_field(file, end)
                if number == _ENTRIES and content is not None:
                    key, value = _parse_entry(file, content)
                    found[key] = value
    except ValueError:
        return {}
    return found


def _read_field(file: BinaryIO, end: int) -> tuple[int, tuple[int, int] | None]:
    """Gives the number of the next field, and where its bytes begin and end if it has any; skips it."""
    key = _read_varint(file)
    number, kind = key >> 3, key & 7
    if kind == _VARINT:
        _read_varint(file)
        return number, None
    sizes = {_FIXED64: 8, _FIXED32: 4}
    size = _read_varint(file) if kind == _BYTES else sizes.get(kind, -1)
    start = file.tell()
    if size < 0 or start + size > end:
        raise ValueError("no such field")
    file.seek(start + size)
    return number, (start, start + size) if kind == _BYTES else None


def _parse_entry(file: BinaryIO, content: tuple[int, int]) -> tuple[str, str]:
    """Gives key and value of an entry; the file is behind it then."""
    texts = {_KEY: "", _VALUE: ""}
    file.seek(content[0])
    while file.tell() < content[1]:
        number, place = _read_field(file, content[1])
        if number in texts and place is not None:
            file.seek(place[0])
            texts[number] = file.read(place[1] - place[0]).decode()
    return texts[_KEY], texts[_VALUE]


def _read_varint(file: BinaryIO) -> int:
    """Gives an integer: seven bits in each byte, the lowest first; the eighth says that more follow."""
    value = 0
    for i in range(_LONGEST):
        byte = file.read(1)
        if not byte:
            break
        value |= (byte[0] & 0x7F) << (7 * i)
        if byte[0] < 0x80:
            return value
    raise ValueError("no integer")


__all__ = ["read_onnx_metadata"]
