"""`yolino export`: a checkpoint or an exported model in, a model file out that needs no torch."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from yolino.export import Calibration, Exported

EPILOG = """
**Examples**

- `yolino export runs/tusimple/best.safetensors --out lanes.onnx`

- `yolino predict --model lanes.onnx photo.jpg` uses it

- `yolino export lanes.onnx --format openvino` writes lanes.xml and lanes.bin for OpenVINO; no torch is needed
  for an .onnx file, and `default` is the packaged model

- `yolino export lanes.onnx --precision fp16 --out small.onnx` stores the weights in half the bytes

- `yolino export lanes.onnx --format openvino --precision int8 --calibrate drive.yaml --split train` quantizes
  the network, and refuses if it then finds less on these images

- `yolino export lanes.onnx --set postprocess.threshold=0.4 --out strict.onnx` changes the threshold alone
"""


def add_to(app: typer.Typer) -> None:
    """Adds the command."""
    app.command(epilog=EPILOG)(export)


def export(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help="Checkpoint that `yolino train` wrote, .onnx file, or packaged model ('default').",
        ),
    ],
    *,
    format: Annotated[
        str, typer.Option("--format", "-f", metavar="onnx|openvino", help="Format of the model.")
    ] = "onnx",
    precision: Annotated[
        str | None,
        typer.Option(
            "--precision",
            "-p",
            metavar="fp32|fp16|int8",
            help="How weights are stored: fp16 in half the bytes, int8 quantized, smaller and faster.",
            show_default="fp32, or that of the .onnx file",
        ),
    ] = None,
    calibrate: Annotated[
        Path | None,
        typer.Option(
            "--calibrate",
            metavar="data.yaml|DIR",
            help="For int8: labelled images like those that the model will see.",
        ),
    ] = None,
    split: Annotated[
        str | None,
        typer.Option("--split", metavar="NAME", help="Split of --calibrate.", show_default="everything"),
    ] = None,
    images: Annotated[
        int, typer.Option("--images", min=1, help="Images that are taken evenly from --calibrate.")
    ] = 200,
    max_drop: Annotated[
        float,
        typer.Option(
            "--max-drop", min=0, max=1, help="By how much int8 may lower the F1 of the polylines on them."
        ),
    ] = 0.01,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="Model file.", show_default="beside the source"),
    ] = None,
    changes: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Value of the header to change, e.g. postprocess.threshold=0.3.",
        ),
    ] = None,
) -> None:
    """Export a model as one file with everything inside, for ONNX Runtime or OpenVINO.

    Checkpoints need `pip install 'yolino[train]'`, OpenVINO and int8 `pip install 'yolino[quantize]'`.
    """
    from yolino.cli.screen import track
    from yolino.export import export as run

    if split is not None and calibrate is None:
        raise ValueError("--split is for --calibrate: name the data with it.")
    done = run(
        source,
        format=format,
        precision=precision,
        out=out,
        changes=changes or [],
        calibration=None if calibrate is None else _calibration(calibrate, split, images, max_drop),
        progress=track,
    )
    typer.echo(f"{' and '.join(map(str, done.files))} ({done.size / 1e6:.1f} MB)")
    if calibrate is not None:
        typer.echo(_cost(done, max_drop))


def _calibration(data: Path, split: str | None, images: int, max_drop: float) -> Calibration:
    from yolino.cli.labels import Selection, open_or_tell
    from yolino.export import Calibration

    if not data.exists():
        raise FileNotFoundError(
            f"There is no calibration data {data}: give a data.yaml or a folder of images."
        )
    return Calibration(open_or_tell(Selection(data, split)), images=images, max_drop=max_drop)


def _cost(done: Exported, max_drop: float) -> str:
    """Gives the sentence that says what quantizing cost."""
    found = done.header.metrics["int8"]
    return (
        f"F1 of the polylines on {found['images']} calibration images: {found['f1_before']:.4f} before, "
        f"{found['f1_after']:.4f} after (it may fall by {max_drop:g}). End points moved by "
        f"{found['shift_px']:.2f} px on average."
    )
