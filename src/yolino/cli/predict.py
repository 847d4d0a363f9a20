"""`yolino predict`: images in, polylines as JSON and pictures out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from yolino.cli.options import Device, Model, Threshold

EPILOG = """
**Examples**

- `yolino predict photo.jpg` writes yolino-out/photo.json and yolino-out/photo.png

- `yolino predict drive/ "extra/*.png" --out found --no-images` goes through a folder and a glob

- `yolino predict clips/ --format tusimple` writes predictions.json as the TuSimple benchmark wants it

- `yolino predict photos/ --format cvat` writes annotations.xml, for a person to correct in the labeling tool
"""


def add_to(app: typer.Typer) -> None:
    """Adds the command."""
    app.command(epilog=EPILOG)(predict)


def predict(
    sources: Annotated[
        list[str], typer.Argument(metavar="SOURCE", help="Images, folders, or globs in quotation marks.")
    ],
    *,
    model: Model = "default",
    threshold: Threshold = None,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for the results.")] = Path(
        "yolino-out"
    ),
    format: Annotated[
        str,
        typer.Option("--format", "-f", metavar="NAME", help="json, tusimple, cvat, geojson, ..."),
    ] = "json",
    device: Device = "auto",
    images: Annotated[
        bool, typer.Option("--images/--no-images", help="Whether to write pictures with the lines drawn.")
    ] = True,
) -> None:
    """Find the polylines in images; write a JSON file and a picture for each."""
    from yolino.cli.results import Found, ResultWriter, UnreadableError, predict_one, rows, summary
    from yolino.cli.screen import busy, print_table, report_problems, track
    from yolino.cli.sources import find_images, result_names
    from yolino.inference import load

    writer = ResultWriter(out, format, pictures=images)
    paths, problems = find_images(sources, excluded=out)
    names = result_names(paths)
    writer.refuse_overwriting(paths, names)
    with busy("loading the model (once after an installation, kernels are compiled: up to a minute)"):
        predictor = load(model, device=device, threshold=threshold)
        predictor.warm_up()
    found: list[Found] = []
    with report_problems(problems):
        try:
            for path, name in track(list(zip(paths, names, strict=True)), "predicting"):
                try:
                    found.append(predict_one(predictor, path, name, writer))
                except UnreadableError as error:
                    problems.append(str(error))
        finally:  # whoever stops it keeps what was found
            if found:
                writer.finish(found)
        if found:
            print_table(("image", "polylines", "ms"), rows(found))
            typer.echo(summary(found, out))
