from __future__ import annotations

import dataclasses
import json

import pytest

from yolino.header import Header


def test_a_header_survives_json(header: Header) -> None:
    full = dataclasses.replace(header, classes=("a", "ü"), directed=False, fit="letterbox")
    assert Header.from_json(full.to_json()) == full


def test_files_from_before_there_were_precisions_have_32_bits(header: Header) -> None:
    values = json.loads(dataclasses.replace(header, precision="int8").to_json())
    assert Header.from_json(json.dumps(values)).precision == "int8"
    del values["precision"]
    assert Header.from_json(json.dumps(values)).precision == "fp32"


def test_lists_become_tuples(header: Header) -> None:
    again = Header.from_json(header.to_json())
    assert isinstance(again.size, tuple)
    assert isinstance(again.classes, tuple)


def test_missing_and_unknown_keys_are_named(header: Header) -> None:
    values = json.loads(header.to_json())
    del values["stride"], values["fit"]
    values["strides"] = 16
    with pytest.raises(ValueError, match=r"lacks fit, stride and has the unknown strides.*0\.1\.0"):
        Header.from_json(json.dumps(values))


@pytest.mark.parametrize("text", ["", "{", "[1]", "3", "null"])
def test_what_is_no_object_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="The header"):
        Header.from_json(text)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("size", [64]),
        ("size", [64, "128"]),
        ("size", [64, 120]),
        ("stride", 0),
        ("stride", True),
        ("stride", 16.0),
        ("predictors", -1),
        ("classes", "lane"),
        ("classes", [1]),
        ("directed", 1),
        ("fit", "top"),
        ("precision", "int4"),
        ("precision", 16),
        ("name", None),
        ("postprocess", []),
        ("postprocess", {"treshold": 0.5}),
        ("postprocess", {"threshold": "high"}),
        ("postprocess", {"threshold": 2}),
        ("postprocess", {"nms": 3}),
        ("postprocess", {"linker": None}),
        ("metrics", "good"),
    ],
)
def test_wrong_values_are_named(header: Header, key: str, value: object) -> None:
    values = json.loads(header.to_json()) | {key: value}
    with pytest.raises(ValueError, match=f"The header's {key}"):
        Header.from_json(json.dumps(values))


def test_a_file_of_an_earlier_version_has_the_scale_one(header: Header) -> None:
    values = json.loads(header.to_json())
    del values["scale"]
    assert Header.from_json(json.dumps(values)).scale == 1.0


@pytest.mark.parametrize("scale", [0, -1, 17, True, "half"])
def test_a_scale_that_is_none_is_refused(header: Header, scale: object) -> None:
    values = json.loads(header.to_json()) | {"fit": "window", "scale": scale}
    with pytest.raises(ValueError, match="scale"):
        Header.from_json(json.dumps(values))


def test_only_windows_have_a_scale(header: Header) -> None:
    with pytest.raises(ValueError, match="only the fit"):
        dataclasses.replace(header, fit="stretch", scale=0.5)
    assert dataclasses.replace(header, fit="window", scale=0.5).scale == 0.5
