"""`yolino predict`: images, videos, or one whole scene, in; polylines out, as files and pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from yolino.cli.options import Device, Engine, Flip, Model, Precision, Threshold

EPILOG = """
**Examples**

- `yolino predict photo.jpg` writes yolino-out/photo.json and yolino-out/photo.png

- `yolino predict drive/ "extra/*.png" --out found --no-images` goes through a folder and a glob

- `yolino predict clips/ --format tusimple` writes predictions.json as the TuSimple benchmark wants it

- `yolino predict photos/ --format cvat` writes annotations.xml, for a person to correct in the labeling tool

- `yolino predict photo.jpg --view stages` shows what each step of the post-processing makes of it

- `yolino predict photos/ --engine openvino --precision bf16` takes half the time on processors that have bf16

- `yolino predict drive.mp4 --out out.mp4` draws the lines into a video; a folder gets JSON lines, too

- `yolino predict camera:0 --smooth` goes on until Ctrl-C, with steady lines

- `yolino predict scene.tif --model aerial.onnx --out lanes.gpkg` goes over a scene of any size, for a GIS
"""


def add_to(app: typer.Typer) -> None:
    """Adds the command."""
    app.command(epilog=EPILOG)(predict)


def predict(
    sources: Annotated[
        list[str],
        typer.Argument(
            metavar="SOURCE", help="Images, folders, globs in quotation marks, videos, camera:0, rtsp://..."
        ),
    ],
    *,
    model: Model = "default",
    threshold: Threshold = None,
    out: Annotated[
        str,  # a path would lose the separator at its end
        typer.Option(
            "--out",
            "-o",
            metavar="DIR|FILE",
            help="Folder for the results; of a whole scene one .gpkg, .geojson, .parquet or .json file.",
        ),
    ] = "yolino-out",
    format: Annotated[
        str,
        typer.Option("--format", "-f", metavar="NAME", help="json, tusimple, cvat, geojson, ..."),
    ] = "json",
    engine: Engine = "auto",
    device: Device = "auto",
    precision: Precision = "auto",
    flip: Flip = None,
    images: Annotated[
        bool | None,
        typer.Option(
            "--images/--no-images",
            help="Whether to write pictures with the lines drawn.",
            show_default="images",
        ),
    ] = None,
    view: Annotated[
        str | None,
        typer.Option(
            "--view",
            metavar="NAME",
            help="Pictures of: lines, orientation, identity, classes, score, cells, segments or stages.",
            show_default="lines",
        ),
    ] = None,
    overlap: Annotated[
        int | None,
        typer.Option(
            "--overlap", metavar="PIXELS", help="Scene: what windows share, in pixels of the network."
        ),
    ] = None,
    bands: Annotated[
        str | None, typer.Option("--bands", metavar="R,G,B", help="Scene: bands to see, like 3,2,1.")
    ] = None,
    scale: Annotated[
        float | None,
        typer.Option(
            "--scale",
            metavar="FACTOR",
            help="Scene: pixels of the network per pixel.",
            show_default="the model's",
        ),
    ] = None,
    follow: Annotated[
        bool | None,
        typer.Option(
            "--track/--no-track", help="Video: whether lines keep an identity.", show_default="track"
        ),
    ] = None,
    smooth: Annotated[
        bool | None,
        typer.Option(
            "--smooth/--no-smooth", help="Video: steady the lines over time.", show_default="no-smooth"
        ),
    ] = None,
    frames: Annotated[
        int | None, typer.Option("--frames", metavar="N", min=1, help="Video: stop after so many frames.")
    ] = None,
) -> None:
    """Find the polylines in images; write a JSON file and a picture for each, or one file for a scene."""
    from yolino.cli.images import predict_images
    from yolino.cli.outputs import check_ending
    from yolino.cli.scenes import Scene, is_scene, predict_scene, refuse_for_videos
    from yolino.cli.video import Video, are_videos, predict_videos
    from yolino.inference import EngineChoice

    choice = EngineChoice(engine, device, precision)
    scene = Scene(overlap=overlap, bands=bands, scale=scale)
    video = Video(follow, smooth, frames)
    videos = are_videos(sources, video)
    if videos:
        refuse_for_videos(scene, sources[0])
    check_ending(out, sources[0], video=videos)
    if videos:
        return predict_videos(
            sources,
            out,
            video,
            model=model,
            threshold=threshold,
            flip=flip,
            choice=choice,
            pictures=images is not False,
            format=format,
            view="lines" if view is None else view,
        )
    if is_scene(out, scene, format, pictures=images, view=view):
        if flip is not None:
            raise ValueError("--flip and --no-flip are for images and videos, not for a scene: leave it out.")
        return predict_scene(sources, Path(out), scene, model=model, threshold=threshold, choice=choice)
    return predict_images(
        sources,
        model=model,
        threshold=threshold,
        flip=flip,
        out=Path(out),
        format=format,
        choice=choice,
        pictures=images is not False,
        view="lines" if view is None else view,
    )
