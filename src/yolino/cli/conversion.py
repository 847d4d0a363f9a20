"""`yolino datasets convert`: any labels in, any format out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from yolino.cli.options import Data, DatasetName, Labels, More, Root, SkipBroken, Split

EPILOG = """
**Examples**

- `yolino datasets convert --data drive.yaml --to cvat --out drive_cvat`
  writes annotations.xml and links the images

- `yolino datasets convert --dataset labelme --root photos --to coco --out photos_coco --images none`
  writes labels only
"""


def add_to(group: typer.Typer) -> None:
    """Adds the command."""
    group.command(epilog=EPILOG)(convert)


def convert(
    *,
    to: Annotated[str, typer.Option("--to", metavar="FORMAT", help="Format to write.")],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder to write to.")],
    data: Data = None,
    split: Split = None,
    dataset: DatasetName = None,
    root: Root = None,
    labels: Labels = None,
    option: More = None,
    skip_broken: SkipBroken = False,
    images: Annotated[
        str,
        typer.Option(
            "--images",
            metavar="link|copy|none",
            help="Images are linked (copied where the disk cannot), copied, or left where they are.",
        ),
    ] = "link",
    force: Annotated[
        bool, typer.Option("--force", help="Write into a folder that holds labels, and replace them.")
    ] = False,
) -> None:
    """Write a dataset in another format, with its images and a data.yaml."""
    from yolino.cli.labels import Selection, open_or_tell
    from yolino.cli.screen import track
    from yolino.datasets import WRITERS
    from yolino.datasets.convert import convert as run
    from yolino.datasets.description import load_description

    if to not in WRITERS:
        raise ValueError(f"The format {to!r} cannot be written; use one of {', '.join(WRITERS)}.")
    samples = open_or_tell(Selection(data, split, dataset, root, labels or (), option or (), skip_broken))
    facts: dict[str, str] = {}
    if data is not None:
        described = load_description(data)
        given = {"licence": described.licence, "description": described.description}
        facts = {key: value for key, value in given.items() if value != "unknown"}
    run(
        samples,
        to,
        out,
        images=images,
        force=force,
        facts=facts,
        progress=lambda indices: track(indices, "converting"),
    )
    typer.echo(f"{len(samples)} images as {to} -> {out} (its description: {out / 'data.yaml'})")
    if lost := WRITERS[to].loses:
        typer.echo(f"The format {to} does not hold {', '.join(lost)}.", err=True)


__all__ = ["add_to", "convert"]
