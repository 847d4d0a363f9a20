"""`yolino datasets check | show | deviation`: what is in a dataset, and whether it is sound.

`convert` and `split`, which write datasets, are in `yolino.cli.conversion`.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from yolino.cli import conversion
from yolino.cli.options import Data, DatasetName, Labels, More, Root, SkipBroken, Split

if TYPE_CHECKING:
    from yolino.datasets.report import Report

EPILOG = """
**Examples**

- `yolino datasets check --root data/tusimple` looks for mistakes in labels and images, and counts

- `yolino datasets show --root data/tusimple --labels label_data_0531.json --out labels.png` draws some labels

- `yolino datasets deviation --root data/tusimple` measures what the cells of each size cost
"""
Strides = Annotated[
    list[int], typer.Option("--stride", min=1, metavar="PIXELS", help="Edge of the cells; may be repeated.")
]
Size = Annotated[
    tuple[int, int] | None,
    typer.Option(
        "--size", metavar="HEIGHT WIDTH", help="Input of the network.", show_default="the image's size"
    ),
]
Fit = Annotated[
    str, typer.Option("--fit", metavar="bottom|stretch|letterbox", help="How images are fitted to the input.")
]


def add_to(app: typer.Typer) -> None:
    """Adds the group of commands."""
    group = typer.Typer(
        help="Look at labelled data, convert or split it.", no_args_is_help=True, epilog=EPILOG
    )
    for command in (check, show, deviation):
        group.command(epilog=EPILOG)(command)
    conversion.add_to(group)
    app.add_typer(group, name="datasets")


def check(
    *,
    data: Data = None,
    split: Split = None,
    dataset: DatasetName = None,
    root: Root = None,
    labels: Labels = None,
    option: More = None,
    stride: Strides = [32, 16, 8],  # noqa: B006 (typer reads it, nobody changes it)
    predictors: Annotated[int, typer.Option("--predictors", min=1, help="Predictors per cell.")] = 8,
    size: Size = None,
    fit: Fit = "bottom",
) -> None:
    """Look for mistakes in images and labels, and count; exit code 2 if training would not survive them."""
    from yolino.cli.labels import Selection, open_dataset
    from yolino.cli.screen import counted, report_problems, track
    from yolino.datasets.check import check as run

    chosen = Selection(data, split, dataset, root, labels or (), option or ())
    samples = open_dataset(chosen, lenient=True, progress=counted("reading"))
    frame = _frame(size, fit)
    report = run(samples, stride, predictors, progress=lambda indices: track(indices, "checking"), **frame)
    _print_report(report)
    errors = report.errors
    with report_problems([f"{one.sample}: {one.kind}, {one.detail}" for one in errors[:20]]):
        if len(errors) > 20:
            typer.echo(f"{len(errors)} errors, the first 20 below.", err=True)


def _print_report(report: Report) -> None:
    from yolino.cli.screen import print_table
    from yolino.datasets.report import ERRORS, KINDS

    sizes = ", ".join(f"{height}x{width} ({count})" for (height, width), count in report.sizes.items())
    rows: list[tuple[str, object]] = [
        ("samples", report.samples),
        ("polylines", report.polylines),
        ("vertices", report.vertices),
        ("sizes, height x width (images)", sizes or "none"),
    ]
    rows += [(f"polylines of class {name}", count) for name, count in report.class_counts.items()]
    print_table(("what", "count"), rows)
    header = ("stride", "predictors", "segments", "cells", "fullest cell", "surplus segments")
    cells = [(o.stride, o.predictors, o.segments, o.cells, o.fullest, o.surplus) for o in report.occupancy]
    print_table(header, cells, title="Cells")
    if report.counts:
        found = [
            (kind, "error" if kind in ERRORS else "notice", KINDS[kind], count)
            for kind, count in report.counts.items()
        ]
        print_table(("finding", "weight", "meaning", "count"), found, title="Findings")
    else:
        typer.echo("Nothing is wrong.")


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
    from yolino.io import read_image, write_image
    from yolino.viz import contact_sheet, draw_polylines

    samples = open_or_tell(Selection(data, split, dataset, root, labels or (), option or (), skip_broken))
    if len(samples) == 0:
        raise ValueError("The dataset has no samples: check the root and the label files.")
    chosen = np.unique(
        np.linspace(0, len(samples) - 1, min(count, len(samples))).round().astype(int)
    ).tolist()
    pictures, titles = [], []
    for index in track(chosen, "drawing"):
        sample = samples[index]
        image = read_image(sample.image) if isinstance(sample.image, Path) else sample.image
        color_by = "label" if len(samples.classes) > 1 else "identity"
        pictures.append(draw_polylines(image, sample.polylines, color_by=color_by, directed=samples.directed))
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
        samples, stride, progress=lambda indices: track(indices, "measuring"), **_frame(size, fit)
    )
    rows = [(r.stride, f"{r.border_px:.3f}", f"{r.points_px:.3f}", r.segments, r.lost) for r in table]
    print_table(("stride", "border to border px", "loose ends px", "segments", "lost polylines"), rows)


def _frame(size: tuple[int, int] | None, fit: str) -> dict[str, Any]:
    """Gives the arguments that say in which frame cells are cut."""
    if size is None:
        return {}
    from yolino.geometry import fit_matrix

    fit_matrix((1, 1), size, fit)  # says now what is wrong with them
    return {"size": size, "matrix": lambda image: fit_matrix(image, size, fit)}
