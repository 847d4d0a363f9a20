"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Model = Annotated[
    str, typer.Option("--model", "-m", metavar="default|PATH", help="A packaged model, or a model file.")
]
Device = Annotated[str, typer.Option("--device", metavar="auto|cpu|cuda", help="Where the network runs.")]
Engine = Annotated[
    str,
    typer.Option(
        "--engine",
        metavar="NAME",
        help="What runs the network: auto, onnxruntime, openvino, torch or torch-compiled.",
    ),
]
Precision = Annotated[
    str,
    typer.Option(
        "--precision",
        metavar="NAME",
        help="Arithmetic of the network: auto (as the file), fp32, bf16, fp16 or int8.",
    ),
]
Threshold = Annotated[
    float | None,
    typer.Option(
        "--threshold", "-t", min=0, max=1, help="Lowest score of a segment.", show_default="the model's"
    ),
]
Groups = Annotated[
    str,
    typer.Option(
        "--groups",
        metavar="auto|image|folder|N|regex:...",
        help="What is drawn for the intervals: images, clips (auto), folders, or their first N.",
    ),
]
Flip = Annotated[
    bool | None,
    typer.Option(
        "--flip/--no-flip",
        help="See the mirrored image, too: often better lines, in twice the time.",
        show_default="the model's",
    ),
]
Data = Annotated[
    Path | None,
    typer.Option("--data", metavar="data.yaml|DIR", help="A dataset: its description, or its folder."),
]
Split = Annotated[
    str | None, typer.Option("--split", metavar="NAME", help="Split of --data.", show_default="everything")
]
DatasetName = Annotated[
    str | None,
    typer.Option(
        "--dataset",
        metavar="FORMAT",
        help="Without --data: format of the labels.",
        show_default="tusimple",
    ),
]
SkipBroken = Annotated[
    bool, typer.Option("--skip-broken", help="Leave out what cannot be read, say how much, and go on.")
]
Root = Annotated[Path | None, typer.Option("--root", metavar="DIR", help="Folder of the dataset.")]
Labels = Annotated[
    list[Path] | None,
    typer.Option("--labels", metavar="FILE", help="Label file, absolute or below the root; may be repeated."),
]
More = Annotated[
    list[str] | None,
    typer.Option("--option", "-O", metavar="KEY=VALUE", help="Argument of the dataset; may be repeated."),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else on stdout.")]


def drawn_for_intervals(groups: str) -> str:
    """Gives what `--groups` draws, in words."""
    known = {"image": "images", "auto": "clips", "folder": "whole folders of images"}
    return known.get(groups, f"groups of images ({groups})")


__all__ = [
    "AsJson",
    "Data",
    "DatasetName",
    "Device",
    "Engine",
    "Flip",
    "Groups",
    "Labels",
    "Model",
    "More",
    "Precision",
    "Root",
    "SkipBroken",
    "Split",
    "Threshold",
    "drawn_for_intervals",
]
