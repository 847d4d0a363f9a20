"""Another header in a model file, byte for byte the same network; no torch, onnx or OpenVINO is needed."""

from __future__ import annotations

import json
import re
from pathlib import Path
from xml.sax.saxutils import quoteattr

from yolino.header import Header
from yolino.inference.engine import METADATA_KEY

_ENTRIES, _KEY, _VALUE = 14, 1, 2  # fields of ModelProto and StringStringEntryProto in onnx.proto
_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5
_SIZES = {_FIXED64: 8, _FIXED32: 4}
_ALIGNED = 8  # safetensors: the weights begin at a multiple of so many bytes
_IN_XML = re.compile(rb'(<%b>\s*<header value=)"[^"]*"' % METADATA_KEY.encode())


def with_header(path: Path, header: Header) -> bytes:
    """Gives the content of a model file, with another header.

    Args:
        path: An .onnx, .safetensors or .xml file; the .bin beside an .xml file has no header and stays.
        header: The new header.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It is no model file, or has no header.
    """
    kinds = {".onnx": _onnx, ".safetensors": _safetensors, ".xml": _xml}
    if path.suffix.lower() not in kinds:
        raise ValueError(f"The model {path} is of no kind whose header can be written: {', '.join(kinds)}.")
    try:
        return kinds[path.suffix.lower()](path.read_bytes(), header.to_json())
    except (ValueError, KeyError, IndexError) as error:
        raise ValueError(f"{path} is damaged, or is no model of yolino with a header.") from error


def _safetensors(data: bytes, text: str) -> bytes:
    """A length in 8 bytes, so many bytes of JSON, the weights at offsets from there."""
    end = 8 + int.from_bytes(data[:8], "little")
    document = json.loads(data[8:end])
    if METADATA_KEY not in document["__metadata__"]:
        raise ValueError("no header")
    document["__metadata__"][METADATA_KEY] = text
    head = json.dumps(document, ensure_ascii=False, separators=(",", ":")).encode()
    head += b" " * (-len(head) % _ALIGNED)
    return len(head).to_bytes(8, "little") + head + data[end:]


def _xml(data: bytes, text: str) -> bytes:
    value = quoteattr(text, {'"': "&quot;"}).encode()
    made, count = _IN_XML.subn(lambda match: match[1] + value, data)
    if count != 1:
        raise ValueError("no header")
    return made


def _onnx(data: bytes, text: str) -> bytes:
    """Fields one after the other; the one with the header is left out and written again at the end."""
    parts, at, found = [], 0, False
    while at < len(data):
        start = at
        number, body, at = _field(data, at)
        if number == _ENTRIES and _entry_key(data[body:at]) == METADATA_KEY:
            found = True
        else:
            parts.append(data[start:at])
    if not found or at != len(data):
        raise ValueError("no header")
    entry = _text_field(_KEY, METADATA_KEY.encode()) + _text_field(_VALUE, text.encode())
    return b"".join([*parts, _text_field(_ENTRIES, entry)])


def _entry_key(entry: bytes) -> str:
    at = 0
    while at < len(entry):
        number, body, at = _field(entry, at)
        if number == _KEY:
            return entry[body:at].decode()
    return ""


def _field(data: bytes, at: int) -> tuple[int, int, int]:
    """Gives the number of the field at a place, where its content begins, and where it ends."""
    key, at = _read_varint(data, at)
    kind = key & 7
    if kind == _VARINT:
        return key >> 3, at, _read_varint(data, at)[1]
    size = _SIZES.get(kind, -1)
    if kind == _BYTES:
        size, at = _read_varint(data, at)
    if size < 0 or at + size > len(data):
        raise ValueError("no such field")
    return key >> 3, at, at + size


def _read_varint(data: bytes, at: int) -> tuple[int, int]:
    """Gives an integer, seven bits in each byte, the lowest first, and where it ends."""
    value = shift = 0
    while True:
        byte = data[at]
        value |= (byte & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if byte < 0x80:
            return value, at


def _text_field(number: int, content: bytes) -> bytes:
    return _varint(number << 3 | _BYTES) + _varint(len(content)) + content


def _varint(value: int) -> bytes:
    made = bytearray()
    while value >= 0x80:
        made.append(value & 0x7F | 0x80)
        value >>= 7
    made.append(value)
    return bytes(made)


__all__ = ["with_header"]
