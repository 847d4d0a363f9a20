"""The header of a model file: everything that is needed to run it, and where it comes from.

A checkpoint and an exported network carry the same header, so that a model file needs nothing beside it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

FITS = ("bottom", "stretch", "letterbox", "window")
PRECISIONS = ("fp32", "fp16", "int8")


@dataclass(frozen=True)
class Header:
    """What a model file says about itself.

    Attributes:
        version: Version of the package that wrote the file.
        name: Name of the model, as shown to users.
        size: Input of the network in pixels, (height, width); for the fit "window" that of one window.
        stride: Edge of a cell in pixels of the network's input.
        predictors: Predictors per cell (the paper's P).
        representation: Name of the line representation the network was trained with.
        classes: Names of the classes, in the order of the labels; empty where the model knows none.
        directed: Whether the direction of a line means something.
        fit: How an image is fitted to the input: "bottom", "stretch" or "letterbox"; "window": it is not, the
            network goes over an image of any size in windows.
        scale: Pixels of the network's input per pixel of the image, for the fit "window".
        licence: Licence of the training data, and thereby of the weights.
        data: What the model was trained on.
        postprocess: `threshold` (a score), `nms` (arguments of `NMS`), `linker` (a name in `LINKERS`),
            `linker_options` (its arguments), `rotations` (1, 2 or 4: how many turned views of a window the
            network sees) and `flip` (whether it also sees the mirrored image, for the other fits). What is
            absent has the constructor's default.
        metrics: Validation numbers.
        commit: Git commit of the code that trained the model.
        precision: How the file's weights are: "fp32", "fp16" (stored with 16 bits) or "int8" (quantized).
    """

    version: str
    name: str
    size: tuple[int, int]
    stride: int
    predictors: int
    representation: str
    classes: tuple[str, ...] = ()
    directed: bool = True
    fit: str = "bottom"
    scale: float = 1.0
    licence: str = "unknown"
    data: str = "unknown"
    postprocess: Mapping[str, Any] = field(default_factory=dict)
    metrics: Mapping[str, Any] = field(default_factory=dict)
    commit: str = "unknown"
    precision: str = "fp32"

    def __post_init__(self) -> None:
        if any(edge <= 0 or edge % self.stride for edge in self.size):
            raise ValueError(
                f"The header's size {list(self.size)} must be divisible by the stride {self.stride}."
            )
        if self.fit not in FITS:
            raise ValueError(f"The header's fit is {self.fit!r}, but must be one of {', '.join(FITS)}.")
        if self.precision not in PRECISIONS:
            raise ValueError(
                f"The header's precision is {self.precision!r}, but must be one of {', '.join(PRECISIONS)}."
            )
        if self.scale != 1 and self.fit != "window":
            raise ValueError(f'The header\'s scale is {self.scale}, but only the fit "window" has a scale.')
        unknown = sorted(set(self.postprocess) - set(_POSTPROCESS))
        if unknown:
            raise ValueError(
                f"The header's postprocess has the unknown keys {', '.join(unknown)}; "
                f"allowed are {', '.join(_POSTPROCESS)}."
            )
        _check_types(self.postprocess, _POSTPROCESS, "postprocess.")

    def to_json(self) -> str:
        """Gives the header as one JSON object."""
        return json.dumps(asdict(self), ensure_ascii=False, allow_nan=False)

    @classmethod
    def from_json(cls, text: str) -> Header:
        """Gives the header that `text` holds.

        Raises:
            ValueError: If `text` is not a JSON object, lacks a key, has an unknown key or a value of a wrong
                type; the message names the keys.
        """
        try:
            values = json.loads(text)
        except ValueError as error:
            raise ValueError(f"The header is not JSON: {error}.") from error
        if not isinstance(values, dict):
            raise ValueError(f"The header must be one JSON object, but is a {type(values).__name__}.")
        known = {f.name for f in fields(cls)}
        missing, unknown = sorted(known - _NEWER - set(values)), sorted(set(values) - known)
        found = (("lacks", missing), ("has the unknown", unknown))
        if parts := [f"{verb} {', '.join(keys)}" for verb, keys in found if keys]:
            raise ValueError(
                f"The header {' and '.join(parts)}: the model was written by another version of yolino "
                f"({values.get('version', 'unknown')})."
            )
        _check_types(values, _TYPES)
        values |= {"size": tuple(values["size"]), "classes": tuple(values["classes"])}
        return cls(**{**values, "scale": float(values.get("scale", 1.0))})


_NEWER = {"precision", "scale"}  # keys that the files of earlier versions lack; their defaults hold


def _is_text(value: object) -> bool:
    return isinstance(value, str)


def _is_flag(value: object) -> bool:
    return isinstance(value, bool)


def _is_object(value: object) -> bool:
    return isinstance(value, Mapping)


def _is_score(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value <= 1


def _is_count(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value > 0


def _is_rotations(value: object) -> bool:
    return value in (1, 2, 4) and _is_count(value)


def _is_scale(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 < value <= 16


def _is_size(value: object) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(map(_is_count, value))


def _is_names(value: object) -> bool:
    return isinstance(value, list) and all(map(_is_text, value))


_Checks = Mapping[str, tuple[Callable[[object], bool], str]]
_TEXT = (_is_text, "a text")
_OBJECT = (_is_object, "an object")
_COUNT = (_is_count, "a positive integer")
_TYPES: _Checks = {
    "size": (_is_size, "two positive integers (height, width)"),
    "stride": _COUNT,
    "scale": (_is_scale, "a number above 0 and at most 16"),
    "predictors": _COUNT,
    "classes": (_is_names, "a list of names"),
    "directed": (_is_flag, "true or false"),
    "postprocess": _OBJECT,
    "metrics": _OBJECT,
}
_POSTPROCESS: _Checks = {
    "flip": (_is_flag, "true or false"),
    "rotations": (_is_rotations, "1, 2 or 4"),
    "threshold": (_is_score, "a number from 0 to 1"),
    "nms": _OBJECT,
    "linker": _TEXT,
    "linker_options": _OBJECT,
}


def _check_types(values: Mapping[str, object], checks: _Checks, prefix: str = "") -> None:
    for name, value in values.items():
        valid, wanted = checks.get(name, _TEXT)
        if not valid(value):
            raise ValueError(f"The header's {prefix}{name} is {value!r}, but must be {wanted}.")


__all__ = ["FITS", "PRECISIONS", "Header"]
