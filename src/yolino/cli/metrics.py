"""Metrics as the command line names them."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from yolino.metrics import Metric

Radius = Annotated[
    float | None,
    typer.Option("--radius", min=0, metavar="PIXELS", help="The metric's radius.", show_default="its own"),
]
Undirected = Annotated[
    bool, typer.Option("--undirected", help="A line in the opposite direction is the same line.")
]
MetricOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Argument of the metric; may be repeated."),
]


def build_metric(
    name: str,
    offered: Mapping[str, Any],
    options: Sequence[str] = (),
    *,
    wanted: Mapping[str, Any] | None = None,
) -> Metric:
    """Gives the metric `name`.

    Args:
        name: A name in `METRICS`.
        offered: Arguments that are left out where the metric does not take them, or where they are None.
        options: Further arguments, `key=value`.
        wanted: Arguments that the user has named (if not None) and that the metric must take; a `radius` is
            the one threshold of a metric that has thresholds.

    Raises:
        ValueError: The metric is unknown, or an argument does not fit it.
    """
    from yolino.metrics import METRICS

    if name not in METRICS:
        raise ValueError(f"The metric {name!r} is unknown; use one of {', '.join(METRICS)}.")
    known = inspect.signature(METRICS[name]).parameters
    arguments = {key: value for key, value in offered.items() if key in known and value is not None}
    for key, value in (wanted or {}).items():
        if value is None:
            continue
        if key == "radius" and key not in known and "thresholds" in known:
            arguments["thresholds"] = [value]
        elif key in known:
            arguments[key] = value
        else:
            raise ValueError(
                f"The metric {name!r} takes no --{key}; it takes {', '.join(known) or 'nothing'}."
            )
    for option in options:
        key, equals, value = option.partition("=")
        if not equals or key not in known:
            raise ValueError(
                f"--set {option!r} does not fit the metric {name!r}; it takes KEY=VALUE with "
                f"{', '.join(known) or 'no key'}."
            )
        arguments[key] = _value(value)
    try:
        return METRICS[name](**arguments)
    except TypeError as error:
        raise ValueError(f"--set does not fit the metric {name!r}: {error}.") from error


def _value(text: str) -> Any:
    """Reads a value as YAML, and what YAML 1.1 takes for a text though it is a number (1e-9, nan)."""
    import yaml

    value = yaml.safe_load(text)
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


__all__ = ["MetricOption", "Radius", "Undirected", "build_metric"]
