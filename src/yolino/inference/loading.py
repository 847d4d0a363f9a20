"""A name or a file of a model -> a predictor."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from yolino.inference.engines import ENGINES, open_engine
from yolino.inference.postprocessing import Linker
from yolino.inference.predictor import Predictor


def model_path(model: Path | str) -> Path:
    """Gives the file of a model: that of a packaged one ("default"), or the path given.

    Raises:
        ValueError: If `model` is neither the name of a packaged model nor looks like a model file.
    """
    path = Path(model)
    folder = Path(str(resources.files("yolino"))) / "models"
    names = sorted(file.stem for file in folder.glob("*.onnx"))
    if str(model) in names:
        return folder / f"{model}.onnx"
    if path.suffix.lower() in ENGINES or path.is_file():
        return path
    allowed = "".join(f"{name!r} or " for name in names)
    raise ValueError(
        f"The model {str(model)!r} is unknown: give {allowed}the path of a file in {' or '.join(ENGINES)}."
    )


def load(
    model: Path | str = "default",
    *,
    device: str = "auto",
    threshold: float | None = None,
    threads: int | None = None,
    linker: Linker | None = None,
) -> Predictor:
    """Gives a predictor: `yolino.load()(image)` is a `Polylines`.

    Args:
        model: "default", or the path of an exported model (.onnx) or checkpoint (.safetensors, needs torch).
        device: "auto", "cpu" or "cuda".
        threshold: Lowest score of a segment; the model's own by default.
        threads: Threads of the network on a processor; None lets the engine decide.
        linker: Joins segments to polylines, in place of the model's own.

    Raises:
        FileNotFoundError: If the model file does not exist.
        ValueError: If the model is unknown or no YOLinO model, or the device is unknown or not available.
        ModuleNotFoundError: If a checkpoint is given and torch is not installed.
    """
    return Predictor(
        open_engine(model_path(model), device=device, threads=threads), threshold=threshold, linker=linker
    )


__all__ = ["load", "model_path"]
