"""`yolino datasets`: its commands `show` and `deviation`; the others have a file each."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from yolino.cli import checking, conversion, splitting
from yolino.cli.frames import Fit, Size, Strides, frame_arguments
from yolino.cli.options import Data, DatasetName, Labels, More, Root, SkipBroken, Split

EPILOG = """
**Examples**

- `yolino datasets check --data drive.yaml` looks for mistakes in labels, images and splits, and counts

- `yolino datasets show --root data/tusimple --labels label_data_0531.json --out labels.png` draws some labels

- `yolino datasets deviation --root data/tusimple` measures what the cells of each size cost

- `yolino datasets split --data drive --shares train=0.8,val=0.2 --out splits` splits by clips or drives
"""


def add_to(app: typer.Typer) -> None:
    """Adds the group of commands."""
    group = typer.Typer(
        help="Look at labelled data, convert or split it.", no_args_is_help=True, epilog=EPILOG
    )
    checking.add_to(group)
    for command in (show, deviation):
        group.command(epilog=EPILOG)(command)
    conversion.add_to(group)
    splitting.add_to(group)
    app.add_typer(group, name="datasets")


def show(
    *,
    data: Data = None,
    split: Split = None,
    dataset: DatasetName = None,
    root: Root = None,
    labels: Labels = None,
    option: More = None,
    skip_broken: SkipBroken = False,
    count: Annotated[int, typer.Option("--count", min=1, help="Number of images, spread evenly.")] = 9,
    columns: Annotated[int, typer.Option("--columns", min=1, help="Images in a row.")] = 3,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="Picture to write.")] = Path(
        "dataset.png"
    ),
) -> None:
    """Draw the labels of some images on one sheet, colored by class."""
    import numpy as np

    from yolino.cli.labels import Selection, open_or_tell
    from yolino.cli.screen import track
    from yolino.datasets import FileDataset
    from yolino.io import read_image, write_image
    from yolino.viz import contact_sheet, draw_legend, draw_polylines, draw_regions

    samples = open_or_tell(Selection(data, split, dataset, root, labels or (), option or (), skip_broken))
    if len(samples) == 0:
        raise ValueError("The dataset has no samples: check the root and the label files.")
    originals = samples.image_paths if out.exists() and isinstance(samples, FileDataset) else ()
    if out.resolve() in {path.resolve() for path in originals}:
        raise ValueError(f"--out {out} would replace an image of the dataset: give another name.")
    chosen = np.unique(
        np.linspace(0, len(samples) - 1, min(count, len(samples))).round().astype(int)
    ).tolist()
    pictures, titles = [], []
    for index in track(chosen, "drawing"):
        sample = samples[index]
        image = read_image(sample.image) if isinstance(sample.image, Path) else sample.image
        color_by = "label" if len(samples.classes) > 1 else "identity"
        shaded = draw_regions(image, sample.ignore)
        drawn = draw_polylines(shaded, sample.polylines, color_by=color_by, directed=samples.directed)
        pictures.append(draw_legend(drawn, samples.classes) if len(samples.classes) > 1 else drawn)
        titles.append(sample.name)
    write_image(out, contact_sheet(pictures, titles, columns=columns))
    typer.echo(f"{len(pictures)} of {len(samples)} images are drawn in {out}.")


def deviation(
    *,
    data: Data = None,
    split: Split = None,
    dataset: DatasetName = None,
    root: Root = None,
    labels: Labels = None,
    option: More = None,
    skip_broken: SkipBroken = False,
    stride: Strides = [32, 16, 8],  # noqa: B006 (typer reads it, nobody changes it)
    size: Size = None,
    fit: Fit = "bottom",
) -> None:
    """Measure how far labels move when they are cut into cells, in pixels (the paper's slicing errors)."""
    from yolino.cli.labels import Selection, open_or_tell
    from yolino.cli.screen import print_table, track
    from yolino.datasets.check import deviation_table

    samples = open_or_tell(Selection(data, split, dataset, root, labels or (), option or (), skip_broken))
    table = deviation_table(
        samples, stride, progress=lambda indices: track(indices, "measuring"), **frame_arguments(size, fit)
    )
    rows = [(r.stride, f"{r.border_px:.3f}", f"{r.points_px:.3f}", r.segments, r.lost) for r in table]
    print_table(("stride", "border to border px", "loose ends px", "segments", "lost polylines"), rows)
