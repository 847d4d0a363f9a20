"""What is said about a mistake in a file of keys and values: one sentence with what is allowed."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from pydantic import BaseModel, ValidationError


def _keys_of(model: type[BaseModel], location: Sequence[str | int]) -> list[str]:
    """Gives the allowed keys of the section that holds the unknown key at `location`."""
    for part in location:
        found = model.model_fields.get(part) if isinstance(part, str) else None
        annotation = found.annotation if found else None
        candidates = [annotation, *getattr(annotation, "__args__", ())]
        model = next((c for c in candidates if isinstance(c, type) and issubclass(c, BaseModel)), model)
    return list(model.model_fields)


def explain(error: ValidationError, whole: type[BaseModel]) -> str:
    """Puts the first mistake in a file of the form `whole` into one sentence."""
    # A misspelt key is unknown, and the right one is missing: the first says more.
    mistakes: list[Any] = sorted(error.errors(), key=lambda one: one["type"] != "extra_forbidden")
    mistake: Mapping[str, Any] = mistakes[0]
    location = mistake["loc"]
    key = ".".join(map(str, location))
    if mistake["type"] == "extra_forbidden":
        allowed = _keys_of(whole, location[:-1])
        return (
            f"unknown key {key!r}; {suggest(str(location[-1]), allowed)}Allowed here: {', '.join(allowed)}."
        )
    if mistake["type"] == "missing":
        return f"the key {key!r} is missing."
    said = mistake["msg"].removeprefix("Value error, ")
    return f"{key} is {mistake['input']!r}: {said}." if key else f"{said}."


def suggest(name: str, allowed: Iterable[str]) -> str:
    """Gives `did you mean 'x'? ` for the allowed name nearest to a misspelt one, or nothing."""
    near = difflib.get_close_matches(name, list(allowed), n=1, cutoff=0.5)
    return f"did you mean {near[0]!r}? " if near else ""


def check_keys(section: str, given: Iterable[str], allowed: Iterable[str], *, owner: str = "") -> None:
    """Raises a ValueError that names the first key of `section` that is not allowed, and the nearest one."""
    names = list(allowed)
    for key in given:
        if key not in names:
            raise ValueError(
                f"unknown key '{section}.{key}'{owner and f' of {owner}'}; {suggest(str(key), names)}"
                f"Allowed here: {', '.join(names) or 'none'}."
            )


__all__ = ["check_keys", "explain", "suggest"]
