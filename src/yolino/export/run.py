"""Export: read the source, convert, store or quantize the weights, compare, and only then write."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from yolino.export.calibration import Calibration, Progress
from yolino.export.comparison import compare
from yolino.export.formats import Format
from yolino.export.halves import halved
from yolino.export.onnx_format import OnnxFormat
from yolino.export.openvino_format import OpenVinoFormat
from yolino.export.quantization import quantize
from yolino.export.source import Source, read_source
from yolino.header import PRECISIONS, Header
from yolino.inference import Engine

FORMATS: dict[str, type[Format]] = {"onnx": OnnxFormat, "openvino": OpenVinoFormat}
# Pixels and score: how far the same sums in another order may differ, and what rounding the weights to 16
# bits may change. Beyond, something else is wrong. Of a source that is int8 already, only the header changes.
TOLERANCES = {"fp32": (1e-3, 1e-4), "fp16": (0.1, 0.01), "int8": (1e-3, 1e-4)}


@dataclass(frozen=True)
class Exported:
    """What an export wrote.

    Attributes:
        path: The model file.
        files: All files that belong to it.
        header: Its header; of int8, `metrics["int8"]` has `images`, `engine`, `f1_before`, `f1_after` and
            `shift_px`.
    """

    path: Path
    files: tuple[Path, ...]
    header: Header

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return sum(file.stat().st_size for file in self.files)


def export(
    source: str | Path,
    *,
    format: str = "onnx",
    precision: str | None = None,
    out: str | Path | None = None,
    changes: Sequence[str] = (),
    calibration: Calibration | None = None,
    progress: Progress = lambda indices, title: indices,
) -> Exported:
    """Writes a network as a model file that needs no torch.

    It is run beside its source before it gets its name. End points must agree to 1e-3 px, those of fp16 to
    0.1 px. An int8 network is judged by the F1 of its polylines on the calibration images.

    Args:
        source: A checkpoint of `yolino train` (`.safetensors`, needs torch), an exported `.onnx` file, or the
            name of a packaged model.
        format: A name in `FORMATS`.
        precision: How the weights are stored: "fp32"; "fp16", in half the bytes, computed in what the engine
            is asked for; "int8", quantized, in a quarter of the bytes and faster. By default as in the
            source, fp32 for a checkpoint.
        out: The file to write; beside the source by default, for a packaged model in the working folder.
        changes: `key=value` changes to the header, such as `postprocess.threshold=0.3` after tuning.
        calibration: Labelled images, for int8.
        progress: Wraps the indices of images, to show a progress bar with a title.

    Raises:
        FileNotFoundError: There is no such source.
        ValueError: An argument is not allowed, or int8 lowers the F1 by more than the calibration allows.
        ModuleNotFoundError: A package is not installed.
        RuntimeError: The exported network disagrees with its source.
    """
    if format not in FORMATS:
        raise ValueError(f"format {format!r} is unknown; use one of {', '.join(FORMATS)}.")
    if precision is not None and precision not in PRECISIONS:
        raise ValueError(f"precision {precision!r} is unknown; use one of {', '.join(PRECISIONS)}.")
    target = FORMATS[format]()
    _check_suffix(out, format, target)
    target.check()
    found = read_source(source, changes)
    precision = _precision(found, format, precision, calibration)
    place = _place(found, out, target)
    with tempfile.TemporaryDirectory() as folder:
        trial = Path(folder) / f"model{target.suffix}"
        exact = _run_source(found, Path(folder) / "source.onnx")
        if calibration is not None:
            header = quantize(found.data, exact, target, calibration, trial, progress=progress)
        else:
            header = dataclasses.replace(found.header, precision=precision)
            data = halved(found.data) if precision == "fp16" else found.data
            target.save(target.convert(data), header, trial)
            compare(exact, target.open(trial), TOLERANCES[precision])
        files = target.place(trial, place)
    return Exported(place, tuple(files), header)


def _check_suffix(out: str | Path | None, format: str, target: Format) -> None:
    if out is not None and Path(out).suffix.lower() != target.suffix:
        fitting = [name for name, kind in FORMATS.items() if kind.suffix == Path(out).suffix.lower()]
        other = f" (or take --format {fitting[0]})" if fitting else ""
        raise ValueError(f"The file {out} must end in {target.suffix}, as the format {format} does{other}.")


def _precision(found: Source, format: str, wanted: str | None, calibration: Calibration | None) -> str:
    """Gives how the weights will be stored."""
    stored = found.header.precision
    precision = stored if wanted is None else wanted
    if stored == "int8" and (precision != "int8" or format != "onnx" or calibration is not None):
        raise ValueError(
            f"{found.path} is quantized to int8 already, so only its header can be changed (--set): give the "
            "checkpoint or the fp32 .onnx file that it was made from."
        )
    if stored == "fp16" and precision == "fp32":
        raise ValueError(
            f"The weights of {found.path} are rounded to 16 bits already: take --precision fp16, or give the "
            "checkpoint that it was made from."
        )
    if precision == "int8" and stored != "int8" and calibration is None:
        raise ValueError("int8 needs labelled images like those that the model will see: --calibrate DATA.")
    if precision != "int8" and calibration is not None:
        raise ValueError(f"--calibrate is for int8, but the precision is {precision}: add --precision int8.")
    return precision


def _place(found: Source, out: str | Path | None, target: Format) -> Path:
    """Gives the file to write."""
    if out is not None:
        return Path(out)
    place = found.path.with_suffix(target.suffix)
    if found.packaged:
        return Path(place.name)
    if place == found.path:
        raise ValueError(f"This would overwrite its source {place}: name the new file with --out.")
    return place


def _run_source(found: Source, file: Path) -> Engine:
    source_format = OnnxFormat()
    source_format.save(found.data, found.header, file)
    return source_format.open(file)


__all__ = ["FORMATS", "TOLERANCES", "Exported", "export"]
